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
from dualwinch.tuning.storage import connection
from dualwinch.tuning.storage.connection import quiet
from dualwinch.tuning.storage.database import DatabaseStudy
from dualwinch.tuning.storage.opening import open_store
from dualwinch.tuning.storage.store import SearchBudget, StudyStorage
from dualwinch.tuning.study import search
from dualwinch.tuning.tuning_problem import definition_of, problem_from, tuning_problem

STUDY, TRIALS, METHOD = "attacked", 48, "random"

BEAT, GRACE = 1, 2
"""Time in s between two beats, and the silence after which a worker counts as dead: as short as can be."""


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
    _silent()
    asked = problem()
    ready.release()
    definition, budget = definition_of(asked, METHOD), SearchBudget(TRIALS)
    _search(open_store(storage, STUDY, asked, definition, budget, resume=True), asked)


def work_in_database(url: str, ready: Any) -> None:
    """What ``dualwinch worker`` does."""
    _silent()
    ready.release()
    store = DatabaseStudy.join(url, STUDY)
    _search(store, problem_from(store.definition))


def begin(url: str, study: str = STUDY) -> DatabaseStudy:
    """A study in a database, as ``dualwinch tune`` begins it."""
    connection.HEARTBEAT, connection.GRACE = BEAT, GRACE
    asked = problem()
    return DatabaseStudy.begin(url, study, asked, definition_of(asked, METHOD), SearchBudget(TRIALS), resume=True)


def _search(store: StudyStorage, asked: TuningProblem) -> None:
    prepared = prepare(asked, workers=1)
    search(METHOD, optimiser(METHOD, prepared, os.getpid()), store, Slow(prepared, workers=1))
    store.close()


def _silent() -> None:
    """Say nothing of what a signal ends."""
    connection.HEARTBEAT, connection.GRACE = BEAT, GRACE
    random.seed(os.getpid())
    quiet()
    null = Path(os.devnull).open("w")  # noqa: SIM115  # until the process ends
    os.dup2(null.fileno(), sys.stderr.fileno())
