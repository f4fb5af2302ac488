"""Evaluate candidates by compiled rollouts: all in some scenarios, the promising in more, the best of those in all."""

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from dualwinch.simulation.analysis.worst_margins import MarginSurvey, WorstMargin
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning import clock
from dualwinch.tuning.prepared import Prepared
from dualwinch.tuning.scoring.evaluation import Candidate, Evaluation
from dualwinch.tuning.scoring.machines import survey
from dualwinch.tuning.scoring.ranking import promising_first
from dualwinch.tuning.scoring.runs import over, run_pairs

Margins = dict[str, WorstMargin]
"""Kind of a stability margin → the worst of some machines."""

FAILED = "scenarios not completed <= 0"
"""Constraint that every scenario runs to its end; its violation is the share that does not."""

ROUNDS = (1 / 6, 1 / 3)
"""Shares of the scenarios after which candidates are given up."""

KEPT_SHARE = 0.5
"""Share of the candidates that go on after each."""

FEW = 4
"""So many candidates are not worth pruning: their scenarios fill few vector lanes."""

EXEMPT = ("paper", "start")
"""Origins of candidates that are never given up early: others are compared with them."""


class Evaluator:
    """Evaluates candidates of a problem, and counts what that cost.

    Attributes:
        prepared: the problem.
        rollouts: number of rollouts so far.
        seconds: wall time they took.
        margin_seconds: wall time that stability margins took.
    """

    def __init__(self, prepared: Prepared, *, prune: bool = True, threads: int | None = None) -> None:
        """An evaluator.

        Args:
            prepared: gives scenarios, objectives and constraints.
            prune: whether hopeless candidates are given up after the first scenarios; never with several objectives.
            threads: default: one a core.
        """
        self.prepared = prepared
        self.rollouts, self.seconds, self.margin_seconds = 0, 0.0, 0.0
        self._threads, problem = threads, prepared.problem
        self._units = problem.units
        self._rounds = rounds(problem.scenarios) if prune and len(problem.objectives) == 1 else []

    @property
    def pace(self) -> float:
        """Wall time in s that a rollout took in the mean, margins included; 0 before the first."""
        return (self.seconds + self.margin_seconds) / self.rollouts if self.rollouts else 0.0

    def evaluate(self, candidates: Sequence[Candidate]) -> list[Evaluation]:
        """Evaluate candidates in the tuning scenarios.

        Raises:
            KeyboardInterrupt: interrupted; nothing of this batch is kept.
        """
        scenarios, met = self.prepared.scenarios, 0
        ends = [*(self._rounds if len(candidates) > FEW else []), len(scenarios)]
        left, results, judged = list(range(len(candidates))), dict[int, BatchResult](), dict[int, Evaluation]()
        for end in ends:
            more = self.run([candidates[index] for index in left], scenarios[met:end])
            for row, index in enumerate(left):
                results[index] = _joined(results[index], more, row) if met else _row(more, row)
            met, pruned = end, end < len(scenarios)
            margins = {} if pruned else self._margins_of(candidates, {index: results[index] for index in left})
            for index in left:
                judged[index] = self.judged(
                    candidates[index],
                    results[index],
                    scenarios[:end],
                    tuning=True,
                    pruned=pruned,
                    margins=margins.get(index),
                )
            left = self._going_on(candidates, {index: judged[index] for index in left})
        return [judged[index] for index in range(len(candidates))]

    def start(self) -> Evaluation:
        """The start in the tuning scenarios, from the rollouts that preparing has made."""
        prepared = self.prepared
        candidate = Candidate(prepared.problem.start, "start")
        margins = self.margins([candidate], prepared.margins)[0]
        return self.judged(candidate, prepared.start, prepared.scenarios, tuning=True, margins=margins)

    def over(self, candidates: Sequence[Candidate], scenarios: Sequence[Experiment | Scenario]) -> list[Evaluation]:
        """Evaluate candidates in all of some scenarios, up to the bounds themselves."""
        if not candidates:
            return []
        result = self.run(candidates, scenarios)
        margins = self.margins(candidates, self.survey(scenarios))
        return [
            self.judged(candidate, result, scenarios, row, margins=margins[row])
            for row, candidate in enumerate(candidates)
        ]

    def survey(
        self, scenarios: Sequence[Experiment | Scenario], experiment: Experiment | None = None
    ) -> MarginSurvey | None:
        """The machines of some scenarios beside the nominal one (`tuning.scoring.machines.survey`)."""
        return survey(self.prepared.problem, scenarios, self._threads, experiment=experiment)

    def margins(self, candidates: Sequence[Candidate], machines: MarginSurvey | None) -> list[Margins | None]:
        """The worst margins of candidates on some machines; ``None`` where none is bounded.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        problem = self.prepared.problem
        if not (machines and candidates):
            return [None] * len(candidates)
        began = clock.now()
        kinds = [statistic.margin for statistic in problem.margins]
        values = [problem.space.parameters(each.point) if each.point else () for each in candidates]
        found: list[Margins | None] = [*machines.worst(values, kinds)]
        self.margin_seconds += clock.now() - began
        return found

    def run(self, candidates: Sequence[Candidate] | None, scenarios: Sequence[Experiment | Scenario]) -> BatchResult:
        """The rollouts of candidates, a row each, in some scenarios; without candidates, those of the scenarios' own.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        space = self.prepared.problem.space
        began = clock.now()
        if candidates is None:
            result = run_pairs([], [[]], scenarios, self._threads)
        else:
            points = [space.parameters(candidate.point) for candidate in candidates]
            result = run_pairs(space.keys, points, scenarios, self._threads)
        self.seconds += clock.now() - began
        self.rollouts += result.outcomes.size
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
        margins: Margins | None = None,
    ) -> Evaluation:
        """What a row of a result comes to for a candidate; in tuning with a margin (`Problem.margin`).

        Stability margins that nobody has looked at have no value and violate nothing: such a candidate was given up, or
        failed a scenario.
        """
        problem, outcomes = self.prepared.problem, result.outcomes[row]
        done = outcomes == "completed"
        found = {statistic.name: over(statistic, result, row, scenarios) for statistic in problem.reported}
        if margins is not None:
            found |= {statistic.name: statistic.of(margins) for statistic in problem.margins}
        violations = {FAILED: float(1 - done.mean())}
        for constraint in self.prepared.constraints:
            margin, value = problem.margin(constraint) if tuning else 0.0, found.get(constraint.statistic.name)
            violations[constraint.label] = 0.0 if value is None else constraint.violation(value, margin)
        return Evaluation(
            candidate=candidate,
            objectives=tuple(found[statistic.name] for statistic in problem.objectives),
            violations=violations,
            statistics=found,
            outcomes=dict(Counter(outcomes.tolist())),
            scenarios=len(outcomes),
            pruned=pruned,
            units=self._units,
        )

    def _going_on(self, candidates: Sequence[Candidate], judged: dict[int, Evaluation]) -> list[int]:
        """Who meets further scenarios, by what they came to in those so far."""
        met = list(judged)
        order = [met[rank] for rank in promising_first(list(judged.values()))]
        chosen = set(order[: math.ceil(KEPT_SHARE * len(order))])
        return [index for index in met if index in chosen or candidates[index].origin in EXEMPT]

    def _margins_of(self, candidates: Sequence[Candidate], whole: dict[int, BatchResult]) -> dict[int, Margins | None]:
        """Margins of the candidates that ran to the end in all scenarios."""
        completed = [index for index, result in whole.items() if (result.outcomes == "completed").all()]
        found = self.margins([candidates[index] for index in completed], self.prepared.margins)
        return dict(zip(completed, found, strict=True))


def rounds(scenarios: int) -> list[int]:
    """Numbers of scenarios after which candidates are given up, of so many; ascending."""
    ends = {max(round(share * scenarios), 2) for share in ROUNDS}
    return sorted(end for end in ends if end < scenarios)


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
