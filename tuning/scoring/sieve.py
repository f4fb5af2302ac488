"""Which trials hold in many scenarios, found out without running each in all.

Gains that do not hold mostly fail in the same few scenarios. So trials meet first where most have failed so far, and
only those that hold there meet in the rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.scoring.evaluation import Candidate, Evaluation
from dualwinch.tuning.scoring.runs import joined, row_of, worst_of
from dualwinch.tuning.scoring.scorer import Scorer

FIRST = 12
"""Scenarios in which trials meet first."""


@dataclass(frozen=True)
class Attempt:
    """What a trial came to in the scenarios of a sieve.

    Attributes:
        result: in all of them; ``None`` where it does not hold where most have failed.
        excess: by how much it exceeds the bound that it exceeds the most, as a share, in those that it was run in;
            negative where it keeps to all, infinite where it did not end.
    """

    result: Evaluation | None
    excess: float

    @property
    def held(self) -> Evaluation | None:
        """The result where it keeps to every constraint."""
        return self.result if self.result is not None and self.result.feasible else None


class Sieve:
    """Scenarios in which trials meet, those first in which most have failed.

    Attributes:
        scenarios: all of them.
        constraints: with bounds that are numbers there.
    """

    def __init__(self, scorer: Scorer, scenarios: Sequence[Scenario]) -> None:
        """Run the paper's controller, which bounds may refer to."""
        self.scenarios, self.constraints = list(scenarios), scorer.bounds(scenarios)
        self._scorer, self._machines = scorer, scorer.survey(scenarios)
        self._failures = np.array([scenario.hard for scenario in scenarios], float)

    def meet(self, candidates: Sequence[Candidate]) -> list[Attempt]:
        """What candidates come to, in all scenarios where they hold where most have failed.

        Stability margins are looked at where all else holds.
        """
        if not candidates:
            return []
        order = np.argsort(-self._failures, kind="stable")
        first, rest = order[:FIRST], order[FIRST:]
        early = self._scorer.run(candidates, self._chosen(first), to_the_end=False)
        excess = self._excess(early, first).max(axis=1)
        kept = np.flatnonzero(excess <= 0).tolist()
        found = [Attempt(None, float(each)) for each in excess]
        if not kept:
            return found
        going_on = [candidates[row] for row in kept]
        late, hold = None, [True] * len(kept)
        if len(rest):
            late = self._scorer.run(going_on, self._chosen(rest), to_the_end=False)
            excess[kept] = np.maximum(excess[kept], self._excess(late, rest).max(axis=1))
            hold = (excess[kept] <= 0).tolist()
        margins, met = self._scorer.margins(going_on, self._machines, hold), self._chosen(order)
        for number, row in enumerate(kept):
            whole = joined(row_of(early, row), late, number) if late else row_of(early, row)
            result = self._scorer.judged(
                candidates[row], whole, met, margins=margins[number], constraints=self.constraints
            )
            found[row] = Attempt(result, float(excess[row]))
        return found

    def _chosen(self, indices: NDArray[np.intp]) -> list[Scenario]:
        return [self.scenarios[index] for index in indices]

    def _excess(self, result: BatchResult, indices: NDArray[np.intp]) -> NDArray[np.float64]:
        """By how much runs in some scenarios exceed a bound on what is the worst (`worst_of`); failures are counted."""
        excess = worst_of(result, self.constraints, self._chosen(indices))
        self._failures[indices] += (excess > 0).sum(axis=0)
        return excess
