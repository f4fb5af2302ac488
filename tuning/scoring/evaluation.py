"""Bounds as numbers: a share of what the paper's controller reaches is one of what it reaches in the same scenarios."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dualwinch.simulation.analysis.margin_survey import MarginSurvey, WorstMargin
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.scoring import clock
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation, penalised_first
from dualwinch.tuning.scoring.rollouts import joined, keeps_tight, leeways, over, row_of, run_pairs, worst_of
from dualwinch.tuning.scoring.training_set import ActiveScenarios, TrainingSet, survey


def bounds_in(
    prepared: TrainingSet, paper: BatchResult, scenarios: Sequence[Experiment | Scenario]
) -> tuple[Constraint, ...]:
    """The constraints of a problem in other scenarios than those that it is tuned in.

    Shares of the paper's stability margins stay those of the machines that it is tuned on.

    Args:
        prepared: the problem.
        paper: the paper's controller in the scenarios, one row.
        scenarios: the others.
    """
    return tuple(
        constraint.given(over(constraint.statistic, paper, 0, scenarios))
        if constraint.of_paper and isinstance(constraint.statistic, Statistic)
        else known
        for constraint, known in zip(prepared.problem.constraints, prepared.constraints, strict=True)
    )


Margins = dict[str, WorstMargin]
"""Kind of a stability margin → the worst of some machines."""


@dataclass
class BatchEvaluation:
    """The candidates of a call, and what they have come to so far.

    Attributes:
        candidates: all of them.
        judged: what each came to.
        results: row of a candidate → its runs in what all meet, and in what it has met beyond; without the given up.
        margins: of each candidate.
    """

    candidates: Sequence[Candidate]
    judged: list[Evaluation]
    results: dict[int, BatchResult]
    margins: list[Margins | None]


FAILED = "scenarios not completed <= 0"
"""Constraint that every scenario runs to its end; its violation is the share that does not."""

MOST_SLACK = 0.01
"""Share of a run with a slack rope beyond which the run is given up, where no rope may be slack at all."""


class Scorer:
    """Runs candidates of a problem in scenarios, judges them, and counts what that cost.

    Attributes:
        prepared: the problem.
        rollouts: number of rollouts so far.
        seconds: wall time they took.
        margin_seconds: wall time that stability margins took.
    """

    def __init__(self, prepared: TrainingSet, threads: int | None = None) -> None:
        """A scorer.

        Args:
            prepared: gives objectives and constraints.
            threads: default: one a core.
        """
        self.prepared = prepared
        self.rollouts, self.seconds, self.margin_seconds = 0, 0.0, 0.0
        self._threads, self._units = threads, prepared.problem.units
        self._most_slack = MOST_SLACK if keeps_tight(prepared.constraints) else None

    @property
    def pace(self) -> float:
        """Wall time in s that a rollout took in the mean, margins included; 0 before the first."""
        return (self.seconds + self.margin_seconds) / self.rollouts if self.rollouts else 0.0

    def start(self) -> Evaluation:
        """The start in the tuning scenarios, from the rollouts that preparing has made."""
        prepared = self.prepared
        candidate = Candidate(prepared.problem.start, "start")
        margins = self.margins([candidate], prepared.margins)[0]
        return self.judged(candidate, prepared.start, prepared.scenarios, tuning=True, margins=margins)

    def over(
        self,
        candidates: Sequence[Candidate],
        scenarios: Sequence[Experiment | Scenario],
        *,
        tuning: bool = False,
        constraints: Sequence[Constraint] | None = None,
    ) -> list[Evaluation]:
        """Evaluate candidates in all of some scenarios; arguments as of `judged`."""
        if not candidates:
            return []
        result = self.run(candidates, scenarios)
        margins = self.margins(candidates, self.prepared.margins if tuning else self.survey(scenarios))
        return [
            self.judged(candidate, result, scenarios, row, tuning=tuning, margins=margins[row], constraints=constraints)
            for row, candidate in enumerate(candidates)
        ]

    def survey(
        self, scenarios: Sequence[Experiment | Scenario], experiment: Experiment | None = None
    ) -> MarginSurvey | None:
        """The machines of some scenarios beside the nominal one (`tuning.scoring.training_set.survey`)."""
        return survey(self.prepared.problem, scenarios, self._threads, experiment=experiment)

    def bounds(self, scenarios: Sequence[Scenario]) -> tuple[Constraint, ...]:
        """The constraints in other scenarios; the paper's controller, which bounds may refer to, is run there."""
        base = self.prepared.problem.paper_experiment
        with_paper = [replace(scenario, base=base) for scenario in scenarios]
        return bounds_in(self.prepared, self.run(None, with_paper), with_paper)

    def margins(
        self, candidates: Sequence[Candidate], machines: MarginSurvey | None, looked_at: Sequence[bool] | None = None
    ) -> list[Margins | None]:
        """The worst margins of candidates on some machines; ``None`` for those not looked at.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        problem, found = self.prepared.problem, list[Margins | None]([None] * len(candidates))
        chosen = [row for row in range(len(candidates)) if looked_at is None or looked_at[row]]
        if machines and chosen:
            began = clock.now()
            kinds = [statistic.margin for statistic in problem.margins]
            given = [candidates[row].point for row in chosen]
            values = [problem.space.parameters(point) if point else () for point in given]
            for row, worst in zip(chosen, machines.worst(values, kinds), strict=True):
                found[row] = worst
            self.margin_seconds += clock.now() - began
        return found

    def run(
        self,
        candidates: Sequence[Candidate] | None,
        scenarios: Sequence[Experiment | Scenario],
        *,
        to_the_end: bool = True,
    ) -> BatchResult:
        """The rollouts of candidates, a row each, in some scenarios; without candidates, those of the scenarios' own.

        Args:
            candidates: whose gains.
            scenarios: what is run.
            to_the_end: also where a rope is slack for long (`MOST_SLACK`), though the constraints forbid that.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        space = self.prepared.problem.space
        most_slack = None if to_the_end else self._most_slack
        began = clock.now()
        if candidates is None:
            result = run_pairs([], [[]], scenarios, self._threads)
        else:
            points = [space.parameters(candidate.point) for candidate in candidates]
            result = run_pairs(space.keys, points, scenarios, self._threads, most_slack)
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
        constraints: Sequence[Constraint] | None = None,
    ) -> Evaluation:
        """What a row of a result comes to for a candidate; in tuning with a margin (`Problem.margin`).

        The constraints are by default those of the tuning scenarios (`tuning.scoring.evaluation` has those of others).
        Stability margins that nobody has looked at have no value and violate nothing: such a candidate was given up, or
        failed a scenario.
        """
        problem, outcomes = self.prepared.problem, result.outcomes[row]
        done = outcomes == "completed"
        found = {statistic.name: over(statistic, result, row, scenarios) for statistic in problem.reported}
        if margins is not None:
            found |= {statistic.name: statistic.of(margins) for statistic in problem.margins}
        violations = {FAILED: float(1 - done.mean())}
        for constraint in self.prepared.constraints if constraints is None else constraints:
            margin, value = problem.margin(constraint) if tuning else 0.0, found.get(constraint.statistic.name)
            violation = 0.0 if value is None else constraint.violation(value, margin)
            violations[constraint.label] = max(violation, self._overwhelmed(constraint, result, scenarios, row))
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

    @staticmethod
    def _overwhelmed(
        constraint: Constraint, result: BatchResult, scenarios: Sequence[Experiment | Scenario], row: int
    ) -> float:
        """By how much a bound is exceeded in overwhelming scenarios beyond what may be there; -inf without any."""
        beyond = worst_of(row_of(result, row), [constraint], scenarios)[0, leeways(scenarios) > 0]
        return float(beyond[np.isfinite(beyond)].max(initial=-math.inf))


