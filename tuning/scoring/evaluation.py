"""Evaluate candidates: rollouts in scenarios, objectives, constraint violations and early pruning.

A batch of candidates of the search is evaluated by successive halving over scenarios (Jamieson and Talwalkar,
Non-stochastic Best Arm Identification and Hyperparameter Optimization, AISTATS 2016), in the order of an exact penalty:

1. Run all candidates in the first share of the common scenarios, and compute objective and violations of each.
2. Run one in η in the rest; prune the others.
3. Run one in η of these in the pool of active scenarios, and then the next ones until the leader has been run there.
4. Every few batches, run the leader in all hard scenarios. Update the pool with the results (`ActiveScenarios`).
5. Compute stability margins of the promising candidates in the active loops (`ActiveLoops`), and in all loops for the
   start and for a feasible leader that improves on the best so far.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis.margin_survey import VALUE, MarginSurvey, WorstMargin
from dualwinch.analysis.resonance import RESONANCE
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.batch.workers import Workers
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.progress import Progress, no_progress
from dualwinch.simulation.results.outcomes import RunOutcomes, concatenated
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.scoring import clock
from dualwinch.tuning.scoring.progress import NO_PROGRESS, TuningProgress
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation, penalised_first
from dualwinch.tuning.scoring.rollouts import keeps_tight, over, run_pairs, worst_of
from dualwinch.tuning.scoring.training_set import ActiveLoops, ActiveScenarios, TrainingSet, survey
from dualwinch.tuning.selection_config import SampleSizes


def bounds_in(
    training: TrainingSet, paper: BatchResult, scenarios: Sequence[Experiment | Scenario]
) -> tuple[Constraint, ...]:
    """The constraints of a problem in other scenarios, with factors applied to the paper's statistics there.

    `paper` are runs of the baseline controller in these, one row. Factors on its stability margins remain applied to
    those on the training set's machines.
    """
    return tuple(
        constraint.given(over(constraint.statistic, paper, 0, scenarios))
        if constraint.of_paper and isinstance(constraint.statistic, Statistic)
        else known
        for constraint, known in zip(training.problem.constraints, training.constraints, strict=True)
    )


Margins = dict[str, WorstMargin]
"""Kind of a stability margin → the worst over several machines."""


@dataclass
class BatchEvaluation:
    """A batch of candidates under evaluation.

    Attributes:
        candidates: of the batch.
        evaluations: current evaluation of each candidate.
        results: row of a candidate that is not pruned → its runs so far.
        margins: stability margins of each candidate; ``None``: not computed.
        surveyed: rows of the candidates with margins known in all loops.
    """

    candidates: Sequence[Candidate]
    evaluations: list[Evaluation]
    results: dict[int, RunOutcomes]
    margins: list[Margins | None]
    surveyed: set[int]


FAILED = "scenarios not completed <= 0"
"""Constraint that every scenario is completed; its violation is the share of incomplete ones."""


class Scorer:
    """Runs candidates of a problem in scenarios, evaluates them, and counts rollouts and time.

    Attributes:
        training: the problem with its training scenarios.
        rollouts: number of rollouts so far.
        seconds: their wall time in s.
        margin_seconds: wall time in s of stability margins.
        surveyed: number of machines on which a controller's margins were computed in all loops so far.
        until: end of validation and test, by `clock.without_compiling`; ``None``: without limit.
        watch: shows the steps of validation and test.
    """

    until: float | None = None
    watch: TuningProgress = NO_PROGRESS

    def __init__(self, training: TrainingSet, workers: Workers = None) -> None:
        self.training = training
        self.rollouts, self.seconds, self.margin_seconds, self.surveyed = 0, 0.0, 0.0, 0
        self._whole_seconds = 0.0
        self._report: Progress = no_progress
        self._step = (0, 1)
        self._workers, self._units = workers, training.problem.units
        self._kinds = [statistic.margin for statistic in training.problem.margins]
        self._max_slack = training.problem.selection.max_slack if keeps_tight(training.constraints) else None

    @property
    def pace(self) -> float:
        """Mean wall time of a rollout in s; 0 before the first."""
        return self.seconds / self.rollouts if self.rollouts else 0.0

    @property
    def margin_pace(self) -> float:
        """Mean wall time in s of a controller's margins in all loops of a machine; 0 before the first."""
        return self._whole_seconds / self.surveyed if self.surveyed else 0.0

    def affordable(self, sizes: SampleSizes) -> SampleSizes:
        """The largest share of given sizes for which there is time."""
        if self.until is None:
            return sizes
        left, paces = self.until - clock.without_compiling(), (self.pace, self.margin_pace)
        return self.training.problem.selection.affordable(sizes, left, *paces)

    def affords(self, sizes: SampleSizes) -> bool:
        """Whether there is time for given sizes."""
        return self.affordable(sizes) == sizes

    def step(self, words: str, runs: int, status: str = "") -> None:
        """Begin a step of validation or test with at most `runs` rollouts; `watch` gets the share that is done.

        The words and the status are as in `TuningProgress.step`.
        """
        self._report, self._step = self.watch.step(words, status), (self.rollouts, max(runs, 1))

    def start(self) -> Evaluation:
        """Evaluate the start on the training set, from the rollouts of `prepare`."""
        training = self.training
        candidate = Candidate(training.problem.start, "start")
        margins = self.margins([candidate], training.margins)[0]
        return self.evaluation(candidate, training.start, training.scenarios, training=True, margins=margins)

    def over(
        self,
        candidates: Sequence[Candidate],
        scenarios: Sequence[Experiment | Scenario],
        *,
        training: bool = False,
        constraints: Sequence[Constraint] | None = None,
        machines: MarginSurvey | None = None,
    ) -> list[Evaluation]:
        """Evaluate candidates in all of the scenarios; arguments as in `evaluation`.

        Margins are computed on the machines of the scenarios, unless other machines are given.
        """
        if not candidates:
            return []
        result = self.run(candidates, scenarios)
        known = self.training.margins if training else machines
        margins = self.margins(candidates, known or self.survey(scenarios))
        return [
            self.evaluation(
                candidate, result, scenarios, row, training=training, margins=margins[row], constraints=constraints
            )
            for row, candidate in enumerate(candidates)
        ]

    def survey(
        self, scenarios: Sequence[Experiment | Scenario], experiment: Experiment | None = None
    ) -> MarginSurvey | None:
        """The nominal machine and those of the scenarios, for margins (`tuning.scoring.training_set.survey`)."""
        return survey(self.training.problem, scenarios, self._workers, experiment=experiment)

    def bounds(self, scenarios: Sequence[Scenario]) -> tuple[Constraint, ...]:
        """The constraints in other scenarios; runs the paper's controller there, to which bounds may refer."""
        base = self.training.problem.paper_experiment
        with_paper = [replace(scenario, base=base) for scenario in scenarios]
        return bounds_in(self.training, self.run(None, with_paper), with_paper)

    def margins(
        self,
        candidates: Sequence[Candidate],
        machines: MarginSurvey | None,
        chosen: Sequence[bool] | None = None,
        loops: NDArray[np.intp] | None = None,
    ) -> list[Margins | None]:
        """Compute the worst margins of candidates on given machines; ``None`` where no margin is bounded.

        `chosen` is a mask of the candidates to compute; the others get ``None``. `loops` are indices of the survey's
        loops, by default all.
        """
        problem, found = self.training.problem, list[Margins | None]([None] * len(candidates))
        rows = [row for row in range(len(candidates)) if chosen is None or chosen[row]]
        if machines and rows:
            began = clock.now()
            points = [candidates[row].point for row in rows]
            values = [problem.space.parameters(point) if point else () for point in points]
            for row, worst in zip(rows, machines.worst(values, self._kinds, loops), strict=True):
                found[row] = worst
            self._count_margins(began, len(rows) * len(machines.machines) if loops is None else 0)
        return found

    def _count_margins(self, began: float, machines: int) -> None:
        """Count the time since `began`, spent on margins in all loops of `machines` machines (0: in some loops)."""
        seconds = clock.now() - began
        self.margin_seconds, self.surveyed = self.margin_seconds + seconds, self.surveyed + machines
        self._whole_seconds += seconds if machines else 0.0

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
        space = self.training.problem.space
        max_slack = None if to_the_end else self._max_slack
        began, (first, runs) = clock.now(), self._step
        size = len(scenarios) * (1 if candidates is None else len(candidates))

        def progress(share: float) -> None:
            self._report(min(1.0, (self.rollouts - first + share * size) / runs))

        if candidates is None:
            result = run_pairs([], [[]], scenarios, self._workers, progress=progress)
        else:
            points = [space.parameters(candidate.point) for candidate in candidates]
            result = run_pairs(space.keys, points, scenarios, self._workers, max_slack, progress)
        self.seconds += clock.now() - began
        self.rollouts += result.outcomes.size
        return result

    def evaluation(
        self,
        candidate: Candidate,
        result: RunOutcomes,
        scenarios: Sequence[Experiment | Scenario],
        row: int = 0,
        *,
        training: bool = False,
        pruned: bool = False,
        margins: Margins | None = None,
        constraints: Sequence[Constraint] | None = None,
    ) -> Evaluation:
        """Evaluate a candidate from a row of a result; in training with back-off (`TuningProblem.margin`).

        Default constraints are those of the training set (`bounds_in` gives those of other sets). Stability margins
        that were not computed have no value and no violation: such a candidate was pruned, or failed a scenario.
        """
        problem, outcomes = self.training.problem, result.outcomes[row]
        done = outcomes == "completed"
        found = {statistic.name: over(statistic, result, row, scenarios) for statistic in problem.reported}
        violations = {FAILED: float(1 - done.mean())}
        bounds = self.training.constraints if constraints is None else constraints
        for constraint in bounds:
            margin, value = problem.margin(constraint) if training else 0.0, found.get(constraint.statistic.name)
            violations[constraint.label] = 0.0 if value is None else constraint.violation(value, margin)
        evaluation = Evaluation(
            candidate=candidate,
            objectives=tuple(found[statistic.name] for statistic in problem.objectives),
            violations=violations,
            statistics=found,
            outcomes=dict(Counter(outcomes.tolist())),
            scenarios=len(outcomes),
            pruned=pruned,
            violated=int((worst_of(result.take([row], axis=0), bounds) > 0).sum()),
            units=self._units,
        )
        return evaluation if margins is None else self.with_margins(evaluation, margins, bounds, training=training)

    def with_margins(
        self, evaluation: Evaluation, margins: Margins, bounds: Sequence[Constraint], *, training: bool
    ) -> Evaluation:
        """An evaluation with stability margins and their violations added."""
        problem, violations = self.training.problem, dict(evaluation.violations)
        found = {statistic.name: statistic.of(margins) for statistic in problem.margins}
        for constraint in bounds:
            if constraint.statistic.name in found:
                back_off = problem.margin(constraint) if training else 0.0
                violations[constraint.label] = constraint.violation(found[constraint.statistic.name], back_off)
        return replace(evaluation, statistics=evaluation.statistics | found, violations=violations)


