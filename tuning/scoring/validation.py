"""Validation set: sequential evaluation of candidates in scenarios of a separate stream, and repair of the reserve.

Candidates that satisfy their constraints in the few training scenarios may violate them in others. They are evaluated
sequentially, hardest scenarios first, and rejected at the first violation (`ValidationSet`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.batch.authority import force_demands
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.results.outcomes import concatenated
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.baseline import RESERVE
from dualwinch.tuning.problem import VALIDATION, TuningProblem
from dualwinch.tuning.scoring.evaluation import Scorer
from dualwinch.tuning.scoring.progress import SCREENING
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.rollouts import worst_of
from dualwinch.tuning.scoring.training_set import validation_draws, vertices
from dualwinch.tuning.selection_config import SampleSizes
from dualwinch.tuning.space import ContinuousDimension


def validation_scenarios(problem: TuningProblem, sizes: SampleSizes) -> list[Scenario]:
    """Vertices of the box of draws within authority, and draws, from the stream `VALIDATION`.

    Draws in which the vehicle falls behind for lack of force with any gains are excluded (`validation_draws`).
    """
    if problem.ensemble is None:
        raise ValueError("only an ensemble has validation scenarios")
    ensemble, seed = replace(problem.ensemble, experiment=problem.experiment), problem.stream(VALIDATION)
    draws = validation_draws(list(ensemble.scenarios(sizes.draws, seed)), problem.selection)
    return [*vertices(ensemble, sizes.vertices, seed), *draws]


@dataclass(frozen=True)
class Screened:
    """The result of a candidate on the validation set.

    Attributes:
        result: in all scenarios; ``None`` if a bound is violated in the first ones, or enough others are feasible.
        missing: label of a constraint in training → the largest violation of a run, as a share of the bound; infinite
            if one is incomplete, -infinite if it bounds no worst case.
    """

    result: Evaluation | None
    missing: dict[str, float]

    @property
    def excess(self) -> float:
        """The largest violation."""
        return max(self.missing.values(), default=-math.inf)

    @property
    def feasible(self) -> Evaluation | None:
        """The result if it satisfies every constraint, else ``None``."""
        return self.result if self.result is not None and self.result.feasible else None


class ValidationSet:
    """Sequential evaluation of candidates: hardest scenarios first, rejection at the first violation.

    Infeasible gains mostly fail in the same few scenarios, so scenarios are ordered by the number of failures so far.

    Attributes:
        scenarios: of the set.
        constraints: with bounds as numbers for the set.
        machines: of the scenarios, for stability margins.
    """

    def __init__(self, scorer: Scorer, scenarios: Sequence[Scenario]) -> None:
        """Run the baseline controller, to which bounds may refer."""
        self.scenarios, self.constraints = list(scenarios), scorer.bounds(scenarios)
        self._scorer, self.machines = scorer, scorer.survey(scenarios)
        self._first = scorer.training.problem.selection.first_screened
        self._failures = np.array([scenario.hard for scenario in scenarios], float)

    def extend(self, draws: Sequence[Scenario]) -> list[Scenario]:
        """Add draws to the set as its hardest scenarios, except those that `validation_scenarios` would exclude.

        Returns:
            The added scenarios.
        """
        config = self._scorer.training.problem.selection
        added = [
            replace(draw, hard=True)
            for draw, asked in zip(draws, force_demands(draws), strict=True)
            if asked.shortfall <= config.largest_lag
        ]
        self.scenarios += added
        self._failures = np.append(self._failures, [self._failures.max(initial=0.0) + 1] * len(added))
        return added

    def screen(self, candidates: Sequence[Candidate]) -> list[Screened]:
        """Evaluate candidates; stability margins of those that satisfy all other constraints, the best first."""
        if not candidates:
            return []
        order = np.argsort(-self._failures, kind="stable")
        first, rest = order[: self._first], order[self._first :]
        early, missing = self._run(candidates, first)
        found = [Screened(None, each) for each in missing]
        kept = [row for row, each in enumerate(found) if each.excess <= 0]
        if not kept:
            return found
        going_on, late = [candidates[row] for row in kept], None
        if len(rest):
            late, further = self._run(going_on, rest)
            for row, more in zip(kept, further, strict=True):
                found[row] = Screened(None, {label: max(value, more[label]) for label, value in missing[row].items()})
        scenarios = self._chosen(order)
        for number, row in enumerate(kept):
            whole = concatenated([early.take([row], axis=0), *([late.take([number], axis=0)] if late else [])])
            result = self._scorer.evaluation(candidates[row], whole, scenarios, constraints=self.constraints)
            found[row] = replace(found[row], result=result)
        return found if self.machines is None else self._with_margins(found)

    def _with_margins(self, found: Sequence[Screened]) -> list[Screened]:
        """The results, with stability margins of candidates that satisfy all other constraints.

        With a single objective, margins are computed in its order until there are enough feasible candidates for the
        chance constraint; the remaining ones have no result.
        """
        known, count = list(found), 0
        satisfied = [(row, each.result) for row, each in enumerate(found) if each.excess <= 0 and each.result]
        satisfied.sort(key=lambda pair: pair[1].costs[0])
        for number, (row, result) in enumerate(satisfied, 1):
            if len(result.costs) == 1 and count >= self._scorer.training.problem.selection.chance_candidates:
                known[row] = replace(known[row], result=None)
                continue
            status = f"choosing: stability margins of candidate {number} of {len(satisfied)}"
            self._scorer.watch.step(SCREENING, status)
            (margins,) = self._scorer.margins([result.candidate], self.machines)
            whole = self._scorer.with_margins(result, margins or {}, self.constraints, training=False)
            count += whole.feasible
            known[row] = replace(known[row], result=whole)
        return known

    def _chosen(self, indices: NDArray[np.intp]) -> list[Scenario]:
        return [self.scenarios[index] for index in indices]

    def _run(
        self, candidates: Sequence[Candidate], indices: NDArray[np.intp]
    ) -> tuple[BatchResult, list[dict[str, float]]]:
        """Run candidates in given scenarios, count failures; return also each one's largest violation of each bound."""
        scenarios = self._chosen(indices)
        result = self._scorer.run(candidates, scenarios, to_the_end=False)
        self._failures[indices] += (worst_of(result, self.constraints) > 0).sum(axis=0)
        pairs = zip(self._scorer.training.constraints, self.constraints, strict=True)
        worst = {known.label: worst_of(result, [each]).max(axis=1) for known, each in pairs}
        return result, [
            {label: float(values[row]) for label, values in worst.items()} for row in range(len(candidates))
        ]