FIRST_SHARE, KEPT_SHARE = 0.5, 0.3
"""Share of the scenarios that all candidates see, and share of the candidates that see the rest: of sixteen five, in
six scenarios, which nearly fills two blocks of lanes."""

FEW = 8
"""So many candidates are not worth pruning: their scenarios fill few vector lanes."""

LEADERS, MOST_TRIED = 2, 6
"""Candidates of a call, the most promising of it, that meet the further hard scenarios at a time, and in all at most:
whoever leads without having met them is what a search would follow next."""

HOPELESS = 0.05
"""Share of a bound: candidates that exceed one by more meet no further scenarios."""

SURVEYED = 8
"""Every so many calls the one that leads meets all hard scenarios there are: others may have become the hardest."""

EXEMPT = ("paper", "start")
"""Origins of candidates that are never given up early: others are compared with them."""


class Evaluator(Scorer):
    """Evaluates the candidates of a search, call by call, and learns in which scenarios the best come off worst."""

    def __init__(self, prepared: TrainingSet, *, prune: bool = True, threads: int | None = None) -> None:
        """An evaluator.

        Args:
            prepared: gives scenarios, objectives and constraints.
            prune: whether hopeless candidates are given up after the first scenarios; never with several objectives.
            threads: default: one a core.
        """
        super().__init__(prepared, threads)
        problem = prepared.problem
        self._hardness, self._calls = ActiveScenarios(prepared), 0
        self._first = round(FIRST_SHARE * problem.scenarios) if prune and len(problem.objectives) == 1 else 0

    @property
    def for_the_best(self) -> tuple[Experiment | Scenario, ...]:
        """The tuning scenarios in which the best are tried at present, hard ones among them that others do not meet."""
        return (*self._hardness.everyones, *self._hardness.further)

    def evaluate(self, candidates: Sequence[Candidate]) -> list[Evaluation]:
        """Evaluate candidates in the tuning scenarios: the promising ones in further hard ones, one at times in all.

        Raises:
            KeyboardInterrupt: interrupted; nothing of this batch is kept.
        """
        if not self._first:
            return self.over(candidates, self.prepared.scenarios, tuning=True)
        everyones, further, rest = self._hardness.everyones, self._hardness.further, self._hardness.rest
        tried = self._tried(candidates, everyones)
        met = self._led(tried, everyones, further)
        self._calls += 1
        leader = penalised_first(tried.judged)[0] if met else None
        if rest and leader in met and self._calls % SURVEYED == 0:
            met = [leader]
            self._meet(tried, met, [*everyones, *further], rest)
        self._hardness.learn([tried.results[row] for row in met])
        return tried.judged

    def _led(
        self,
        tried: BatchEvaluation,
        everyones: Sequence[Experiment | Scenario],
        further: Sequence[Experiment | Scenario],
    ) -> list[int]:
        """The most promising meet the further hard scenarios, until the one that leads has met them; rows of those.

        Were only those to meet them that hold, whoever fails there would fall behind those that nobody has tried.
        """
        met: list[int] = []
        while further and len(met) < MOST_TRIED:
            order = penalised_first(tried.judged)
            if order[0] in met:
                break
            waiting = [row for row in order if row in tried.results and row not in met]
            rows = [row for row in waiting if tried.judged[row].violation <= HOPELESS][:LEADERS]
            if not rows:
                break
            self._meet(tried, rows, everyones, further)
            met += rows
        return met

    def _meet(
        self,
        tried: BatchEvaluation,
        rows: Sequence[int],
        before: Sequence[Experiment | Scenario],
        scenarios: Sequence[Experiment | Scenario],
    ) -> None:
        """Candidates of a call meet further scenarios, beside those that they have met before."""
        more = self.run([tried.candidates[row] for row in rows], scenarios, to_the_end=False)
        met = [*before, *scenarios]
        for number, row in enumerate(rows):
            candidate, margins = tried.candidates[row], tried.margins[row]
            tried.results[row] = result = joined(tried.results[row], more, number)
            tried.judged[row] = self.judged(candidate, result, met, tuning=True, margins=margins)

    def _tried(self, candidates: Sequence[Candidate], scenarios: Sequence[Experiment | Scenario]) -> BatchEvaluation:
        """What candidates come to, the hopeless given up after the first scenarios."""
        exempt = any(candidate.origin in EXEMPT for candidate in candidates)
        if len(candidates) <= FEW:
            result = self.run(candidates, scenarios, to_the_end=exempt)
            whole = {row: row_of(result, row) for row in range(len(candidates))}
            margins = self._margins_of(candidates, whole)
            judged = [
                self.judged(candidate, whole[row], scenarios, tuning=True, margins=margins[row])
                for row, candidate in enumerate(candidates)
            ]
            return BatchEvaluation(candidates, judged, whole, margins)
        first = scenarios[: self._first]
        early = self.run(candidates, first, to_the_end=exempt)
        judged = [
            self.judged(candidate, early, first, row, tuning=True, pruned=True)
            for row, candidate in enumerate(candidates)
        ]
        order = penalised_first(judged)
        kept = set(order[: math.ceil(KEPT_SHARE * len(order))])
        kept |= {index for index, candidate in enumerate(candidates) if candidate.origin in EXEMPT}
        late = self.run([candidates[index] for index in sorted(kept)], scenarios[self._first :], to_the_end=exempt)
        whole = {index: joined(row_of(early, index), late, row) for row, index in enumerate(sorted(kept))}
        margins = self._margins_of(candidates, whole)
        for index, result in whole.items():
            judged[index] = self.judged(candidates[index], result, scenarios, tuning=True, margins=margins[index])
        return BatchEvaluation(candidates, judged, whole, margins)

    def _margins_of(self, candidates: Sequence[Candidate], whole: dict[int, BatchResult]) -> list[Margins | None]:
        """Margins of the candidates that ran to the end in all scenarios."""
        completed = [
            index in whole and bool((whole[index].outcomes == "completed").all()) for index in range(len(candidates))
        ]
        return self.margins(candidates, self.prepared.margins, completed)
