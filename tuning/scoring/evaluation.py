"""Evaluate the candidates of a search in the training set and its cuts, and check the leader in fresh draws."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, zip_longest

import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis.margin_survey import MarginSurvey
from dualwinch.simulation.batch.authority import force_demands
from dualwinch.simulation.batch.workers import Workers, threads_of
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.results.outcomes import RunOutcomes, concatenated
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.problem import CHECKS
from dualwinch.tuning.scoring import clock
from dualwinch.tuning.scoring.cutting_set import CuttingSet, Place
from dualwinch.tuning.scoring.fresh_means import FreshMeans
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation, penalised_first
from dualwinch.tuning.scoring.rollouts import over, worst_of
from dualwinch.tuning.scoring.scorer import Margins, Scorer
from dualwinch.tuning.scoring.training_set import LARGEST_LAG, TrainingSet, beyond_authority_as_hard, with_authority
from dualwinch.tuning.space import Value

EXEMPT = ("paper", "start")
"""Origins of candidates that are always run in the cuts, because others are compared with them."""


@dataclass
class ArchiveEntry:
    """A candidate of the search, with its runs so far.

    Attributes:
        candidate: the candidate.
        evaluation: with all of its runs, and with the present back-off.
        runs: number of a draw or cut (`CuttingSet.scenarios`) → the run there; none if another process ran it.
        margins: worst stability margins so far; ``None``: not computed.
        version: of the survey of machines in whose active loops these are known; -1: of none.
        surveyed: the same for all of its loops.
        passed: whether it has passed a check; then it is not checked again.
        examined: whether the certificate has examined it.
    """

    candidate: Candidate
    evaluation: Evaluation
    runs: dict[int, RunOutcomes] = field(default_factory=dict)
    margins: Margins | None = None
    version: int = -1
    surveyed: int = -1
    passed: bool = False
    examined: bool = False

    @property
    def complete(self) -> bool:
        """Whether all of its runs were completed."""
        return self.evaluation.outcomes.keys() == {"completed"}


PointKey = tuple[tuple[str, Value], ...]


def point_key(candidate: Candidate) -> PointKey:
    """A candidate's point, hashable."""
    return tuple(sorted(candidate.point.items()))


def halving_rounds(candidates: int, scenarios: int) -> list[tuple[int, int]]:
    """Successive halving: candidates of each round, and scenarios in which they have been run after it.

    Example:
        >>> halving_rounds(16, 18)
        [(16, 2), (8, 4), (4, 9), (2, 18)]
    """
    halvings = max(0, int(math.log2(max(candidates, 1))) - 1)
    return [(candidates >> number, max(1, scenarios >> (halvings - number))) for number in range(halvings + 1)]


