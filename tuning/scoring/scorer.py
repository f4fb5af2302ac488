"""Run candidates in scenarios, and evaluate objectives, bounds and stability margins."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis.margin_survey import MarginSurvey, WorstMargin
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.batch.workers import Workers
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.results.outcomes import RunOutcomes
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring import clock
from dualwinch.tuning.scoring.budget import Meter
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.rollouts import keeps_tight, over, run_pairs, worst_of
from dualwinch.tuning.scoring.training_set import TrainingSet, controlled_as, survey

Margins = dict[str, WorstMargin]
"""Kind of a stability margin → the worst over several machines."""

BackOff = Mapping[str, float]
"""Label of a constraint → distance to keep from its bound, as a share of it."""

FAILED = "scenarios not completed <= 0"
"""Constraint that every scenario is completed; its violation is the share of incomplete ones."""

MAX_SLACK = 0.01
"""Share of a run with a slack rope above which it is stopped, if no rope may be slack: slack is slow to simulate."""


class Scorer:
    """Runs candidates of a problem in scenarios and evaluates them.

    Attributes:
        training: the problem with its training scenarios.
        meter: rollouts and margins so far, and their time.
    """

    def __init__(self, training: TrainingSet, workers: Workers = None) -> None:
        self.training, self.meter = training, Meter()
        self._workers, self._units = workers, training.problem.units
        self._kinds = [statistic.margin for statistic in training.problem.margins]
        self._max_slack = MAX_SLACK if keeps_tight(training.constraints) else None

    @property
    def problem(self) -> TuningProblem:
        """The tuning problem."""
        return self.training.problem

    @property
    def rollouts(self) -> int:
        """Number of rollouts so far."""
        return self.meter.rollouts.count

    @property
    def seconds(self) -> float:
        """Wall time of the rollouts in s."""
        return self.meter.rollouts.seconds

    def start(self) -> Evaluation:
        """Evaluate the start in the training set, from the rollouts of `prepare`."""
        training, candidate = self.training, Candidate(self.problem.start, "start")
        (margins,) = self.margins([candidate], training.margins)
        return self.evaluation(candidate, training.start, [*training.scenarios, *training.hard], margins=margins)

    def over(
        self,
        candidates: Sequence[Candidate],
        scenarios: Sequence[Experiment | Scenario],
        *,
        constraints: Sequence[Constraint] | None = None,
    ) -> list[Evaluation]:
        """Evaluate candidates in all of the scenarios; arguments as in `evaluation`.

        Margins are computed on the machines of the scenarios.
        """
        if not candidates:
            return []
        result = self.run(candidates, scenarios)
        margins = self.margins(candidates, self.survey(scenarios))
        return [
            self.evaluation(candidate, result, scenarios, row, margins=margins[row], constraints=constraints)
            for row, candidate in enumerate(candidates)
        ]

    def survey(
        self, scenarios: Sequence[Experiment | Scenario], experiment: Experiment | None = None
    ) -> MarginSurvey | None:
        """The nominal machine and the first ones of the scenarios (`tuning.scoring.training_set.survey`)."""
        return survey(self.problem, scenarios[: self.problem.options.machines_checked], self._workers, experiment)

    def reference_runs(self, name: str, scenarios: Sequence[Experiment | Scenario]) -> BatchResult:
        """One row of runs of the paper's controller or of the start (`constraints.REFERENCES`) in scenarios."""
        experiment = self.problem.paper_experiment if name == "paper" else self.problem.experiment
        return self.run(None, controlled_as(experiment, scenarios))

    def margins(
        self,
        candidates: Sequence[Candidate],
        machines: MarginSurvey | None,
        loops: NDArray[np.intp] | None = None,
    ) -> list[Margins | None]:
        """Compute the worst margins of candidates on given machines; ``None`` where no margin is bounded.

        `loops` are indices of the survey's loops, by default all.
        """
        if not (machines and candidates):
            return [None] * len(candidates)
        began, space = clock.now(), self.problem.space
        points = [candidate.point for candidate in candidates]
        worst = machines.worst([space.parameters(point) if point else () for point in points], self._kinds, loops)
        self.meter.margins_in(loops).add(began, len(points) * len(machines.machines))
        return list(worst)

    def run(
        self,
        candidates: Sequence[Candidate] | None,
        scenarios: Sequence[Experiment | Scenario],
        *,
        to_the_end: bool = True,
    ) -> BatchResult:
        """Run candidates in scenarios, one row per candidate; without any, one row with the scenarios' own gains.

        Unless `to_the_end`, runs are stopped if a rope is slack for long although the constraints forbid it.
        """
        space, began = self.problem.space, clock.now()
        if candidates is None:
            result = run_pairs([], [[]], scenarios, self._workers)
        else:
            points = [space.parameters(candidate.point) for candidate in candidates]
            max_slack = None if to_the_end else self._max_slack
            result = run_pairs(space.keys, points, scenarios, self._workers, max_slack)
        self.meter.rollouts.add(began, result.outcomes.size)
        return result

    def evaluation(
        self,
        candidate: Candidate,
        result: RunOutcomes,
        scenarios: Sequence[Experiment | Scenario],
        row: int = 0,
        *,
        pruned: bool = False,
        margins: Margins | None = None,
        constraints: Sequence[Constraint] | None = None,
        back_off: BackOff | None = None,
    ) -> Evaluation:
        """Evaluate a candidate from a row of a result.

        Default constraints are those of the training set (`bounds` gives those of other sets). Stability margins that
        were not computed have no value and no violation.
        """
        problem, outcomes = self.problem, result.outcomes[row]
        statistics = {statistic.name: over(statistic, result, row, scenarios) for statistic in problem.reported}
        bounds = self.training.constraints if constraints is None else constraints
        evaluation = Evaluation(
            candidate=candidate,
            objectives=tuple(statistics[statistic.name] for statistic in problem.objectives),
            violations={FAILED: float(1 - (outcomes == "completed").mean())},
            statistics=statistics,
            outcomes=dict(Counter(outcomes.tolist())),
            scenarios=len(outcomes),
            pruned=pruned,
            violated=int((worst_of(result.take([row], axis=0), bounds) > 0).sum()),
            units=self._units,
        )
        return self.with_margins(evaluation, margins, bounds, back_off)

    def with_margins(
        self,
        evaluation: Evaluation,
        margins: Margins | None,
        constraints: Sequence[Constraint],
        back_off: BackOff | None = None,
    ) -> Evaluation:
        """An evaluation with stability margins, and with the violations of all constraints."""
        values = {} if margins is None else {each.name: each.of(margins) for each in self.problem.margins}
        statistics = evaluation.statistics | values
        violations = {FAILED: evaluation.violations[FAILED]}
        for constraint in constraints:
            value, distance = statistics.get(constraint.statistic.name), (back_off or {}).get(constraint.label, 0.0)
            violations[constraint.label] = 0.0 if value is None else constraint.violation(value, distance)
        return replace(evaluation, statistics=statistics, violations=violations)
