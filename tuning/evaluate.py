"""Evaluate candidates by compiled rollouts: all in some scenarios, the promising in more, the best in yet more."""

import math
import time
from collections import Counter
from collections.abc import Sequence

import numpy as np

from simulation.batch import BatchResult
from simulation.ensemble import Scenario
from simulation.experiment import Experiment
from tuning.evaluation import Candidate, Evaluation
from tuning.problem import Problem, over, run_pairs
from tuning.ranking import best_first

FAILED = "scenarios not completed <= 0"
"""Constraint that every scenario runs to its end; its violation is the share that does not."""

FIRST_SHARE, KEPT_SHARE = 0.5, 0.5
"""Share of the scenarios that all candidates see, and share of the candidates that see the rest."""

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
        scenarios = self.problem.tuning_scenarios
        if not self._first or len(candidates) < 2:
            result = self._run(candidates, scenarios)
            return [self.judged(one, result, scenarios, place, tuning=True) for place, one in enumerate(candidates)]
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
            whole[place] = _joined(early, place, late, row)
            judged[place] = self.judged(candidates[place], whole[place], scenarios, tuning=True)
        leaders = [place for place in best_first(judged)[:LEADERS] if judged[place].feasible]
        stress = self.problem.stress_scenarios
        if leaders and stress:
            more = self._run([candidates[place] for place in leaders], stress)
            for row, place in enumerate(leaders):
                result = _joined(whole[place], 0, more, row)
                judged[place] = self.judged(candidates[place], result, [*scenarios, *stress], tuning=True)
        return judged

    def over(self, candidates: Sequence[Candidate], scenarios: Sequence[Experiment | Scenario]) -> list[Evaluation]:
        """Evaluate candidates in all of some scenarios."""
        if not candidates:
            return []
        result = self._run(candidates, scenarios)
        return [self.judged(one, result, scenarios, place) for place, one in enumerate(candidates)]

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


def _joined(early: BatchResult, place: int, late: BatchResult, row: int) -> BatchResult:
    """One candidate's results in the first scenarios and in the others, as one result of one row."""
    return BatchResult(
        outcomes=np.concatenate([early.outcomes[place], late.outcomes[row]])[None],
        end_times=np.concatenate([early.end_times[place], late.end_times[row]])[None],
        metrics={
            name: np.concatenate([early.metrics[name][place], late.metrics[name][row]])[None] for name in early.metrics
        },
        columns={},
    )