class Evaluator(Scorer):
    """Evaluates the candidates of a search batch by batch (steps 1 to 3 of `tuning.scoring.selection`).

    1. Compute the stability margins of all candidates of a batch in the active loops: they count in the race.
    2. Run all in few scenarios, half of them cuts, the better half in twice as many, and so on, the last two in all
       draws and cuts (successive halving; Jamieson and Talwalkar, AISTATS 2016).
    3. Bring the leader of all candidates so far up to date with the cuts, and check it in fresh draws and on fresh
       machines while checks are below their share of the rollouts. What violates a bound becomes a cut.

    Attributes:
        cutting: cuts, machines and back-off.
        archive: point → candidate of the search.
        check_rollouts: rollouts of checks.
        certified: the best certified candidate; ``None``: none so far.
        largest_batch: largest number of rollouts of a batch so far, the leader's and the check's included.
    """

    def __init__(self, training: TrainingSet, workers: Workers = None) -> None:
        super().__init__(training, workers)
        self.cutting, self.check_rollouts, self.largest_batch = CuttingSet(training), 0, 0
        self.certified: ArchiveEntry | None = None
        self.archive: dict[PointKey, ArchiveEntry] = {}
        self._checked_draws = 0

    def evaluate(self, candidates: Sequence[Candidate]) -> list[Evaluation]:
        """Evaluate a batch of candidates; an interrupt keeps nothing of it."""
        self.find_active_loops()
        before, single = self.rollouts, len(self.problem.objectives) == 1
        entries = [ArchiveEntry(each, Evaluation(each, (math.nan,), {}, {}, {}, 0, pruned=True)) for each in candidates]
        self._halve(entries) if single else self._examine(entries)
        self.archive |= {point_key(entry.candidate): entry for entry in entries}
        if self.problem.ensemble is not None and single:
            self._check()
        self.largest_batch = max(self.largest_batch, self.rollouts - before)
        return [entry.evaluation for entry in entries]

    def _halve(self, entries: Sequence[ArchiveEntry]) -> None:
        """Run a batch by successive halving: all in few scenarios, the better half in twice as many, and so on.

        The last two are run in all, and so are `EXEMPT` candidates.
        """
        exempt = [entry for entry in entries if entry.candidate.origin in EXEMPT]
        racing, numbers = list(entries), self._alternating()
        self._survey(racing)
        for (_, scenarios), (places, _) in pairwise(halving_rounds(len(entries), len(numbers))):
            self._run(racing, numbers[:scenarios])
            order = penalised_first([entry.evaluation for entry in racing], self.problem.options.penalty)
            racing = [racing[index] for index in order if racing[index].complete][:places]
        self._examine([*racing, *(entry for entry in exempt if entry not in racing)])

    def _alternating(self) -> list[int]:
        """Numbers of draws and cuts in turn, the cuts with the least slack at the last leader first."""
        draws, cuts = list(self.cutting.draws), self.cutting.by_slack
        both = zip_longest(draws, cuts)
        return [number for pair in both for number in pair if number is not None]

    def _examine(self, entries: Sequence[ArchiveEntry]) -> None:
        """Run candidates in all draws and cuts, and compute their margins unless these are known."""
        self._run(entries, list(self.cutting.scenarios))
        self._survey([entry for entry in entries if entry.complete and entry.version < self.cutting.version])
        self.refresh(entries)

    def _survey(self, entries: Sequence[ArchiveEntry]) -> None:
        """Compute margins of candidates in the active loops."""
        worst = self.margins([each.candidate for each in entries], self.cutting.survey, self.cutting.active)
        for entry, margins in zip(entries, worst, strict=True):
            entry.margins, entry.version = margins, self.cutting.version

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

    def _is_stale(self, entry: ArchiveEntry) -> bool:
        """Whether there are machines on which a candidate's margins are unknown."""
        return self.cutting.survey is not None and entry.complete and entry.version < self.cutting.version

    def leader(self) -> ArchiveEntry | None:
        """The best candidate by the exact penalty that the certificate has not examined, up to date with the cuts.

        The best so far is run in the draws and cuts that it lacks, and gets margins on machines that joined after it;
        if another is then better, that one is, and so on. Once a candidate is certified, only those with a smaller
        objective count. ``None``: there is none.
        """
        options, cutting = self.problem.options, self.cutting
        largest = self.certified.evaluation.costs[0] if self.certified else math.inf
        entries = [each for each in self.archive.values() if not each.examined and each.evaluation.costs[0] <= largest]
        while entries:
            order = penalised_first([entry.evaluation for entry in entries], options.penalty)
            entry = entries[order[0]]
            changed = [entry]
            if not entry.evaluation.pruned and self._is_stale(entry):
                complete = [entries[index] for index in order if not entries[index].evaluation.pruned]
                changed = [each for each in complete if self._is_stale(each)][: options.generation]
                self._survey(changed)
            elif any(number not in entry.runs for number in cutting.scenarios):
                self._run(changed, list(cutting.scenarios))
            elif cutting.survey is not None and entry.complete and entry.surveyed < cutting.version:
                self._survey_all(entry)
            else:
                return entry
            self.refresh(changed)
        return None

    def _survey_all(self, entry: ArchiveEntry) -> None:
        """Compute a candidate's margins in all loops of all training machines; the least ones become active loops."""
        if self.cutting.survey is not None and entry.complete:
            entry.margins = self._learn_loops(entry.candidate)
            entry.version = entry.surveyed = self.cutting.version

    def _learn_loops(self, candidate: Candidate) -> Margins:
        began, parameters = clock.now(), self.problem.space.parameters(candidate.point)
        margins = self.cutting.learn_loops(parameters, self._kinds)
        if self.cutting.survey:
            self.meter.margins.add(began, len(self.cutting.survey.machines))
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
        below = self.machines_below(leader, draws.scenarios, self.cutting.active_places)
        runs = self.run([leader.candidate], draws.scenarios, to_the_end=False)
        self.check_rollouts += len(draws.scenarios)
        means = FreshMeans(self, 1 - options.confidence, referring=False)
        means.add(runs, draws.scenarios)
        violating = self.learn(leader, draws, runs, means)
        leader.passed = not (below or violating or means.violated)

    def fresh(self, stream: str, first: int, count: int) -> "FreshDraws":
        """Draws of a random stream, those beyond the motors' authority marked as hard ones."""
        problem, began = self.problem, clock.now()
        draws = problem.drawn_ensemble.chosen(range(first, first + count), problem.stream(stream))
        demands = force_demands(draws)
        within = with_authority(demands, problem.options.authority)
        lags = np.array([demand.shortfall for demand in demands])
        self.meter.draws.add(began, count)
        return FreshDraws(beyond_authority_as_hard(draws, within), lags <= LARGEST_LAG)

    def learn(
        self, entry: ArchiveEntry, draws: "FreshDraws", runs: RunOutcomes, means: FreshMeans, *, back_off: bool = False
    ) -> int:
        """Make cuts and back-off of a candidate's runs in fresh draws.

        Args:
            entry: the candidate, up to date with the cuts.
            draws: in which it was run; those in which it falls far behind for lack of force are no cuts.
            runs: one row.
            means: bounds on means in these draws.
            back_off: whether bounds on the worst case get a back-off, as those on means do.

        Returns:
            The number of draws, of those that may become cuts, in which it violates a bound.
        """
        indices = np.flatnonzero(draws.learnable)
        scenarios, row = [draws.scenarios[index] for index in indices], runs.take(indices, axis=1)
        worst = worst_of(row, self.training.constraints)[0]
        violating = np.flatnonzero(worst > 0).tolist()
        constraints, statistics, fresh = self.training.constraints, entry.evaluation.statistics, means.violations
        if back_off:
            fresh |= {
                bound.label: bound.violation(over(bound.statistic, row, 0, scenarios))
                for bound in constraints
                if isinstance(bound.statistic, Statistic) and bound.statistic.kind == "worst"
            }
        in_training = [bound for bound in constraints if bound.label in fresh]
        training = {bound.label: bound.violation(statistics[bound.statistic.name]) for bound in in_training}
        self.cutting.learn_back_off(fresh, training)
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

    def machines_below(
        self, entry: ArchiveEntry, draws: Sequence[Scenario], places: Collection[Place] | None = None
    ) -> int:
        """Compute a candidate's margins on fresh machines; the worst one that violates a bound becomes a cut.

        Margins are computed at some operating points and amplitudes of each machine, by default at all.

        Returns:
            The number of machines that violate a bound on a margin.
        """
        problem, bounds = self.problem, [each for each in self.training.constraints if each.kind == "margin"]
        if not bounds or not draws:
            return 0
        began, parameters = clock.now(), problem.space.parameters(entry.candidate.point)
        threads, amplitudes = threads_of(self._workers), problem.margin_amplitudes
        survey = MarginSurvey(draws, problem.space.keys, threads, amplitudes=amplitudes)
        loops = None if places is None else survey.loops_at(places)
        (margins,) = survey.each([parameters], self._kinds, loops)
        self.meter.margins_in(loops).add(began, len(draws))
        violations = [
            max(bound.violation(bound.statistic.of(of)) for bound in bounds)  # type: ignore[union-attr]
            for of in margins
        ]
        numbers = np.unique(survey.loops[:, 0] if loops is None else survey.loops[loops, 0])
        worst = int(np.argmax(violations))
        if violations[worst] > 0:
            self.cutting.add_machine(draws[int(numbers[worst])])
            self._survey_all(entry)
            self.refresh([entry])
        return sum(violation > 0 for violation in violations)


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