def repaired(candidate: Candidate, excess: float, problem: TuningProblem, share: float = 1.0) -> Candidate | None:
    """Repair: the candidate with the reserve that lowers its highest peak to its bound, with the back-off of training.

    The reserve, the distance of tension commands from `tension_max`, lowers the highest peaks by nearly its own size at
    almost no cost. A search does not see this: the peaks in its few scenarios are lower than in hundreds.

    Args:
        candidate: that was run.
        excess: of its highest peak over the bound, as a share; negative if it is lower.
        problem: has the space and the bounds.
        share: of the wanted change (line search).

    Returns:
        The repaired candidate; ``None`` if the reserve is not tuned or cannot be raised, no constraint bounds the peak,
        or the excess is too large for the reserve.
    """
    bounds = [each.bound for each in problem.constraints if each.statistic.name == PEAK and not each.at_least]
    varies = next((each for each in problem.space.dimensions if each.name == RESERVE), None)
    config = problem.selection
    if not (bounds and isinstance(varies, ContinuousDimension)) or not math.isfinite(excess):
        return None
    now = float(candidate.point[RESERVE])
    reserve = min(now + share * (excess + config.back_off) * min(bounds), varies.upper)
    if excess > config.repair_most or reserve <= now:
        return None
    return replace(candidate, point=candidate.point | {RESERVE: reserve})


PEAK = "worst.peak_tension"