EXEMPT = ("paper", "start")
"""Origins of candidates that are never pruned, because others are compared with them."""


class Evaluator(Scorer):
    """Evaluates the candidates of a search batch by batch, with a pool of active scenarios.

    Poor candidates are pruned after the first scenarios, unless there are several objectives or `prune` is false.
    """

    def __init__(self, training: TrainingSet, *, prune: bool = True, workers: Workers = None) -> None:
        super().__init__(training, workers)
        problem = training.problem
        self._config, self._pool, self._batches = problem.selection, ActiveScenarios(training), 0
        prunes = prune and len(problem.objectives) == 1
        self._first = round(self._config.first_share * problem.scenarios) if prunes else 0
        self._best: Evaluation | None = None

    def evaluate(self, candidates: Sequence[Candidate]) -> list[Evaluation]:
        """Evaluate a batch of candidates in the training scenarios; an interrupt keeps nothing of it."""
        if not self._first:
            return self.over(candidates, self.training.scenarios, training=True)
        common, active, inactive = self._pool.common, self._pool.active, self._pool.inactive
        batch = self._in_common(candidates, common)
        rows = self._in_active(batch, common, active)
        self._survey_leaders(batch)
        self._batches += 1
        leader = penalised_first(batch.evaluations)[0] if rows else None
        if inactive and leader in rows and self._batches % self._config.pool_review == 0:
            rows = [leader]
            self._in_further(batch, rows, [*common, *active], inactive)
        self._pool.learn([batch.results[row] for row in rows])
        candidates_of = [*([self._best] if self._best else []), *batch.evaluations]
        self._best = candidates_of[penalised_first(candidates_of)[0]]
        return batch.evaluations

    def _promoted(self, count: int) -> int:
        """Number of a rung's candidates that are run in the scenarios of the next, at least one."""
        return max(1, round(count / self._config.eta))

    def time_of_search(self, search: float) -> float:
        """Time in s for the search, given the duration of margins (`SelectionConfig.time_of_search`)."""
        if self.until is None:
            return search
        margin_pace = self.margin_pace if self.active_loops else 0.0  # `active_loops` has computed the start's
        left = self.until - clock.without_compiling()
        return self._config.time_of_search(search, left, self.training.pace, margin_pace)

    @cached_property
    def active_loops(self) -> ActiveLoops | None:
        """Pool of active loops, initialised with the start's margins; ``None`` if no margin of a loop is bounded."""
        surveyed, kinds = self.training.margins, [kind for kind in self._kinds if kind != RESONANCE]
        if surveyed is None or not kinds:
            return None
        pool, problem = ActiveLoops(surveyed, kinds, self._config), self.training.problem
        began = clock.now()
        pool.learn(surveyed.of_loops([problem.space.parameters(problem.start)], kinds)[0])
        self._count_margins(began, len(surveyed.machines))
        return pool

    def _survey_leaders(self, batch: BatchEvaluation) -> None:
        """Compute the margins in all loops of each feasible leader that improves on the best.

        Those of an infeasible leader are computed every `pool_review` batches.
        """
        review = self._batches % self._config.pool_review == 0
        for _ in range(self._config.most_leaders):
            leader = penalised_first(batch.evaluations)[0]
            found = batch.evaluations[leader]
            improves = self._best is None or penalised_first([self._best, found])[0] == 1
            waits = leader not in batch.surveyed and batch.margins[leader] is not None
            if not (waits and improves and (found.feasible or review)):
                break
            self._survey_all(batch, leader)

    def _survey_all(self, batch: BatchEvaluation, row: int) -> None:
        """Compute the margins of a candidate in all loops, and update the pool with them."""
        surveyed, pool, known = self.training.margins, self.active_loops, batch.margins[row]
        batch.surveyed.add(row)
        if surveyed is None or pool is None or known is None:
            return
        began, space = clock.now(), self.training.problem.space
        (found,) = surveyed.of_loops([space.parameters(batch.candidates[row].point)], self._kinds)
        pool.learn(found)
        batch.margins[row] = worst = known | {
            kind: min((of_loop[kind] for of_loop in found), key=VALUE) for kind in found[0]
        }
        self._count_margins(began, len(surveyed.machines))
        bounds = self.training.constraints
        batch.evaluations[row] = self.with_margins(batch.evaluations[row], worst, bounds, training=True)

    def _in_active(
        self, batch: BatchEvaluation, common: Sequence[Experiment | Scenario], active: Sequence[Experiment | Scenario]
    ) -> list[int]:
        """Run the best candidates in the active scenarios until the leader has been run there; return their rows.

        Slightly infeasible ones are run there too: else a feasible one that fails there would rank behind them.
        """
        done: list[int] = []
        while active and len(done) < self._config.most_leaders:
            order = penalised_first(batch.evaluations)
            if order[0] in done:
                break
            waiting = [row for row in order if row in batch.results and row not in done]
            promising = [row for row in waiting if batch.evaluations[row].violation <= self._config.hopeless]
            rows = promising[: self._promoted(len(batch.results))]
            if not rows:
                break
            self._in_further(batch, rows, common, active)
            done += rows
        return done

    def _in_further(
        self,
        batch: BatchEvaluation,
        rows: Sequence[int],
        before: Sequence[Experiment | Scenario],
        scenarios: Sequence[Experiment | Scenario],
    ) -> None:
        """Run candidates of a batch in scenarios in addition to those before."""
        more = self.run([batch.candidates[row] for row in rows], scenarios, to_the_end=False)
        together = [*before, *scenarios]
        for number, row in enumerate(rows):
            candidate, margins = batch.candidates[row], batch.margins[row]
            batch.results[row] = result = concatenated([batch.results[row], more.take([number], axis=0)])
            batch.evaluations[row] = self.evaluation(candidate, result, together, training=True, margins=margins)

    def _in_common(
        self, candidates: Sequence[Candidate], scenarios: Sequence[Experiment | Scenario]
    ) -> BatchEvaluation:
        """Run candidates in the common scenarios; in a large batch, prune the worst after the first share of them."""
        exempt = {row for row, candidate in enumerate(candidates) if candidate.origin in EXEMPT}
        first = scenarios if len(candidates) <= self._config.prune_above else scenarios[: self._first]
        prunes = len(first) < len(scenarios)
        early = self.run(candidates, first, to_the_end=bool(exempt))
        whole: dict[int, RunOutcomes] = {row: early.take([row], axis=0) for row in range(len(candidates))}
        found = list[Evaluation]()
        if prunes:
            found = [
                self.evaluation(candidate, early, first, row, training=True, pruned=True)
                for row, candidate in enumerate(candidates)
            ]
            order = penalised_first(found)
            rows = sorted({*order[: self._promoted(len(order))], *exempt})
            late = self.run([candidates[row] for row in rows], scenarios[self._first :], to_the_end=bool(exempt))
            whole = {row: concatenated([whole[row], late.take([number], axis=0)]) for number, row in enumerate(rows)}
        evaluations = {
            row: self.evaluation(candidates[row], result, scenarios, training=True) for row, result in whole.items()
        }
        promising = [
            row in exempt or (row in evaluations and evaluations[row].violation <= self._config.hopeless)
            for row in range(len(candidates))
        ]
        chosen = [
            row in whole and promising[row] and bool((whole[row].outcomes == "completed").all())
            for row in range(len(candidates))
        ]
        pool = self.active_loops if any(chosen) else None
        margins = self.margins(candidates, self.training.margins, chosen, pool and pool.indices)
        bounds = self.training.constraints
        for row, evaluation in evaluations.items():
            if worst := margins[row]:
                evaluations[row] = self.with_margins(evaluation, worst, bounds, training=True)
        together = [evaluations.get(row) or found[row] for row in range(len(candidates))]
        batch = BatchEvaluation(candidates, together, whole, margins, set())
        for row in exempt:
            self._survey_all(batch, row)
        return batch
