"""Processes that work on a study until somebody kills them."""

import os
import random
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dualwinch.tuning.optimisers import optimiser
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.storage.connection import quiet
from dualwinch.tuning.storage.opening import open_store
from dualwinch.tuning.study import Search, SearchBudget
from dualwinch.tuning.tuning_problem import definition_of, tuning_problem

STUDY, TRIALS, METHOD = "attacked", 48, "random"


def problem() -> TuningProblem:
    """A problem that is evaluated within milliseconds."""
    return tuning_problem(
        case=4, settings=["simulation.duration=0.05"], space=["controller.nftsm.beta"], constraints=[], seed=1
    )


class Slow(Evaluator):
    """Takes its time, so that signals meet it at work."""

    def evaluate(self, candidates: Sequence[Candidate]) -> list[Evaluation]:
        """As long as a batch of some real problem."""
        time.sleep(random.uniform(0, 0.15))  # noqa: S311
        return super().evaluate(candidates)


def work_in_file(storage: str, ready: Any) -> None:
    """What ``dualwinch tune --storage FILE --resume`` does until its search ends."""
    _search(storage, ready, resume=True)


def work_in_database(url: str, ready: Any) -> None:
    """What ``dualwinch tune --storage URL`` does until its search ends."""
    _search(url, ready, resume=False)


def _search(storage: str, ready: Any, *, resume: bool) -> None:
    _silent()
    task = problem()
    ready.release()
    store = open_store(storage, STUDY, task, definition_of(task, METHOD), resume=resume)
    training = prepare(task, workers=1)
    evaluator = Slow(training, workers=1)
    Search(METHOD, optimiser(METHOD, training, os.getpid()), store, evaluator).run(SearchBudget(TRIALS))
    store.close()


def _silent() -> None:
    """Say nothing of what a signal ends."""
    random.seed(os.getpid())
    quiet()
    null = Path(os.devnull).open("w")  # noqa: SIM115  # until the process ends
    os.dup2(null.fileno(), sys.stderr.fileno())
