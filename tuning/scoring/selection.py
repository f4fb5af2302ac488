"""The method of tuning: sample average, cutting set, certificate.

1. **Training set** (`tuning.scoring.training_set`): the sample average over random draws with common random numbers
   (Shapiro, Dentcheva and Ruszczyński, Lectures on Stochastic Programming, 2009, Chapter 5) gives means and worst
   cases; the draws of many that demand the most force are the first cuts (importance sampling); stability margins are
   those of the nominal machine and of two drawn ones. Draws that demand nearly all of the motors' force, or more, count
   towards worst cases only.
2. **Search** (`tuning.optimisers`): CMA-ES (Hansen, arXiv:1604.00772) on an exact penalty function, the objective's
   logarithm plus the sum of violations times a penalty (Nocedal and Wright, Numerical Optimization, 2006, Section
   17.2).
3. **Check** (`tuning.scoring.evaluation`, `tuning.scoring.cutting_set`): the leader, feasible or not, is run in fresh
   draws and on fresh machines while checks are below a share of the rollouts (cutting-set method with a pessimising
   oracle by sampling; Mutapcic and Boyd, Optimization Methods and Software 24, 2009). Draws and machines in which it
   violates a bound join the training set.
4. **Certificate** (`tuning.scoring.certificate`): leaders in order; each first on fresh machines, for its margins,
   then in fresh draws until they support ε or make it unlikely (sequential probabilistic validation; Alamo, Tempo,
   Luque and Ramirez, Automatica 52, 2015). Means must keep their bounds there, too (`tuning.scoring.fresh_means`). A
   rejection, or an end of the budget before a decision, makes cuts and a back-off of violated bounds, which reorder the
   other candidates; the start is one of them. Leaders that have passed a check are examined during the search, while
   certificates are below a share of the rollouts; later ones only if their objective is smaller than that of the
   certified one. At the end the last leader is examined; after a rejection the search goes on while its budget, an
   eighth larger if nothing is certified, allows another certificate. If no candidate
   passes, the one with the least supported probability of a violation among those that beat the start, by the exact
   penalty on their shares of violations, is selected.
5. **Test set** (`tuning.scoring.test_set`): evaluated once, for the selected candidate, the start and the baseline
   controller; reported with intervals, never fed back.

Without an ensemble, the best feasible trial in the experiment is selected. Parameters: `TuningOptions`.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.results.outcomes import RunOutcomes, concatenated
from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.options import TuningOptions
from dualwinch.tuning.problem import CERTIFICATE, TEST
from dualwinch.tuning.scoring.budget import CERTIFICATE_SHARE, SelectionBudget
from dualwinch.tuning.scoring.certificate import SampleCertificate, clopper_pearson
from dualwinch.tuning.scoring.evaluation import ArchiveEntry, Evaluator, FreshDraws, PointKey, point_key
from dualwinch.tuning.scoring.fresh_means import FreshMeans
from dualwinch.tuning.scoring.progress import CERTIFYING, NO_PROGRESS, SCORING, TuningProgress
from dualwinch.tuning.scoring.ranking import (
    Candidate,
    Evaluation,
    feasibility_first,
    improves_on,
    merit,
    penalised_first,
)
from dualwinch.tuning.scoring.rollouts import worst_of
from dualwinch.tuning.scoring.test_set import ControllerScore, SelectionResult, TestSet

NOT_CHOSEN = "no trial is better than the gains that the search started from"
NONE_BEFORE = "no trial ranks before it, by objective and violated bounds, in the training set"
LESS_VIOLATION = "in the test set the start violates bounds by less"
LESS_ERROR = "in the test set the start is no worse"
MORE_VIOLATIONS = "in the test set more scenarios violate a bound than the fresh draws support"


@dataclass(frozen=True)
class Examination:
    """A candidate with what fresh machines and draws say of it.

    Attributes:
        entry: the candidate.
        certificate: of its fresh draws and machines.
        penalty: on a violation, or a share of violations, of 1.
    """

    entry: ArchiveEntry
    certificate: SampleCertificate
    penalty: float

    @property
    def merit(self) -> float:
        """Exact penalty function with the shares of draws and machines that violate a bound in place of violations."""
        evaluation, certificate = self.entry.evaluation, self.certificate
        shares = {
            "draws": certificate.violations / max(certificate.draws, 1),
            "machines": certificate.machines_below / max(certificate.machines, 1),
        }
        return merit(replace(evaluation, violations={**shares, **certificate.means}), self.penalty)


def nothing() -> None:
    """No further generation."""


class Certification:
    """Examines leaders of a search one after the other (step 4).

    Attributes:
        examined: every examined candidate, in order.
        certified: the last that passed, with the smallest objective of these; ``None``: none so far.
    """

    def __init__(self, evaluator: Evaluator, watch: TuningProgress = NO_PROGRESS) -> None:
        self._evaluator, self._watch = evaluator, watch
        self.examined: list[Examination] = []
        self.certified: Examination | None = None
        self._draws = self._rollouts = self._reference_runs = 0
        self._add_start()

    def _add_start(self) -> None:
        """Add the start to the archive, which may come from another process."""
        if self._start_key not in self._evaluator.archive:
            start = self._evaluator.start()
            self._evaluator.archive[self._start_key] = ArchiveEntry(start.candidate, start)

    def add(self, trials: Sequence[Evaluation]) -> None:
        """Add finished trials to the archive, and their numbers to those that are in it."""
        for trial in trials:
            entry = self._evaluator.archive.setdefault(point_key(trial.candidate), ArchiveEntry(trial.candidate, trial))
            entry.evaluation = replace(entry.evaluation, number=trial.number)

    @property
    def options(self) -> TuningOptions:
        """Parameters of the method."""
        return self._evaluator.problem.options

    @property
    def _start_key(self) -> PointKey:
        return point_key(Candidate(self._evaluator.problem.start, "start"))

    @property
    def start(self) -> ArchiveEntry:
        """The gains that the search started from."""
        return self._evaluator.archive[self._start_key]

    @property
    def _next(self) -> SampleCertificate:
        return SampleCertificate(self.options.violation, self.options.confidence, len(self.examined) + 1)

    def examine_leader(self, budget: SelectionBudget) -> bool:
        """During the search, examine a leader that has passed a check, while certificates keep their share of rollouts.

        Returns:
            Whether the budget, of search and certificates, allows a generation more and another certificate after it.
        """
        rollouts = self._evaluator.rollouts
        share = math.floor(CERTIFICATE_SHARE * rollouts) - self._rollouts
        if self._next.draws_of_stage(0) <= share and self._allowed(budget):
            leader = self._evaluator.leader()
            if leader and leader.passed and leader is not self.start:
                limits = (rollouts + share, *([] if budget.rollouts is None else [budget.rollouts]))
                self._examine(leader, replace(budget, rollouts=min(limits)))
        return self._allowed(budget, batches=1)

    def _allowed(self, budget: SelectionBudget, batches: int = 0) -> bool:
        """Whether a budget allows a certificate without a violation, after some batches as large as the largest.

        Controllers to which bounds on means refer are run in as many draws as the longest examination so far needed;
        before the first, in those until one look.
        """
        draws = self._next.draws_of_stage(0)
        others = self._reference_runs or (self._means().controllers - 1) * min(self.options.chunk, draws)
        rollouts = draws + others + batches * self._evaluator.largest_batch
        return budget.allows(self._evaluator.meter, rollouts, draws, self.options.machines)

    def run(self, budget: SelectionBudget, search_on: Callable[[], None] = nothing) -> Examination | None:
        """After the search, examine leaders until one is certified, the budget ends, or no candidate is left.

        A first leader is examined whatever the budget. After a rejection the search goes on for a generation at a time
        while the budget allows another certificate after it. Where only its time does not, the next leader is examined
        in the draws that there is time for.

        Args:
            budget: of search and certificate.
            search_on: searches for a generation more.
        """
        passed = False
        untimed = replace(budget, until=None)
        while not passed and (not self.examined or (self._allowed(untimed) and not budget.ended())):
            entry = self._evaluator.leader()
            if entry is None:
                break
            passed = self._examine(entry, budget).certificate.satisfied
            if entry is self.start:
                break
            if not passed and self._allowed(budget, batches=1):
                search_on()
        return self.certified

    def _examine(self, entry: ArchiveEntry, budget: SelectionBudget) -> Examination:
        """Examine a candidate on fresh machines, then in fresh draws; what it violates becomes cuts and back-off."""
        before = self._evaluator.rollouts
        certificate = self._examine_machines(entry, budget)
        if certificate.machines_below:
            self._draws += certificate.machines
        else:
            certificate = self._examine_draws(entry, certificate, budget)
        self._rollouts += self._evaluator.rollouts - before
        examination = Examination(entry, certificate, self.options.penalty)
        self.examined.append(examination)
        entry.examined = True
        if certificate.satisfied and entry is not self.start:
            self.certified, self._evaluator.certified = examination, entry
        return examination

    def _means(self) -> FreshMeans:
        return FreshMeans(self._evaluator, 1 - self.options.confidence)

    def _which(self, entry: ArchiveEntry) -> str:
        return "the start" if entry is self.start else f"candidate {self._next.candidate}"

    def _examine_machines(self, entry: ArchiveEntry, budget: SelectionBudget) -> SampleCertificate:
        """The first part of an examination: margins on fresh machines, at first on as many as in a check."""
        evaluator, certificate = self._evaluator, self._next
        options = evaluator.problem.options
        bounded = any(constraint.kind == "margin" for constraint in evaluator.training.constraints)
        for batch in [options.machines_checked, options.machines - options.machines_checked] if bounded else []:
            report = self._watch.step(
                CERTIFYING, f"certifying: {self._which(entry)} on {options.machines} fresh machines"
            )
            report(certificate.machines / options.machines)
            machines = evaluator.fresh(CERTIFICATE, self._draws + certificate.machines, batch).scenarios
            below = evaluator.machines_below(entry, machines)
            certificate = replace(
                certificate, machines=certificate.machines + batch, machines_below=certificate.machines_below + below
            )
            if certificate.machines_below or budget.ended():
                break
        return certificate

    def _examine_draws(
        self, entry: ArchiveEntry, certificate: SampleCertificate, budget: SelectionBudget
    ) -> SampleCertificate:
        """The second part of an examination: fresh draws, stage by stage."""
        evaluator, chunk = self._evaluator, self._evaluator.problem.options.chunk
        stage, start = certificate.draws_of_stage(0), self._draws
        draws, runs = FreshDraws.none(), list[RunOutcomes]()
        means = self._means()
        while not runs or not budget.ended():
            report = self._watch.step(CERTIFYING, f"certifying: {self._which(entry)} in {stage} fresh draws")
            report(certificate.draws / stage)
            batch = evaluator.fresh(CERTIFICATE, start + certificate.draws, min(chunk, stage - certificate.draws))
            result = evaluator.run([entry.candidate], batch.scenarios, to_the_end=False)
            runs.append(result)
            draws = draws.joined(batch)
            means.add(result, batch.scenarios)
            violations = int((worst_of(result, evaluator.training.constraints) > 0).sum())
            certificate = replace(
                certificate,
                draws=certificate.draws + len(batch.scenarios),
                violations=certificate.violations + violations,
                means=means.violated,
            )
            if certificate.rejected or means.rejected:
                break
            if certificate.draws == stage:
                needed = certificate.draws_of_stage(certificate.violations)
                rollouts = means.controllers * (needed - stage)
                if needed <= stage or not budget.allows(evaluator.meter, rollouts, needed - stage):
                    break
                stage = needed
        self._draws += max(certificate.draws, certificate.machines)
        self._reference_runs = max(self._reference_runs, means.reference_runs)
        if runs and not certificate.satisfied:
            evaluator.learn(entry, draws, concatenated(runs), means, back_off=True)
        return certificate

    def best(self) -> Examination:
        """The certified candidate; else of those that beat the start the one with the least supported probability.

        For that comparison, the start is examined as well if it has not been, in a few draws and on a few machines.
        """
        if self.certified:
            return self.certified
        start = next((each for each in self.examined if each.entry is self.start), None)
        start = start or self._examine(self.start, SelectionBudget(until=0.0))
        better = [each for each in self.others if each.merit < start.merit]
        return min(better, key=lambda each: (each.certificate.supported, each.merit), default=start)

    @property
    def others(self) -> list[Examination]:
        """The examined candidates but the start."""
        return [each for each in self.examined if each.entry is not self.start]

    @property
    def unexamined(self) -> int:
        """Number of candidates that were not examined and rank before the start in training."""
        start, penalty = self.start.evaluation, self._evaluator.problem.options.penalty
        entries = [each.evaluation for each in self._evaluator.archive.values() if not each.examined]
        return sum(penalised_first([start, each], penalty)[0] == 1 for each in entries)


def select(
    evaluator: Evaluator,
    trials: Sequence[Evaluation],
    certification: Certification | None = None,
    test: int | None = None,
    watch: TuningProgress = NO_PROGRESS,
) -> SelectionResult:
    """Select the best of finished trials by the certificate, and score it on the test set.

    Args:
        evaluator: of the search.
        trials: of the study.
        certification: that has been run; ``None``: the problem has no ensemble.
        test: number of test scenarios; default: from the problem's options.
        watch: gets the phase and its steps.
    """
    problem = evaluator.problem
    examination, start = None, _start(evaluator, trials)
    if certification is None:
        leader = trials[feasibility_first(trials)[0]]
        best = leader if improves_on(leader, start, evaluator.training.constraints) else start
    else:
        examination = certification.best()
        best = start if examination.entry is certification.start else examination.entry.evaluation
    watch.phase(SCORING)
    test_set = TestSet(evaluator, test or problem.options.test, problem.stream(TEST))
    scores = {"start": test_set.score(start.candidate), "paper": test_set.paper}
    scores = {"best": scores["start"] if best is start else test_set.score(best.candidate)} | scores
    certificate = examination.certificate if examination else None
    return SelectionResult(
        best=best,
        obstacle=_obstacle(certification, problem.objectives[0]) if best is start else "",
        contradiction="" if best is start else _contradiction(scores, certificate, test_set.constraints),
        certificate=certificate,
        examined=len(certification.others) if certification else 0,
        unexamined=certification.unexamined if certification else 0,
        test_violations=scores["best"].evaluation.violated,
        scores=scores,
        constraints=test_set.constraints,
        has_test_set=problem.ensemble is not None,
        within_authority=test_set.within_authority,
    )


def _start(evaluator: Evaluator, trials: Sequence[Evaluation]) -> Evaluation:
    """The start's evaluation in the training set: its trial, else from the rollouts of `prepare`."""
    point = evaluator.problem.start
    return next((trial for trial in trials if trial.point == point and not trial.pruned), None) or evaluator.start()


