"""Which candidate is better: constraints first, then objective (Deb, Comput. Methods Appl. Mech. Eng. 186, 2000)."""

from collections.abc import Sequence

import numpy as np

from dualwinch.tuning.scoring.evaluation import Evaluation


def best_first(evaluations: Sequence[Evaluation]) -> list[int]:
    """Places of the evaluations, the best first.

    What was given up early comes last. Among the others the feasible come first, by objective (several: by the number
    of the front they are on), then the infeasible by how much they violate.
    """
    fronts = _front_numbers(evaluations)

    def key(place: int) -> tuple[bool, float, float, float]:
        one = evaluations[place]
        return one.pruned, one.violation, float(fronts[place]), one.objectives[0]

    return sorted(range(len(evaluations)), key=key)


def pareto_front(evaluations: Sequence[Evaluation]) -> list[int]:
    """Places of the feasible evaluations that no other feasible one beats in every objective, by the first one."""
    feasible = [place for place, one in enumerate(evaluations) if one.feasible]
    values = np.array([evaluations[place].objectives for place in feasible])
    kept = [place for place, row in zip(feasible, values, strict=True) if not _dominated(row, values)]
    return sorted(kept, key=lambda place: evaluations[place].objectives)


def _dominated(row: np.ndarray, others: np.ndarray) -> bool:
    return bool(((others <= row).all(axis=1) & (others < row).any(axis=1)).any())


def _front_numbers(evaluations: Sequence[Evaluation]) -> list[int]:
    """For several objectives: 0 for what none beats, 1 for what only those beat, and so on; else 0 throughout."""
    numbers = [0] * len(evaluations)
    if not evaluations or len(evaluations[0].objectives) == 1:
        return numbers
    values = np.array([one.objectives for one in evaluations])
    left, number = np.arange(len(values)), 0
    while len(left):
        beaten = np.array([_dominated(values[place], values[left]) for place in left])
        for place in left[~beaten]:
            numbers[place] = number
        left, number = left[beaten], number + 1
    return numbers
