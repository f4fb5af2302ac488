"""``dualwinch worker``: join a study that is kept in a database, and evaluate candidates until it is over."""

import secrets
from contextlib import closing

from dualwinch.commands.progress import StatusLine
from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.optimisers import optimiser
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.progress import SEARCHING
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.storage.connection import shown
from dualwinch.tuning.storage.database import DatabaseStudy
from dualwinch.tuning.storage.opening import check_storage, is_database, quiet
from dualwinch.tuning.storage.recall import recall
from dualwinch.tuning.study import search
from dualwinch.tuning.tuning_problem import problem_from


def worker(storage: str | None, study: str, threads: int | None, watch: StatusLine) -> None:
    """Work on a study until its budget is spent.

    Raises:
        ConfigurationError: no database, no such study, or a part of it that is not there or has changed.
        DualwinchError: the database cannot be used.
        KeyboardInterrupt: interrupted; what was under way is queued again.
    """
    if storage is None or not is_database(storage):
        raise ConfigurationError("--storage: must be a database, postgresql+psycopg://USER@HOST/DATABASE")
    if threads is not None and threads < 1:
        raise ConfigurationError(f"--threads {threads}: must be a whole number >= 1")
    check_storage(storage)
    quiet()
    with closing(DatabaseStudy.join(storage, study)) as store:
        definition = store.definition
        recall(study, definition.get("parts", []))
        problem = problem_from(definition)
        watch.objectives = problem.objectives
        watch.say(f"working on '{study}' in {shown(storage)}, {store.count()} trials so far")
        prepared = prepare(problem, threads, watch)
        proposer = optimiser(definition["method"], prepared, secrets.randbits(31))
        evaluator = Evaluator(prepared, threads=threads)
        watch.phase(SEARCHING)
        done = search(definition["method"], proposer, store, evaluator, watch)
        watch.say(f"the study is over: {done.trials} trials, {evaluator.rollouts} rollouts here")