def _obstacle(certification: Certification | None, objective: Statistic) -> str:
    """Why the start is kept, in words."""
    if certification is None:
        return NOT_CHOSEN
    examinations = certification.others
    if not examinations:
        return NONE_BEFORE
    best = min(examinations, key=lambda each: each.merit)
    trial, certificate = best.entry.evaluation, best.certificate
    reached = f"trial {trial.number} reaches {objective.name} = {trial.objectives[0]:.4g} {objective.unit}".rstrip()
    violated = [
        f"in {certificate.violations} of {certificate.draws} fresh draws" if certificate.violations else "",
        f"on {certificate.machines_below} of {certificate.machines} fresh machines"
        if certificate.machines_below
        else "",
        f"on means over these draws ({', '.join(certificate.means)})" if certificate.means else "",
    ]
    count = f"{len(examinations)} candidate{'s' * (len(examinations) != 1)} examined"
    violations = " and ".join(filter(None, violated))
    return f"{count}; {reached}, {f'but violates bounds {violations}' if violations else 'no better than the start'}"


def _contradiction(
    scores: Mapping[str, ControllerScore], certificate: SampleCertificate | None, constraints: Sequence[Constraint]
) -> str:
    """Contradiction of the test set to the selection or to its probability, in words; empty if there is none.

    Means are over draws within the motors' authority, as in training. Violations no more frequent than the fresh draws
    support are expected, and are no argument for the start.
    """
    best, start = (scores[name].feasible for name in ("best", "start"))
    if certificate and certificate.draws:
        lowest, _ = clopper_pearson(best.violated, best.scenarios, certificate.confidence)
        if lowest > certificate.supported:
            return MORE_VIOLATIONS
        if not best.violation_of(constraints, "mean"):
            best = replace(best, violations={}, violated=0)
    if improves_on(best, start, constraints):
        return ""
    return LESS_VIOLATION if best.violation > start.violation else LESS_ERROR
