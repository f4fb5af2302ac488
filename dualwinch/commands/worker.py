"""``dualwinch worker``: join a study that is kept in a database, and evaluate candidates until it is over."""

import secrets
from contextlib import closing

from rich.console import Console

from dualwinch.commands.tuning_progress import Watch
from dualwinch.commands.tuning_setup import problem_from
from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.optimisers import optimiser
from dualwinch.tuning.scoring.evaluate import Evaluator
from dualwinch.tuning.storage.connection import shown
from dualwinch.tuning.storage.database import Database
from dualwinch.tuning.storage.store import check_storage, is_database, quiet
from dualwinch.tuning.study import search


def worker(storage: str | None, study: str, threads: int | None) -> None:
    """Work on a study until its budget is spent.

    Raises:
        ConfigurationError: no database, or no such study.
        DualwinchError: the database cannot be used.
        KeyboardInterrupt: interrupted; what was under way is queued again.
    """
    if storage is None or not is_database(storage):
        raise ConfigurationError("--storage: must be a database, postgresql+psycopg://USER@HOST/DATABASE")
    if threads is not None and threads < 1:
        raise ConfigurationError(f"--threads {threads}: must be a whole number >= 1")
    check_storage(storage)
    quiet()
    console = Console(stderr=True)
    with closing(Database.join(storage, study)) as store:
        definition = store.definition
        problem = problem_from(definition)
        console.print(f"working on '{study}' in {shown(storage)}, {store.count()} trials so far", highlight=False)
        proposer = optimiser(definition["method"], problem, secrets.randbits(31))
        evaluator = Evaluator(problem, threads=threads)
        with Watch(console, problem, store.budget()) as watch:
            done = search(problem, definition["method"], proposer, store, evaluator, watch.show)
        console.print(f"the study is over: {done.trials} trials, {evaluator.rollouts} rollouts here", highlight=False)
