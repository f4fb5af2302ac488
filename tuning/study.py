"""A study: batches of candidates are asked for, evaluated side by side, kept and told, until the budget is spent."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from dualwinch.tuning.optimisers import Optimiser
from dualwinch.tuning.problem import Problem
from dualwinch.tuning.scoring.evaluate import Evaluator
from dualwinch.tuning.scoring.evaluation import Candidate, Evaluation
from dualwinch.tuning.scoring.ranking import best_first
from dualwinch.tuning.storage.store import Claim, Store

BATCH = 16
"""Candidates of a batch: one for each vector lane."""

PAUSE = 0.3
"""Time in s between two looks at whether other workers are done."""


@dataclass
class Progress:
    """Where a study stands.

    Attributes:
        trials: finished trials, of all workers.
        feasible: how many of them keep to every constraint.
        best: the best so far, by `tuning.scoring.ranking`; ``None`` before the first.
        rollouts: rollouts of this process.
        rollout_seconds: wall time they took.
        seconds: wall time of the search in this process.
    """

    trials: int = 0
    feasible: int = 0
    best: Evaluation | None = None
    rollouts: int = 0
    rollout_seconds: float = 0.0
    seconds: float = 0.0

    def add(self, evaluations: Sequence[Evaluation]) -> None:
        """Count further finished trials."""
        self.trials += len(evaluations)
        self.feasible += sum(one.feasible for one in evaluations)
        for one in evaluations:
            if self.best is None or best_first([self.best, one])[0]:
                self.best = one

    @property
    def overhead(self) -> float:
        """Share of the wall time that was not spent in rollouts."""
        return 1 - self.rollout_seconds / self.seconds if self.seconds else 0.0


def search(
    problem: Problem,
    method: str,
    optimiser: Optimiser,
    store: Store,
    evaluator: Evaluator,
    watch: Callable[[Progress], None] = lambda _: None,
    batch: int = BATCH,
    reserve: int = 0,
) -> Progress:
    """Search until the budget is spent.

    The first trial is the paper's gains, the second the experiment's own where those differ.

    Args:
        problem: what is tuned.
        method: name of the optimiser, kept as the origin of its candidates.
        optimiser: proposes candidates; it is told first what the storage holds.
        store: where trials are kept.
        evaluator: evaluates them.
        watch: called after each batch.
        batch: candidates evaluated in one call.
        reserve: rollouts to leave time for where the budget is one of time.

    Returns:
        Where the study stands at the end.

    Raises:
        KeyboardInterrupt: interrupted; every finished batch is kept, and what was under way is given back.
    """
    progress, began, ran = Progress(), time.perf_counter(), evaluator.seconds
    known = store.finished()
    progress.add(known)
    optimiser.tell(known)

    def propose(count: int, first: bool) -> list[Candidate]:
        given = _first(problem)[:count] if first else []
        asked = optimiser.ask(count - len(given)) if count > len(given) else []
        return given + [Candidate(point, method) for point in asked]

    while True:
        budget = store.budget()
        if budget.until is not None and time.time() + reserve * evaluator.pace >= budget.until:
            break
        claims = store.claim(batch, budget, propose)
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
        progress.seconds = time.perf_counter() - began
        watch(progress)
    return progress


def _first(problem: Problem) -> list[Candidate]:
    paper, start = problem.paper_point, problem.start
    return [Candidate(paper, "paper")] + ([Candidate(start, "start")] if start != paper else [])


def _evaluated(claims: Sequence[Claim], store: Store, evaluator: Evaluator) -> list[Evaluation]:
    try:
        done = evaluator.evaluate([claim.candidate for claim in claims])
        store.finish(claims, done)
    except BaseException:
        store.release(claims)
        raise
    return done
