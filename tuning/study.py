"""A study: propose batches of candidates, evaluate them in parallel and store them, until the budget is spent."""

import math
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
        until: time in s since the epoch; ``None``: no limit.
        rollouts: number of rollouts of its trials; pruned ones count those they ran; ``None``: no limit.
    """

    trials: int | None = None
    until: float | None = None
    rollouts: int | None = None

    def batch(self, trials: int, rollouts: int, problem: TuningProblem) -> int:
        """Number of candidates in the next batch, after so many trials and rollouts; 0: the budget is spent."""
        if self.until is not None and clock.now() >= self.until:
            return 0
        limits = [problem.options.generation]
        if self.trials is not None:
            limits.append(self.trials - trials)
        if self.rollouts is not None:
            limits.append(math.ceil((self.rollouts - rollouts) / problem.scenarios))
        return max(0, min(limits))


NO_LIMIT = SearchBudget()


def first_candidates(problem: TuningProblem) -> list[Candidate]:
    """First candidates of a study: the paper's gains, if its law is tuned, and the start."""
    paper, start = problem.paper_point, problem.start
    papers = [] if paper is None else [Candidate(paper, "paper")]
    return papers + ([Candidate(start, "start")] if start != paper else [])


@threadpool_limits.wrap(limits=1, user_api="blas")  # threads slow down algebra with matrices this small
def search(
    method: str,
    optimiser: Optimiser,
    store: StudyStorage,
    evaluator: Evaluator,
    budget: SearchBudget = NO_LIMIT,
    watch: TuningProgress = NO_PROGRESS,
    progress: SearchStatus | None = None,
) -> SearchStatus:
    """Search until the budget is spent; return the status at the end.

    The first trials of a study are the paper's gains, if its law is tuned, and the experiment's own if they differ. The
    optimiser is first told the trials in the storage, and after each batch those that other processes have finished;
    candidates have `method` as their origin. The budget is this process's own: trials of others do not count, those in
    the storage at the beginning only where the study is continued (`StudyStorage.continued`). The progress is updated
    in place, so that its counts survive an interrupt, and shown after each batch.

    Raises:
        KeyboardInterrupt: interrupted; every finished batch is stored.
    """
    progress = SearchStatus() if progress is None else progress
    began, before, built = clock.now(), evaluator.seconds, build_seconds()
    stored, problem = store.finished(), evaluator.training.problem
    progress.add(stored)
    optimiser.tell(stored)
    trials = len(stored) if store.continued else 0
    rollouts = sum(trial.scenarios for trial in stored) if store.continued else 0
    further = evaluator.further_rollouts
    origins = {trial.candidate.origin for trial in stored}
    waiting = [candidate for candidate in first_candidates(problem) if candidate.origin not in origins]
    while size := budget.batch(trials, rollouts, problem):
        candidates, waiting = waiting[:size], waiting[size:]
        if size > len(candidates):
            candidates += [Candidate(point, method) for point in optimiser.ask(size - len(candidates))]
        evaluations = evaluator.evaluate(candidates)
        store.add(evaluations)
        news = store.news()
        for finished in (evaluations, news):
            optimiser.tell(finished)
            progress.add(finished)
        trials += len(evaluations)
        rollouts += sum(evaluation.scenarios for evaluation in evaluations) + evaluator.further_rollouts - further
        further = evaluator.further_rollouts
        progress.rollouts, progress.rollout_seconds = evaluator.rollouts, evaluator.seconds - before
        progress.seconds, progress.compiling = clock.now() - began, build_seconds() - built
        progress.spent = rollouts
        progress.share = 0.0 if budget.rollouts is None else min(1.0, rollouts / budget.rollouts)
        total = None if budget.trials is None else budget.trials + progress.trials - trials
        watch.progress(progress, budget.until, total)
    return progress
