"""Tune in one call: prepare, search, select and score."""

from dataclasses import replace
from functools import partial

from dualwinch.codegen.cache import build_seconds
from dualwinch.model.arguments import instance, whole_number
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.workers import Workers
from dualwinch.tuning.optimisers import check_method, compile_ahead, optimiser
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.result import TuningCost, TuningResult
from dualwinch.tuning.scoring import clock
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.progress import NO_PROGRESS, SEARCHING, SearchStatus, TuningProgress
from dualwinch.tuning.scoring.selection import select
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.selection_config import TRIALS, default_method
from dualwinch.tuning.storage.connection import quiet
from dualwinch.tuning.storage.store import MemoryStorage, StudyStorage
from dualwinch.tuning.study import SearchBudget, search

WORTH_COMPILING = 20.0
"""Time budget in s from which everything a search may call is compiled beforehand, outside the budget."""


def trials_of(problem: TuningProblem, trials: int | None, seconds: float | None, rollouts: int | None) -> int | None:
    """Largest number of trials of a search; ``None``: limited by another budget only.

    Without any budget: `TRIALS`, or the number that the gains need (`SelectionConfig.trials_needed`) if that is larger.
    """
    if not trials is seconds is rollouts is None:
        return trials
    return max(TRIALS, problem.selection.trials_needed(len(problem.space.dimensions)))


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
    """Search for gains, select the best candidate by validation, and score it on a test set.

    An interrupt (Ctrl-C) ends the search; the best candidate so far is selected and scored, unless `keep` is false.

    Args:
        problem: from `dualwinch.tuning_problem`.
        method: name of the optimiser (`tuning.optimisers.METHODS`); default: by the number of objectives.
        trials: number of trials; default: from `trials_of` without `seconds` and `rollouts`, else no limit.
        seconds: wall time of the search in s. With preparation, selection and scoring, the study takes at most 1.3
            times that plus 10 s (`SelectionConfig.time_of_all`); where time is short, selection and scoring use fewer
            scenarios and the search is shorter. Compilation comes on top.
        rollouts: number of rollouts of the search. A pruned trial counts the rollouts it ran, a gradient as many as
            finite differences would take; the last batch may exceed the number by a few.
        test_scenarios: largest number of test scenarios; default: from the problem's `SelectionConfig`.
        workers: number of threads of this machine, or an executor; default: one thread per core.
        store: open storage of the trials; a study in it is continued. Default: in memory.
        reserved_seconds: part of the study's time, in s, that is left for the caller's work after the call.
        keep: whether an interrupt keeps the best candidate so far; else it is raised.
        watch: shows every phase (`tuning.scoring.progress.PHASES`) and each batch of the search.

    Raises:
        ConfigurationError: an unknown method, or an invalid budget.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted before the first trial, during selection, or with `keep` false; the store keeps
            its trials.
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
    began, allowed, built = clock.now(), clock.without_compiling(), build_seconds()
    worth = seconds is not None and seconds >= WORTH_COMPILING
    training = prepare(problem, workers, watch, partial(compile_ahead, method, problem) if worth else None)
    store = store or MemoryStorage()
    evaluator = Evaluator(training, workers=workers)
    proposer = optimiser(method, training, problem.stream(store.stream))
    watch.compiled(build_seconds() - built)
    watch.phase(SEARCHING)
    searched, config = clock.now(), problem.selection
    until = None
    if seconds is not None:
        evaluator.until = allowed + config.time_of_all(seconds) - reserved_seconds
        until = searched + evaluator.time_of_search(seconds)
    progress, interrupted = SearchStatus(), False
    try:
        search(method, proposer, store, evaluator, SearchBudget(trials, until, rollouts), watch, progress)
    except KeyboardInterrupt:
        if not keep:
            raise
        interrupted = True
    judged = clock.now()
    finished = store.finished()
    if not finished and interrupted:
        raise KeyboardInterrupt
    if not finished:
        raise ConfigurationError(f"seconds = {seconds:g}: too short, the first trials were not finished in time")
    tried = evaluator.rollouts
    sizes = config.sizes if test_scenarios is None else replace(config.sizes, test=test_scenarios)
    verdict = select(evaluator, finished, sizes, watch)
    cost = TuningCost(
        rollouts=evaluator.rollouts,
        rollout_seconds=evaluator.seconds,
        preparing=searched - began,
        searching=judged - searched,
        judging=clock.now() - judged,
        overhead=progress.overhead,
        margin_seconds=evaluator.margin_seconds,
        compiling=build_seconds() - built,
        judging_rollouts=evaluator.rollouts - tried,
    )
    return TuningResult(training, method, tuple(finished), verdict, progress, cost, interrupted, seconds)
