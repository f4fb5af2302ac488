"""A study: propose batches of candidates, evaluate them in parallel and store them, until the budget is spent."""

import math
import time
from collections.abc import Sequence

from threadpoolctl import threadpool_limits

from dualwinch.codegen.cache import build_seconds
from dualwinch.tuning.optimisers import Optimiser
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring import clock
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.progress import NO_PROGRESS, SearchStatus, TuningProgress
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.storage.record import first_candidates
from dualwinch.tuning.storage.store import SearchBudget, StudyStorage, TrialClaim

BATCH = 16
"""Candidates in a batch: one per vector lane."""

PAUSE = 0.3
"""Polling period in s while other workers finish their trials."""


@threadpool_limits.wrap(limits=1, user_api="blas")  # threads slow down algebra with matrices this small
def search(
    method: str,
    optimiser: Optimiser,
    store: StudyStorage,
    evaluator: Evaluator,
    watch: TuningProgress = NO_PROGRESS,
    progress: SearchStatus | None = None,
) -> SearchStatus:
    """Search until the budget is spent; return the status at the end.

    The first trials are the paper's gains, if its law is tuned, and the experiment's own if they differ. The optimiser
    is first told the trials in the storage; candidates have `method` as their origin. The progress is updated in place,
    so that its counts survive an interrupt, and shown after each batch.

    Raises:
        KeyboardInterrupt: interrupted; every finished batch is kept, and the claims of the unfinished one are released.
    """
    progress = SearchStatus() if progress is None else progress
    began, ran, built = clock.now(), evaluator.seconds, build_seconds()
    known = store.finished()
    progress.add(known)
    optimiser.tell(known)
    counted = optimiser.rollouts

    def propose(count: int, first: bool) -> list[Candidate]:
        given = first_candidates(evaluator.training.problem)[:count] if first else []
        asked = optimiser.ask(count - len(given)) if count > len(given) else []
        return given + [Candidate(point, method) for point in asked]

    while True:
        budget = store.budget()
        count = _batch(budget, progress.spent, evaluator.training.problem)
        if not count or (budget.until is not None and clock.now() >= budget.until):
            break
        claims = store.claim(count, budget, propose)
        if claims:
            done = _evaluated(claims, store, evaluator)
            optimiser.tell(done)
            progress.add(done)
        elif store.complete(budget):
            break
        else:
            time.sleep(PAUSE)
        news = store.news()
        optimiser.tell(news)
        progress.add(news)
        progress.rollouts, progress.rollout_seconds = evaluator.rollouts, evaluator.seconds - ran
        progress.seconds, progress.compiling = clock.now() - began, build_seconds() - built
        progress.spent, counted = progress.spent + optimiser.rollouts - counted, optimiser.rollouts
        progress.share = 0.0 if budget.rollouts is None else min(1.0, progress.spent / budget.rollouts)
        watch.progress(progress, budget.until, budget.trials)
    return progress


def _batch(budget: SearchBudget, spent: int, problem: TuningProblem) -> int:
    """Number of candidates in the next batch: `BATCH`, or as many as the remaining rollouts allow."""
    if budget.rollouts is None:
        return BATCH
    return min(BATCH, max(0, math.ceil((budget.rollouts - spent) / problem.scenarios)))


def _evaluated(claims: Sequence[TrialClaim], store: StudyStorage, evaluator: Evaluator) -> list[Evaluation]:
    try:
        done = evaluator.evaluate([claim.candidate for claim in claims])
        store.finish(claims, done)
    except BaseException:
        store.release(claims)
        raise
    return done
