"""Evaluate candidates by compiled rollouts: all in some scenarios, the promising in more, the best in yet more."""

import math
import time
from collections import Counter
from collections.abc import Sequence

import numpy as np

from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.problem import Problem, over, run_pairs
from dualwinch.tuning.scoring.evaluation import Candidate, Evaluation
from dualwinch.tuning.scoring.ranking import best_first

FAILED = "scenarios not completed <= 0"
"""Constraint that every scenario runs to its end; its violation is the share that does not."""

FIRST_SHARE, KEPT_SHARE = 0.5, 0.5
"""Share of the scenarios that all candidates see, and share of the candidates that see the rest."""

FEW = 4
"""So many candidates are not worth pruning: their scenarios fill few vector lanes."""

LEADERS = 2
"""Candidates of a call, the best of it, that have to hold in the stress scenarios as well."""

EXEMPT = ("paper", "start")
"""Origins of candidates that are never given up early: others are compared with them."""


class Evaluator:
    """Evaluates candidates of a problem, and counts what that cost.

    Attributes:
        rollouts: number of rollouts so far.
        seconds: wall time they took.
    """

    def __init__(self, problem: Problem, *, prune: bool = True, threads: int | None = None) -> None:
        """An evaluator.

        Args:
            problem: gives scenarios, objectives and constraints.
            prune: whether hopeless candidates are given up after the first scenarios; never with several objectives.
            threads: default: one a core.
        """
        self.problem = problem
        self.rollouts, self.seconds = 0, 0.0
        self._threads, self._pace = threads, 0.0
        self._first = round(FIRST_SHARE * problem.scenarios) if prune and len(problem.objectives) == 1 else 0

    @property
    def pace(self) -> float:
        """Wall time in s that a rollout took in the latest call; the first call of all compiles."""
        return self._pace

    def evaluate(self, candidates: Sequence[Candidate]) -> list[Evaluation]:
        """Evaluate candidates in the tuning scenarios.

        Raises:
            KeyboardInterrupt: interrupted; nothing of this batch is kept.
        """
        scenarios, stress = self.problem.tuning_scenarios, self.problem.stress_scenarios
        if not self._first:
            return self.over(candidates, scenarios, tuning=True)
        judged, whole = self._tried(candidates, scenarios)
        leaders = [place for place in best_first(judged)[:LEADERS] if judged[place].feasible]
        if leaders and stress:
            more = self._run([candidates[place] for place in leaders], stress)
            for row, place in enumerate(leaders):
                result = _joined(whole[place], more, row)
                judged[place] = self.judged(candidates[place], result, [*scenarios, *stress], tuning=True)
        return judged

    def _tried(
        self, candidates: Sequence[Candidate], scenarios: Sequence[Experiment | Scenario]
    ) -> tuple[list[Evaluation], dict[int, BatchResult]]:
        """Evaluations, hopeless candidates given up after the first scenarios; and the results of the others."""
        if len(candidates) <= FEW:
            result = self._run(candidates, scenarios)
            judged = [self.judged(one, result, scenarios, place, tuning=True) for place, one in enumerate(candidates)]
            return judged, {place: _row(result, place) for place in range(len(candidates))}
        early = self._run(candidates, scenarios[: self._first])
        judged = [
            self.judged(one, early, scenarios[: self._first], place, tuning=True, pruned=True)
            for place, one in enumerate(candidates)
        ]
        order = best_first(judged)
        kept = set(order[: math.ceil(KEPT_SHARE * len(order))])
        kept |= {place for place, one in enumerate(candidates) if one.origin in EXEMPT}
        places = sorted(kept)
        late = self._run([candidates[place] for place in places], scenarios[self._first :])
        whole: dict[int, BatchResult] = {}
        for row, place in enumerate(places):
            whole[place] = _joined(_row(early, place), late, row)
            judged[place] = self.judged(candidates[place], whole[place], scenarios, tuning=True)
        return judged, whole

    def over(
        self, candidates: Sequence[Candidate], scenarios: Sequence[Experiment | Scenario], *, tuning: bool = False
    ) -> list[Evaluation]:
        """Evaluate candidates in all of some scenarios; in tuning with a margin (`Problem.margin`)."""
        if not candidates:
            return []
        result = self._run(candidates, scenarios)
        return [self.judged(one, result, scenarios, place, tuning=tuning) for place, one in enumerate(candidates)]

    def _run(self, candidates: Sequence[Candidate], scenarios: Sequence[Experiment | Scenario]) -> BatchResult:
        space = self.problem.space
        began = time.perf_counter()
        result = run_pairs(space.keys, [space.parameters(one.point) for one in candidates], scenarios, self._threads)
        took = time.perf_counter() - began
        self.seconds += took
        self.rollouts += result.outcomes.size
        self._pace = took / result.outcomes.size
        return result

    def judged(
        self,
        candidate: Candidate,
        result: BatchResult,
        scenarios: Sequence[Experiment | Scenario],
        row: int = 0,
        *,
        tuning: bool = False,
        pruned: bool = False,
    ) -> Evaluation:
        """What a row of a result comes to for a candidate; in tuning with a margin (`Problem.margin`)."""
        problem, outcomes = self.problem, result.outcomes[row]
        done = outcomes == "completed"
        found = {one: over(one, result, row, scenarios) for one in problem.reported}
        violations = {FAILED: float(1 - done.mean())}
        for one in problem.bounded:
            margin = problem.margin(one) if tuning else 0.0
            violations[one.label] = one.violation(found[one.statistic], margin)
        return Evaluation(
            candidate=candidate,
            objectives=tuple(found[one] for one in problem.minimised),
            violations=violations,
            statistics={one.name: value for one, value in found.items()},
            outcomes=dict(Counter(outcomes.tolist())),
            scenarios=len(outcomes),
            pruned=pruned,
        )


def _row(result: BatchResult, row: int) -> BatchResult:
    """One candidate's results as a result of one row."""
    metrics = {name: table[row : row + 1] for name, table in result.metrics.items()}
    return BatchResult(result.outcomes[row : row + 1], result.end_times[row : row + 1], metrics, {})


def _joined(early: BatchResult, late: BatchResult, row: int) -> BatchResult:
    """One candidate's results in the first scenarios, and a row of those in others, as one result of one row."""
    more = _row(late, row)
    metrics = {name: np.hstack([early.metrics[name], more.metrics[name]]) for name in early.metrics}
    return BatchResult(
        outcomes=np.hstack([early.outcomes, more.outcomes]),
        end_times=np.hstack([early.end_times, more.end_times]),
        metrics=metrics,
        columns={},
    )
