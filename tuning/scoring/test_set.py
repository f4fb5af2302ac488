"""The test set: scenarios for a single score of the selected gains, not used in search and selection."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap

from dualwinch.analysis.margin_survey import MarginSurvey, WorstMargin
from dualwinch.simulation.batch.authority import force_demands
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.scoring.certificate import SampleCertificate, clopper_pearson
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.scorer import Scorer
from dualwinch.tuning.scoring.training_set import beyond_authority_as_hard, bounds_in, controlled_as, with_authority

ALIKE = 1e-9
"""Largest relative difference of all statistics at which the start equals the paper's controller."""


@dataclass(frozen=True)
class MarginLocation:
    """Location of the worst value of a stability margin.

    Attributes:
        worst: value, operating point and loop opening.
        machine: name of the machine.
    """

    worst: WorstMargin
    machine: str

    @property
    def words(self) -> str:
        """In words, such as ``opened at u, x = 2.5 m, v = 1.8 m/s, speed error 1 cm/s, 14.7 Hz, draw 12``."""
        worst = self.worst
        point = f"x = {worst.x:.4g} m, v = {worst.v:.4g} m/s"
        if worst.amplitude:
            point += f", speed error {100 * worst.amplitude:.3g} cm/s"
        if worst.reason:
            return f"{worst.reason} at {point}, {self.machine}"
        if not worst.opening:
            return "no such change makes it unstable"
        return f"opened at {worst.opening}, {point}, {worst.frequency / (2 * math.pi):.3g} Hz, {self.machine}"


@dataclass(frozen=True)
class ControllerScore:
    """The score of a controller on the test set.

    Attributes:
        evaluation: its statistics and violations.
        feasible: the same with means over the scenarios within the motors' authority, as in training.
        result: metrics of every scenario, one row.
        attained: name of a bounded stability margin → location of its worst value.
    """

    evaluation: Evaluation
    feasible: Evaluation
    result: BatchResult
    attained: Mapping[str, MarginLocation] = field(default_factory=dict)


@dataclass(frozen=True)
class SelectionResult:
    """The selected candidate and its score.

    Attributes:
        best: the selected trial on the training set; the start if no trial improves on it.
        obstacle: why the start is kept, in words; empty if the best is a trial.
        contradiction: of the test set to the selection, in words; empty if there is none.
        certificate: what fresh draws and machines support of the best; ``None`` without an ensemble.
        examined: number of candidates, besides the start, that were examined for a certificate.
        unexamined: number of candidates that were not, and rank before the start in training.
        test_violations: number of test scenarios in which the best violates a bound on the worst case.
        scores: ``best``, ``start`` and ``paper`` → scores on the test set; without an ensemble, in the experiment.
        constraints: of the problem, with bounds as numbers for those scenarios.
        has_test_set: whether those are drawn from an ensemble.
        within_authority: (scenarios,) whether each is within the motors' authority.
    """

    best: Evaluation
    obstacle: str
    contradiction: str
    certificate: SampleCertificate | None
    examined: int
    unexamined: int
    test_violations: int
    scores: dict[str, ControllerScore]
    constraints: tuple[Constraint, ...]
    has_test_set: bool
    within_authority: NDArray[np.bool_]

    @property
    def improved(self) -> bool:
        """Whether the best is a trial, which improves on the start."""
        return not self.obstacle

    @property
    def feasible_scenarios(self) -> int:
        """Number of test scenarios within the actuators' authority."""
        return int(self.within_authority.sum())

    @property
    def scored(self) -> Evaluation:
        """The best on the test set."""
        return self.scores["best"].evaluation

    @property
    def shown(self) -> tuple[str, ...]:
        """Names of the distinct scores: the best, the start and the paper's."""
        start = () if self.start_is_papers or not self.improved else ("start",)
        return "best", *start, *(() if self.start_is_papers and not self.improved else ("paper",))

    @property
    def start_is_papers(self) -> bool:
        """Whether the start has the same statistics as the paper's controller."""
        start, paper = (self.statistics(name) for name in ("start", "paper"))
        return all(abs(value - paper[name]) <= ALIKE * abs(paper[name]) for name, value in start.items())

    def statistics(self, name: str, *, feasible: bool = False) -> dict[str, float]:
        """Name of a statistic → its value for ``best``, ``start`` or ``paper``; means over feasible scenarios alone."""
        score = self.scores[name]
        return (score.feasible if feasible else score.evaluation).statistics

    def improvement(self, statistic: str, over: str = "paper", *, feasible: bool = False) -> float:
        """Factor by which a statistic of the best is below that of the paper's gains or of the start."""
        best_value, reference_value = (self.statistics(name, feasible=feasible)[statistic] for name in ("best", over))
        return reference_value / best_value if best_value else np.inf

    def violation_interval(self, confidence: float) -> tuple[float, float]:
        """Clopper–Pearson interval of the share of scenarios in which the best violates a bound on the worst case."""
        return clopper_pearson(self.test_violations, self.scored.scenarios, confidence)

    def mean_interval(self, statistic: Statistic, confidence: float) -> tuple[float, float, float] | None:
        """Mean, or geometric mean, of a metric of the best with its percentile-bootstrap interval.

        ``None`` for another kind of statistic, without a test set, with fewer than two runs, or of a geometric mean
        over values that are not positive.
        """
        result = self.scores["best"].result
        values = result.metrics[statistic.metric][0, result.outcomes[0] == "completed"]
        if not self.has_test_set or statistic.kind not in {"mean", "geomean"} or len(values) < 2:
            return None
        logarithmic = statistic.kind == "geomean"
        if logarithmic and values.min() <= 0:
            return None
        sample = np.log(values) if logarithmic else values
        interval = bootstrap((sample,), np.mean, confidence_level=confidence, method="percentile", rng=0)
        bounds = np.array([sample.mean(), *interval.confidence_interval])
        mean, low, high = np.exp(bounds) if logarithmic else bounds
        return float(mean), float(low), float(high)


