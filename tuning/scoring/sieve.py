"""Which trials hold in many scenarios, found out without running each in all.

Gains that do not hold mostly fail in the same few scenarios. So trials meet first where most have failed so far, and
only those that hold there meet in the rest.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.tuning.scoring.evaluate import Evaluator, joined, row_of
from dualwinch.tuning.scoring.evaluation import Evaluation
from dualwinch.tuning.scoring.runs import worst_of

FIRST = 12
"""Scenarios in which trials meet first."""


class Sieve:
    """Scenarios in which trials meet, those first in which most have failed.

    Attributes:
        scenarios: all of them.
        constraints: with bounds that are numbers there.
    """

    def __init__(self, evaluator: Evaluator, scenarios: Sequence[Scenario]) -> None:
        """Run the paper's controller, which bounds may refer to."""
        self.scenarios, self.constraints = list(scenarios), evaluator.bounds(scenarios)
        self._evaluator, self._machines = evaluator, evaluator.survey(scenarios)
        self._failures = np.array([scenario.hard for scenario in scenarios], float)

    def meet(self, trials: Sequence[Evaluation]) -> list[Evaluation | None]:
        """What trials come to in all scenarios; ``None`` for those that do not hold where most have failed.

        Stability margins are looked at where all else holds.
        """
        if not trials:
            return []
        order = np.argsort(-self._failures, kind="stable")
        first, rest = order[:FIRST], order[FIRST:]
        candidates = [trial.candidate for trial in trials]
        early = self._evaluator.run(candidates, self._chosen(first), to_the_end=False)
        failed = self._failed(early, first)
        self._failures[first] += failed.sum(axis=0)
        kept = [row for row in range(len(trials)) if not failed[row].any()]
        found: list[Evaluation | None] = [None] * len(trials)
        if not kept:
            return found
        going_on = [candidates[row] for row in kept]
        late, hold = None, [True] * len(kept)
        if len(rest):
            late = self._evaluator.run(going_on, self._chosen(rest), to_the_end=False)
            failed = self._failed(late, rest)
            self._failures[rest] += failed.sum(axis=0)
            hold = [not any(fails) for fails in failed.tolist()]
        margins, met = self._evaluator.margins(going_on, self._machines, hold), self._chosen(order)
        for number, row in enumerate(kept):
            whole = joined(row_of(early, row), late, number) if late else row_of(early, row)
            found[row] = self._evaluator.judged(
                candidates[row], whole, met, margins=margins[number], constraints=self.constraints
            )
        return found

    def held(self, trials: Sequence[Evaluation]) -> list[tuple[Evaluation, Evaluation]]:
        """The trials that keep to every constraint in all scenarios, and what each came to there."""
        met = zip(trials, self.meet(trials), strict=True)
        return [(trial, result) for trial, result in met if result is not None and result.feasible]

    def _chosen(self, indices: NDArray[np.intp]) -> list[Scenario]:
        return [self.scenarios[index] for index in indices]

    def _failed(self, result: BatchResult, indices: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Which runs in some scenarios did not end, or exceed a bound on what is the worst, (candidates, scenarios)."""
        return worst_of(result, self.constraints, self._chosen(indices)) > 0
