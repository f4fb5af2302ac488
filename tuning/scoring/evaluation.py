"""Evaluate the candidates of a search in the training set and its cuts, and check the leader in fresh draws."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis.margin_survey import MarginSurvey
from dualwinch.simulation.batch.authority import force_demands
from dualwinch.simulation.batch.workers import Workers, threads_of
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.results.outcomes import RunOutcomes, concatenated
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.problem import CHECKS
from dualwinch.tuning.scoring import clock
from dualwinch.tuning.scoring.cutting_set import CuttingSet
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation, penalised_first
from dualwinch.tuning.scoring.rollouts import over, worst_of
from dualwinch.tuning.scoring.scorer import Margins, Scorer
from dualwinch.tuning.scoring.training_set import LARGEST_LAG, TrainingSet, beyond_authority_as_hard, with_authority
from dualwinch.tuning.space import Value

EXEMPT = ("paper", "start")
"""Origins of candidates that are always run in the cuts, because others are compared with them."""

PARENTS = 0.5
"""Share of a generation from whose order CMA-ES learns; these are run in all draws, others in this share of them."""


@dataclass
class ArchiveEntry:
    """A candidate of the search, with its runs so far.

    Attributes:
        candidate: the candidate.
        evaluation: with all of its runs, and with the present back-off.
        runs: number of a draw or cut (`CuttingSet.scenarios`) → the run there; none if another process ran it.
        margins: worst stability margins so far; ``None``: not computed.
        version: of the survey of machines in all of whose loops these are known; -1: of none.
        passed: whether it has passed a check; then it is not checked again.
        rejected: whether the certificate has examined it.
    """

    candidate: Candidate
    evaluation: Evaluation
    runs: dict[int, RunOutcomes] = field(default_factory=dict)
    margins: Margins | None = None
    version: int = -1
    passed: bool = False
    rejected: bool = False

    @property
    def complete(self) -> bool:
        """Whether all of its runs were completed."""
        return self.evaluation.outcomes.keys() == {"completed"}


def _unknown(candidate: Candidate) -> Evaluation:
    """An evaluation of a candidate that has not been run."""
    return Evaluation(candidate, (math.nan,), {}, {}, {}, 0, pruned=True)


PointKey = tuple[tuple[str, Value], ...]


def point_key(candidate: Candidate) -> PointKey:
    """A candidate's point, hashable."""
    return tuple(sorted(candidate.point.items()))


