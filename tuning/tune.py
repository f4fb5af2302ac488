"""Tune in one call: prepare, search, select and score."""

from dataclasses import replace
from functools import partial

from dualwinch.codegen.cache import build_seconds
from dualwinch.model.arguments import instance, whole_number
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.workers import Workers
from dualwinch.tuning.optimisers import check_method, optimiser
from dualwinch.tuning.options import TRIALS, default_method
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.result import TuningCost, TuningResult
from dualwinch.tuning.scoring import clock
from dualwinch.tuning.scoring.budget import (
    CERTIFICATE_SHARE,
    LEAST_SEARCH,
    TIME_MORE,
    TIME_SHARE,
    SelectionBudget,
    seconds_of_test,
)
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.progress import CERTIFYING, NO_PROGRESS, SEARCHING, TuningProgress
from dualwinch.tuning.scoring.selection import Certification, select
from dualwinch.tuning.scoring.starts import prepare_best_start, with_designed_start
from dualwinch.tuning.storage.connection import quiet
from dualwinch.tuning.storage.store import MemoryStorage, StudyStorage
from dualwinch.tuning.study import Search, SearchBudget, first_candidates


def trials_of(problem: TuningProblem, trials: int | None, seconds: float | None, rollouts: int | None) -> int | None:
    """Largest number of trials of a search; ``None``: limited by another budget only.

    Without any budget: `TRIALS`, or the number that the gains need (`TuningOptions.trials_needed`) if that is larger.
    """
    if not trials is seconds is rollouts is None:
        return trials
    return max(TRIALS, problem.options.trials_needed(len(problem.space.dimensions)))


def tune(
    problem: TuningProblem,
    *,
    method: str | None = None,
    trials: int | None = None,
    seconds: float | None = None,
    rollouts: int | None = None,
    test_scenarios: int | None = None,
    workers: Workers = None,
    store: StudyStorage | None = None,
    reserved_seconds: float = 0.0,
    keep: bool = True,
    watch: TuningProgress = NO_PROGRESS,
) -> TuningResult:
    """Search for gains, certify the best candidate in fresh draws, and score it on a test set.

    The method has its steps and sources in `tuning.scoring.selection`. An interrupt (Ctrl-C) ends the search; the best
    candidate so far is selected and scored, unless `keep` is false.

    Args:
        problem: from `dualwinch.tuning_problem`.
        method: name of the optimiser (`tuning.optimisers.METHODS`); default: by the number of objectives.
        trials: number of trials; default: from `trials_of` without `seconds` and `rollouts`, else no limit.
        seconds: wall time of the search in s, the design of a start included (of which it keeps at least half).
            Preparation and compilation come before; certificate and scores take up to 0.3 times that plus 10 s more,
            and where that is too little, the search is shorter. The first trials, the paper's gains and the start, are
            always finished.
        rollouts: number of rollouts of search, checks and certificates, of which the search leaves enough for another
            certificate; an eighth more where the search ends without a certified candidate. A first candidate is always
            examined whole. Runs of the paper's gains, or the start, in the same draws as a candidate count; the reserve
            for them is what earlier examinations took.
        test_scenarios: number of test scenarios; default: from the problem's `TuningOptions`.
        workers: number of threads of this machine, or an executor; default: one thread per core.
        store: open storage of the trials; a study in it is continued. Default: in memory.
        reserved_seconds: part of the time after the search, in s, that is left for the caller's work after the call.
        keep: whether an interrupt keeps the best candidate so far; else it is raised.
        watch: shows every phase (`tuning.scoring.progress.PHASES`) and each batch of the search.

    Raises:
        ConfigurationError: an unknown method, or an invalid budget.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted before the first trial, during selection, or with `keep` false; the store keeps
            its trials.

    Example:
        >>> import dualwinch as dw
        >>> run = dw.override(dw.case(4), {"simulation.duration": 2.0})
        >>> problem = dw.tuning_problem(run, space=["controller.nftsm.beta"], constraints=["none"])
        >>> tuned = dw.tune(problem, trials=20)
        >>> tuned.best.controller.law.kind
        'fando-nftsm'
    """
    instance("problem", problem, TuningProblem, hint=" (tuning_problem makes one)")
    trials = trials_of(problem, trials, seconds, rollouts)
    for name, count in (("trials", trials), ("rollouts", rollouts), ("test_scenarios", test_scenarios)):
        if count is not None:
            whole_number(name, count, 1)
    if seconds is not None and seconds <= 0:
        raise ConfigurationError(f"seconds = {seconds:g}: must be > 0")
    method = method or default_method(len(problem.objectives))
    check_method(method, len(problem.objectives))
    quiet()
    began, built = clock.now(), build_seconds()
    clock_began = clock.without_compiling()
    problem = with_designed_start(problem, watch)
    designing = clock.without_compiling() - clock_began
    training = prepare_best_start(problem, workers, watch)
    problem = training.problem
    store = store or MemoryStorage()
    evaluator = Evaluator(training, workers=workers)
    evaluator.find_active_loops()
    proposer = optimiser(method, training, problem.stream(store.stream))
    watch.compiled(build_seconds() - built)
    scored = _begin(store, evaluator, trials)
    prepared, interrupted = clock.now(), False
    certification = None if problem.ensemble is None else Certification(evaluator, watch)
    searching = Search(method, proposer, store, evaluator, watch)
    budget = SearchBudget(trials and trials - scored * (not store.continued), seconds=seconds, rollouts=rollouts)
    limits, end = _limits(budget, designing)
    before_test = partial(_before_test, evaluator, end and end - reserved_seconds)
    watch.phase(SEARCHING)
    if limits.until is not None and end is not None:
        now = clock.without_compiling()
        watch.forecast(prepared - began, limits.until - now, end - now)

    def goes_on() -> bool:
        """Examine a leader that is due, and keep the budget of the next certificate, from half of the search on."""
        if certification is None:
            return True
        keeps = certification.examine_leader(before_test(rollouts))
        return keeps or limits.remaining(searching.rollouts) > 1 - LEAST_SEARCH

    try:
        searching.run(limits, goes_on)
    except KeyboardInterrupt:
        if not keep:
            raise
        interrupted = True
    searched, rollouts_of_search = clock.now(), evaluator.rollouts
    watch.phase(CERTIFYING)
    if certification:
        total = None if seconds is not None and rollouts is None else rollouts or rollouts_of_search
        _certify(certification, None if trials or interrupted else searching, store, before_test(total))
    verdict = select(evaluator, store.finished(), certification, test_scenarios, watch)
    status = searching.status
    cost = TuningCost(
        rollouts=evaluator.rollouts,
        rollout_seconds=evaluator.seconds,
        preparing=prepared - began,
        searching=searched - prepared,
        judging=clock.now() - searched,
        overhead=status.overhead,
        margin_seconds=evaluator.meter.margins.seconds + evaluator.meter.some_margins.seconds,
        compiling=build_seconds() - built,
        judging_rollouts=evaluator.rollouts - rollouts_of_search,
    )
    return TuningResult(training, method, tuple(store.finished()), verdict, status, cost, interrupted, seconds)


