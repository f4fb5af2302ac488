"""What error costs in another figure of merit: the trials of a search that no other one beats in both."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from dualwinch.tuning.scoring.evaluation import Evaluation

ERROR = "mse"
"""Figure of merit on one side of the trade."""

COSTS = ("chatter", "continuous_load")
"""Figures of merit on the other side."""

POINTS = 8
"""Points of a front that are scored again, at most."""


def undominated(costs: ArrayLike, errors: ArrayLike) -> list[int]:
    """Indices of the points that no other one beats in one figure without losing in the other; by cost.

    Args:
        costs: (points,)
        errors: (points,)
    """
    kept: list[int] = []
    across, heights = np.asarray(costs), np.asarray(errors)
    for index in np.lexsort((heights, across)).tolist():
        if not kept or heights[index] < heights[kept[-1]]:
            kept.append(index)
    return kept


def front(trials: Sequence[Evaluation], cost: str, most: int = POINTS) -> list[Evaluation]:
    """The front of the trials that keep to every constraint, from the least cost to the least error.

    Args:
        trials: of a search.
        cost: one of `COSTS`.
        most: number of points, spread evenly over the front; both ends are among them.
    """
    whole = [trial for trial in trials if trial.feasible]
    costs, errors = (np.array([trial.statistics[f"mean.{name}"] for trial in whole]) for name in (cost, ERROR))
    kept = undominated(costs, errors)
    chosen = dict.fromkeys(np.linspace(0, len(kept) - 1, min(most, len(kept))).round().astype(int).tolist())
    return [whole[kept[index]] for index in chosen]
