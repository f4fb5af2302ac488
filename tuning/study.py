"""A study: propose batches of candidates, evaluate them in parallel and store them, until the budget is spent."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from threadpoolctl import threadpool_limits

from dualwinch.codegen.cache import build_seconds
from dualwinch.tuning.optimisers import Optimiser
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring import clock
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.progress import NO_PROGRESS, SearchStatus, TuningProgress
from dualwinch.tuning.scoring.ranking import Candidate
from dualwinch.tuning.storage.store import StudyStorage


@dataclass(frozen=True)
class SearchBudget:
    """Limits of a search by one process; it ends at the first.

    Attributes:
        trials: number of its trials; ``None``: no limit.
        until: time by `clock.without_compiling`; ``None``: no limit.
        seconds: length of the search in s that ends then.
        rollouts: number of its rollouts, those of checks and certificates included; ``None``: no limit.
    """

    trials: int | None = None
    until: float | None = None
    seconds: float | None = None
    rollouts: int | None = None

    def batch(self, trials: int, rollouts: int, problem: TuningProblem) -> int:
        """Number of candidates in the next batch, after so many trials and rollouts; 0: the budget is spent."""
        if self.until is not None and clock.without_compiling() >= self.until:
            return 0
        limits = [problem.options.generation]
        if self.trials is not None:
            limits.append(self.trials - trials)
        if self.rollouts is not None:
            limits.append(math.ceil((self.rollouts - rollouts) / problem.scenarios))
        return max(0, min(limits))

    def remaining(self, rollouts: int) -> float:
        """Share of time and rollouts that is left after so many rollouts, the smaller one; 1 without such a limit."""
        shares = [1.0]
        if self.until is not None and self.seconds:
            shares.append((self.until - clock.without_compiling()) / self.seconds)
        if self.rollouts:
            shares.append(1 - rollouts / self.rollouts)
        return min(shares)


NO_LIMIT = SearchBudget()


def first_candidates(problem: TuningProblem) -> list[Candidate]:
    """First candidates of a study: the paper's gains, if its law is tuned, and the start."""
    paper, start = problem.paper_point, problem.start
    papers = [] if paper is None else [Candidate(paper, "paper")]
    return papers + ([Candidate(start, "start")] if start != paper else [])


def always() -> bool:
    """After each batch, the search goes on."""
    return True


class Search:
    """A search that can go on from where it stopped.

    The first trials of a study are the paper's gains, if its law is tuned, and the experiment's own if they differ. The
    optimiser is first told the trials in the storage, and after each batch those that other processes have finished;
    candidates have `method` as their origin. Budgets are this process's own: trials of others do not count, those in
    the storage at the beginning only where the study is continued (`StudyStorage.continued`).

    Attributes:
        status: updated in place after each batch, so that its counts survive an interrupt.
        trials: number of its trials.
    """

    def __init__(
        self,
        method: str,
        optimiser: Optimiser,
        store: StudyStorage,
        evaluator: Evaluator,
        watch: TuningProgress = NO_PROGRESS,
    ) -> None:
        self._method, self._optimiser, self._store = method, optimiser, store
        self._evaluator, self._watch, self.status = evaluator, watch, SearchStatus()
        stored = store.finished()
        self.status.add(stored)
        optimiser.tell(stored)
        self.trials = len(stored) if store.continued else 0
        self._rollouts = sum(trial.scenarios for trial in stored) if store.continued else 0
        self._before = evaluator.rollouts
        origins = {trial.candidate.origin for trial in stored}
        self._waiting = [each for each in first_candidates(evaluator.problem) if each.origin not in origins]

    @property
    def rollouts(self) -> int:
        """Rollouts so far, those of checks and certificates included."""
        return self._rollouts + self._evaluator.rollouts - self._before

    @threadpool_limits.wrap(limits=1, user_api="blas")  # threads slow down algebra with matrices this small
    def run(self, budget: SearchBudget = NO_LIMIT, goes_on: Callable[[], bool] = always) -> SearchStatus:
        """Search until the budget is spent; return the status at the end.

        Args:
            budget: of the whole search, earlier calls included.
            goes_on: called after each batch; returns whether the search goes on.

        Raises:
            KeyboardInterrupt: interrupted; every finished batch is stored.
        """
        evaluator, problem, status = self._evaluator, self._evaluator.problem, self.status
        began, built, seconds = clock.now(), build_seconds(), status.seconds
        before, compiling, spent = evaluator.seconds, status.compiling, status.rollout_seconds
        proceeds = True
        while proceeds and (size := budget.batch(self.trials, self.rollouts, problem)):
            candidates, self._waiting = self._waiting[:size], self._waiting[size:]
            if size > len(candidates):
                points = self._optimiser.ask(size - len(candidates))
                candidates += [Candidate(point, self._method) for point in points]
            evaluations = evaluator.evaluate(candidates)
            self._store.add(evaluations)
            for finished in (evaluations, self._store.news()):
                self._optimiser.tell(finished)
                status.add(finished)
            self.trials += len(evaluations)
            proceeds = goes_on()
            status.rollouts, status.rollout_seconds = evaluator.rollouts, spent + evaluator.seconds - before
            status.seconds = seconds + clock.now() - began
            status.compiling = compiling + build_seconds() - built
            status.spent = self.rollouts
            status.share = 0.0 if budget.rollouts is None else min(1.0, self.rollouts / budget.rollouts)
            total = None if budget.trials is None else budget.trials + status.trials - self.trials
            self._watch.progress(status, budget.until, total)
        return status
