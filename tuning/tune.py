"""Tune in one call: search, choose and score, without files."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.optimisers import default_method, optimiser
from dualwinch.tuning.problem import Problem
from dualwinch.tuning.scoring.evaluate import Evaluator
from dualwinch.tuning.scoring.evaluation import Evaluation
from dualwinch.tuning.scoring.selection import Verdict, judge, rollouts_needed
from dualwinch.tuning.storage.memory import Memory
from dualwinch.tuning.storage.store import Budget, quiet
from dualwinch.tuning.study import Progress, search


@dataclass(frozen=True)
class Tuned:
    """A finished study.

    Attributes:
        problem: what was tuned.
        trials: every trial, in order.
        verdict: the best, and its score beside that of the paper's gains.
        progress: what the search took.
    """

    problem: Problem
    trials: tuple[Evaluation, ...]
    verdict: Verdict
    progress: Progress

    @property
    def best(self) -> Experiment:
        """The experiment with the best gains."""
        return self.problem.tuned(self.verdict.best.point)


def tune(
    problem: Problem,
    *,
    method: str | None = None,
    trials: int | None = None,
    seconds: float | None = None,
    held_out: int = 200,
    threads: int | None = None,
    watch: Callable[[Progress], None] = lambda _: None,
) -> Tuned:
    """Search for gains, choose the best, and score it in scenarios that nobody saw.

    Args:
        problem: what is tuned, from `dualwinch.tuning_problem`.
        method: name of the optimiser (`tuning.optimisers.METHODS`); default: by the number of objectives.
        trials: number of trials; this or `seconds` or both.
        seconds: wall time in s, choice and score included.
        held_out: number of scenarios that score the best.
        threads: default: one a core.
        watch: called after each batch.

    Raises:
        ConfigurationError: an unknown method, or no budget.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted; nothing is kept.
    """
    if trials is None and seconds is None:
        raise ConfigurationError("tune: needs a budget, trials or seconds")
    for name, value in (("trials", trials), ("held_out", held_out)):
        if value is not None and value < 1:
            raise ConfigurationError(f"{name} = {value}: must be a whole number >= 1")
    quiet()
    name = method or default_method(len(problem.objectives))
    store = Memory(Budget(trials, None if seconds is None else time.time() + seconds))
    evaluator = Evaluator(problem, threads=threads)
    proposer = optimiser(name, problem, problem.seed)
    progress = search(problem, name, proposer, store, evaluator, watch, reserve=rollouts_needed(problem, held_out))
    finished = store.finished()
    if not finished:
        raise ConfigurationError(f"seconds = {seconds:g}: is too short for a single trial with its score")
    return Tuned(problem, tuple(finished), judge(problem, finished, evaluator, held_out), progress)
