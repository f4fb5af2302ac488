"""The command ``worker``: join a study in a database or a shared file, and evaluate candidates until it is over."""

from __future__ import annotations

import secrets
from contextlib import closing
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from dualwinch.cli.options import Plugins, Whole, use_parts
from dualwinch.cli.output import if_interrupted
from dualwinch.cli.progress import ProgressLine


def worker(
    *,
    storage: Annotated[str | None, Parameter(env_var="DUALWINCH_STORAGE")] = None,
    study: str = "tuning",
    threads: Whole = None,
    plugin: Plugins = None,
) -> None:
    """Join a study that `dualwinch tune` has started in a database or a shared file, and work on it until it ends.

    Your own parts are imported from their place when the study was started. On another machine, or if they have moved,
    give their place with --plugin; they must be unchanged.

    Args:
        storage: postgresql+psycopg://USER@HOST/DATABASE, or the journal file of `dualwinch tune --shared`.
        study: Name of the study.
        threads: Threads (default: one per core).

    Examples:
        dualwinch worker --storage postgresql+psycopg://me@host/studies --study sea
        dualwinch worker --storage /home/me/sea.journal --study sea
        DUALWINCH_STORAGE=postgresql+psycopg://me:secret@host/studies dualwinch worker --study sea
    """
    with ProgressLine("joining the study", command="worker") as line:
        from dualwinch.model.errors import ConfigurationError
        from dualwinch.tuning.optimisers import optimiser
        from dualwinch.tuning.scoring.evaluation import Evaluator
        from dualwinch.tuning.scoring.progress import SEARCHING, TuningProgress
        from dualwinch.tuning.scoring.training_set import prepare
        from dualwinch.tuning.storage.connection import is_database, shown
        from dualwinch.tuning.storage.opening import join_store
        from dualwinch.tuning.storage.parts import StudyName, recall
        from dualwinch.tuning.study import search
        from dualwinch.tuning.tuning_problem import problem_from

        use_parts(plugin)
        if storage is None:
            raise ConfigurationError(
                "--storage: must be a database, postgresql+psycopg://USER@HOST/DATABASE, or the file of a shared study"
            )
        if threads is not None and threads < 1:
            raise ConfigurationError(f"--threads {threads}: must be a whole number >= 1")
        with closing(join_store(storage, study)) as store:
            definition = store.definition
            recall(StudyName(study, None if is_database(storage) else Path(storage)), definition.get("parts", []))
            problem = problem_from(definition)
            status = TuningProgress(line, problem.objectives)
            kept = shown(storage) if is_database(storage) else storage
            line.say(f"working on '{study}' in {kept}, {store.count()} trials so far")
            prepared = prepare(problem, threads, status)
            proposer = optimiser(definition["method"], prepared, secrets.randbits(31))
            evaluator = Evaluator(prepared, workers=threads)
            status.phase(SEARCHING)
            with if_interrupted("every trial finished here is in the study; the same call joins it again"):
                done = search(definition["method"], proposer, store, evaluator, status)
            line.say(f"the study is over: {done.trials} trials, {evaluator.rollouts} rollouts here")