class TestSet:
    """Draws of a problem's ensemble from the stream `TEST`, or its experiment.

    Attributes:
        scenarios: of the set.
        within_authority: (scenarios,) whether each demands less than `TuningOptions.authority` of the motors' force.
        constraints: with bounds that are numbers there.
        paper: score of the baseline controller.
    """

    def __init__(self, scorer: Scorer, count: int, seed: int) -> None:
        """Draw `count` scenarios, and run the baseline controller in them."""
        problem, self._scorer = scorer.problem, scorer
        self.scenarios = problem.drawn(count, seed)
        self.within_authority = with_authority(force_demands(self.scenarios), problem.options.authority)
        self._machines = scorer.survey(self.scenarios)
        with_paper = controlled_as(problem.paper_experiment, self.scenarios)
        runs = {"paper": scorer.run(None, with_paper)}
        if any(constraint.reference == "start" for constraint in problem.constraints):
            runs["start"] = scorer.run([Candidate(problem.start, "start")], self.scenarios)
        self.constraints = bounds_in(scorer.training.constraints, problem, runs, with_paper)
        machines = scorer.survey(with_paper, problem.paper_experiment)
        self.paper = self._scored(Candidate({}, "paper"), runs["paper"], with_paper, machines)

    def score(self, candidate: Candidate) -> ControllerScore:
        """Score a candidate."""
        return self._scored(candidate, self._scorer.run([candidate], self.scenarios), self.scenarios, self._machines)

    def _scored(
        self,
        candidate: Candidate,
        result: BatchResult,
        scenarios: Sequence[Experiment | Scenario],
        machines: MarginSurvey | None,
    ) -> ControllerScore:
        scorer = self._scorer
        (margins,) = scorer.margins([candidate], machines)
        evaluation, feasible = (
            scorer.evaluation(candidate, result, each, margins=margins, constraints=self.constraints)
            for each in (scenarios, beyond_authority_as_hard(scenarios, self.within_authority))
        )
        if not (margins and machines):
            return ControllerScore(evaluation, feasible, result)
        names = {statistic.margin: statistic.name for statistic in scorer.training.problem.margins}
        attained = {
            names[kind]: MarginLocation(worst, _machine_name(machines.machines[worst.machine]))
            for kind, worst in margins.items()
        }
        return ControllerScore(evaluation, feasible, result, attained)


def _machine_name(machine: Experiment | Scenario) -> str:
    if not isinstance(machine, Scenario):
        return "the nominal machine"
    return f"{'vertex' if machine.vertex else 'draw'} {machine.index}"