class Evaluator(Scorer):
    """Evaluates the candidates of a search batch by batch (steps 1 to 3 of `tuning.scoring.selection`).

    1. Run all candidates of a batch in the first half of the random draws.
    2. Run the better half, from whose order CMA-ES learns, in the other half and in the cuts, and compute its stability
       margins in the active loops (successive halving with one rung; Jamieson and Talwalkar, AISTATS 2016).
    3. Bring the leader of all candidates so far up to date with the cuts, and check it in fresh draws and on fresh
       machines while checks are below their share of the rollouts. What violates a bound becomes a cut.

    Attributes:
        cutting: cuts, machines and back-off.
        archive: point → candidate of the search.
        check_rollouts: rollouts of checks.
        further_rollouts: rollouts besides those of the evaluations that were returned: of checks and leaders.
    """

    def __init__(self, training: TrainingSet, workers: Workers = None) -> None:
        super().__init__(training, workers)
        self.cutting, self.check_rollouts, self.further_rollouts = CuttingSet(training), 0, 0
        self.archive: dict[PointKey, ArchiveEntry] = {}
        self._checked_draws = 0

    def evaluate(self, candidates: Sequence[Candidate]) -> list[Evaluation]:
        """Evaluate a batch of candidates; an interrupt keeps nothing of it."""
        self.find_active_loops()
        before, numbers = self.rollouts, list(self.cutting.draws)
        halves = len(self.problem.objectives) == 1
        entries = [ArchiveEntry(candidate, _unknown(candidate)) for candidate in candidates]
        self._run(entries, numbers[: max(1, round(PARENTS * len(numbers)))] if halves else numbers)
        self._examine(entries, max(1, round(PARENTS * len(entries))) if halves else len(entries))
        self.archive |= {point_key(entry.candidate): entry for entry in entries}
        if self.problem.ensemble is not None and halves:
            self._check()
        evaluations = [entry.evaluation for entry in entries]
        self.further_rollouts += self.rollouts - before - sum(evaluation.scenarios for evaluation in evaluations)
        return evaluations

    def _examine(self, entries: Sequence[ArchiveEntry], count: int) -> None:
        """Run the best of a batch in all draws and cuts, and compute their margins."""
        order = penalised_first([entry.evaluation for entry in entries], self.problem.options.penalty)
        better = [index for index in order if entries[index].complete][:count]
        exempt = [index for index, entry in enumerate(entries) if entry.candidate.origin in EXEMPT]
        examined = [entries[index] for index in sorted({*better, *exempt})]
        self._run(examined, list(self.cutting.scenarios))
        surveyed = [entry for entry in examined if entry.complete]
        worst = self.margins([each.candidate for each in surveyed], self.cutting.survey, self.cutting.active)
        for entry, margins in zip(surveyed, worst, strict=True):
            entry.margins = margins
        self.refresh(examined)

    def _run(self, entries: Sequence[ArchiveEntry], numbers: Sequence[int]) -> None:
        """Run candidates in those of some scenarios in which they have not been run."""
        exempt = any(entry.candidate.origin in EXEMPT for entry in entries)
        lacking: dict[tuple[int, ...], list[ArchiveEntry]] = {}
        for entry in entries:
            lacking.setdefault(tuple(number for number in numbers if number not in entry.runs), []).append(entry)
        for group, members in lacking.items():
            if group:
                scenarios = [self.cutting.scenarios[number] for number in group]
                result = self.run([entry.candidate for entry in members], scenarios, to_the_end=exempt)
                for row, entry in enumerate(members):
                    mine = result.take([row], axis=0)
                    entry.runs |= {number: mine.take([column], axis=1) for column, number in enumerate(group)}
        self.refresh(entries)

    def refresh(self, entries: Sequence[ArchiveEntry]) -> None:
        """Evaluate candidates again from their runs and margins, with the present cuts and back-off."""
        scenarios, back_off = self.cutting.scenarios, self.cutting.back_off
        for entry in entries:
            number, numbers = entry.evaluation.number, [each for each in scenarios if each in entry.runs]
            if not numbers:  # of another process
                evaluation = self.with_margins(entry.evaluation, entry.margins, self.training.constraints, back_off)
            else:
                evaluation = self.evaluation(
                    entry.candidate,
                    concatenated([entry.runs[each] for each in numbers]),
                    [scenarios[each] for each in numbers],
                    pruned=len(numbers) < len(scenarios),
                    margins=entry.margins,
                    back_off=back_off,
                )
            entry.evaluation = replace(evaluation, number=number)

    def _is_current(self, entry: ArchiveEntry) -> bool:
        """Whether a candidate has been run in all cuts, and its margins are known on all machines."""
        cutting = self.cutting
        is_run = all(number in entry.runs for number in cutting.scenarios)
        return is_run and (cutting.survey is None or not entry.complete or entry.version == cutting.version)

    def leader(self) -> ArchiveEntry | None:
        """The best candidate by the exact penalty that the certificate has not rejected, up to date with the cuts.

        The best one so far is run in the cuts that it lacks; if another is then better, that one is, and so on.
        ``None``: there is no other candidate.
        """
        entries = [entry for entry in self.archive.values() if not entry.rejected]
        while entries:
            order = penalised_first([entry.evaluation for entry in entries], self.problem.options.penalty)
            entry = entries[order[0]]
            if self._is_current(entry):
                return entry
            self._run([entry], list(self.cutting.scenarios))
            self._survey_all(entry)
            self.refresh([entry])
        return None

    def _survey_all(self, entry: ArchiveEntry) -> None:
        """Compute a candidate's margins in all loops of all training machines; the least ones become active loops."""
        if self.cutting.survey is not None and entry.complete:
            entry.margins, entry.version = self._learn_loops(entry.candidate), self.cutting.version

    def _learn_loops(self, candidate: Candidate) -> Margins:
        began, parameters = clock.now(), self.problem.space.parameters(candidate.point)
        margins = self.cutting.learn_loops(parameters, self._kinds)
        self.meter.count_margins(began, len(self.cutting.survey.machines) if self.cutting.survey else 0)
        return margins

    def find_active_loops(self) -> None:
        """Find the loops with the start's least margins, in which the margins of candidates are computed."""
        if self.cutting.survey is not None and self.cutting.active is None:
            self._learn_loops(Candidate(self.problem.start, "start"))

    def _check(self) -> None:
        """Check the leader in fresh draws and on fresh machines, if there are rollouts for it."""
        options = self.problem.options
        if self.check_rollouts + options.chunk > options.check_share * self.rollouts:
            return
        leader = self.leader()
        if leader is None or not leader.complete or leader.passed:
            return
        draws = self.fresh(CHECKS, self._checked_draws, options.chunk)
        self._checked_draws += options.chunk
        below = self.machines_below(leader, draws.scenarios[: options.machines_checked], lower=True)
        runs = self.run([leader.candidate], draws.scenarios, to_the_end=False)
        self.check_rollouts += len(draws.scenarios)
        constraints = [each if not asked.reference else None for asked, each in self._pairs]
        violations = self.learn(leader, draws, runs, constraints, lower=True)
        leader.passed = not (below or violations)

    @property
    def _pairs(self) -> list[tuple[Constraint, Constraint]]:
        """The problem's constraints, each with the one with its bound as a number in training."""
        return list(zip(self.problem.constraints, self.training.constraints, strict=True))

    def fresh(self, stream: str, first: int, count: int) -> "FreshDraws":
        """Draws of a random stream, those beyond the motors' authority marked as hard ones."""
        problem = self.problem
        draws = problem.drawn_ensemble.chosen(range(first, first + count), problem.stream(stream))
        demands = force_demands(draws)
        within = with_authority(demands, problem.options.authority)
        lags = np.array([demand.shortfall for demand in demands])
        return FreshDraws(beyond_authority_as_hard(draws, within), lags <= LARGEST_LAG)

    def learn(
        self,
        entry: ArchiveEntry,
        draws: "FreshDraws",
        runs: RunOutcomes,
        constraints: Sequence[Constraint | None],
        *,
        lower: bool,
    ) -> int:
        """Make cuts and back-off of the runs of a candidate, up to date with the cuts, in fresh draws.

        Args:
            entry: the candidate.
            draws: in which it was run; those in which it falls far behind for lack of force are no cuts.
            runs: one row.
            constraints: of the problem, with bounds as numbers in these draws; ``None``: not evaluated.
            lower: as in `CuttingSet.learn_back_off`.

        Returns:
            The number of draws, of those that may become cuts, in which it violates a bound.
        """
        evaluated = [each for each in constraints if each is not None and each.kind != "margin"]
        indices = np.flatnonzero(draws.learnable)
        scenarios, row = [draws.scenarios[index] for index in indices], runs.take(indices, axis=1)
        worst = worst_of(row, evaluated)[0]
        violating = np.flatnonzero(worst > 0).tolist()
        fresh, training = dict[str, float](), dict[str, float]()
        for (_, trained), constraint in zip(self._pairs, constraints, strict=True):
            if constraint in evaluated and constraint is not None and isinstance(constraint.statistic, Statistic):
                fresh[trained.label] = constraint.violation(over(constraint.statistic, row, 0, scenarios))
                training[trained.label] = trained.violation(entry.evaluation.statistics[trained.statistic.name])
        self.cutting.learn_back_off(fresh, training, lower=lower)
        cuts = [replace(scenarios[index], hard=True) for index in violating]
        numbers = self.cutting.add_draws(cuts, worst[violating])
        entry.runs |= {number: row.take([violating[index]], axis=1) for number, index in numbers.items()}
        self.cutting.drop_draws(
            {number: float(worst_of(run, self.training.constraints)[0, 0]) for number, run in entry.runs.items()}
        )
        self.refresh([entry])
        self._keep_off()
        return len(violating)

    def _keep_off(self) -> None:
        """Apply the present back-off to all candidates of the archive."""
        constraints, back_off = self.training.constraints, self.cutting.back_off
        for entry in self.archive.values():
            entry.evaluation = self.with_margins(entry.evaluation, entry.margins, constraints, back_off)

    def machines_below(self, entry: ArchiveEntry, draws: Sequence[Scenario], *, lower: bool) -> int:
        """Compute a candidate's margins on fresh machines; the worst one that violates a bound becomes a cut.

        Returns:
            The number of machines that violate a bound on a margin.
        """
        problem, bounds = self.problem, [each for each in self.training.constraints if each.kind == "margin"]
        if not bounds or not draws:
            return 0
        began, parameters = clock.now(), problem.space.parameters(entry.candidate.point)
        threads, amplitudes = threads_of(self._workers), problem.margin_amplitudes
        machines = MarginSurvey(draws, problem.space.keys, threads, amplitudes=amplitudes)
        (margins,) = machines.each([parameters], self._kinds)
        self.meter.count_margins(began, len(draws))
        violations = np.array(
            [[bound.violation(bound.statistic.of(of)) for bound in bounds] for of in margins]  # type: ignore[union-attr]
        )
        worst, statistics = violations.max(axis=1), entry.evaluation.statistics
        largest = dict(zip((bound.label for bound in bounds), violations.max(axis=0).tolist(), strict=True))
        # an unstable loop has a violation of 1, which says nothing of how far it is from a stable one; in a check, the
        # machine as a cut is enough
        fresh = {label: violation for label, violation in largest.items() if violation < 1}
        training = {bound.label: bound.violation(statistics.get(bound.statistic.name, math.nan)) for bound in bounds}
        if not lower:
            self.cutting.learn_back_off(fresh, training, lower=False)
        if (worst > 0).any():
            self.cutting.add_machine(draws[int(worst.argmax())])
        self._keep_off()
        return int((worst > 0).sum())


@dataclass(frozen=True)
class FreshDraws:
    """Fresh draws of an ensemble.

    Attributes:
        scenarios: the draws.
        learnable: (n,) whether the vehicle can keep up in a draw, so that gains decide whether it violates a bound.
    """

    scenarios: list[Scenario]
    learnable: NDArray[np.bool_]

    @classmethod
    def none(cls) -> "FreshDraws":
        """No draws."""
        return cls([], np.zeros(0, bool))

    def joined(self, more: "FreshDraws") -> "FreshDraws":
        """These draws and more."""
        learnable = np.concatenate([self.learnable, more.learnable])
        return FreshDraws([*self.scenarios, *more.scenarios], learnable)