def _begin(store: StudyStorage, evaluator: Evaluator, trials: int | None) -> int:
    """Finish the first trials, the paper's gains and the start, whatever the time: a study is never empty.

    Returns:
        Their number; 0 if the study has trials.
    """
    candidates = [] if store.count() else first_candidates(evaluator.problem)[:trials]
    if candidates:
        store.add(evaluator.evaluate(candidates))
    return len(candidates)


def _certify(certification: Certification, search: Search | None, store: StudyStorage, budget: SelectionBudget) -> None:
    """Examine leaders after a search, which goes on between them.

    Args:
        certification: of the search's evaluator.
        search: that goes on; ``None``: it does not.
        store: of its trials.
        budget: of search and certificates, with some more rollouts where nothing is certified yet.
    """
    certification.add(store.finished())

    def search_on() -> None:
        if search:
            search.run(SearchBudget(search.trials + certification.options.generation))
            certification.add(store.finished())

    if budget.rollouts and not certification.certified:
        budget = replace(budget, rollouts=round((1 + CERTIFICATE_SHARE) * budget.rollouts))
    certification.run(budget, search_on)


def _before_test(evaluator: Evaluator, end: float | None, rollouts: int | None) -> SelectionBudget:
    """Budget of certificates that leave time for the test set until `end`, as estimated at the pace so far."""
    until = None if end is None else end - seconds_of_test(evaluator.problem.options, evaluator.meter)
    return SelectionBudget(until, rollouts)


def _limits(budget: SearchBudget, designing: float) -> tuple[SearchBudget, float | None]:
    """A search's budget with its end, and the time by `clock.without_compiling` at which everything ends.

    The design of a start counts as search, but leaves it at least the share `LEAST_SEARCH` of its time.
    """
    if budget.seconds is None:
        return budget, None
    searching, now = max(budget.seconds - designing, LEAST_SEARCH * budget.seconds), clock.without_compiling()
    end = now + searching + TIME_SHARE * budget.seconds + TIME_MORE
    return replace(budget, until=now + searching, seconds=searching), end
