"""The command ``worker``: join a study in a database or a shared file, and evaluate candidates until it is over."""

from __future__ import annotations

import secrets
from contextlib import closing
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from dualwinch.toolbox import ProgressLine, options, output


def worker(
    *,
    storage: Annotated[str | None, Parameter(env_var="DUALWINCH_STORAGE")] = None,
    study: str = "tuning",
    threads: options.Whole = None,
    plugin: options.Plugins = None,
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
        from dualwinch.toolbox import ConfigurationError, searching

        options.use_parts(plugin)
        if storage is None:
            raise ConfigurationError(
                "--storage: must be a database, postgresql+psycopg://USER@HOST/DATABASE, or the file of a shared study"
            )
        if threads is not None and threads < 1:
            raise ConfigurationError(f"--threads {threads}: must be a whole number >= 1")
        with closing(searching.join_store(storage, study)) as store:
            definition = store.definition
            searching.recall(
                searching.StudyName(study, None if searching.is_database(storage) else Path(storage)),
                definition.get("parts", []),
            )
            problem = searching.problem_from(definition)
            status = searching.TuningProgress(line, problem.objectives)
            kept = searching.shown(storage) if searching.is_database(storage) else storage
            line.say(f"working on '{study}' in {kept}, {store.count()} trials so far")
            prepared = searching.prepare(problem, threads, status)
            proposer = searching.optimiser(definition["method"], prepared, secrets.randbits(31))
            evaluator = searching.Evaluator(prepared, workers=threads)
            status.phase(searching.SEARCHING)
            with output.if_interrupted("every trial finished here is in the study; the same call joins it again"):
                done = searching.search(definition["method"], proposer, store, evaluator, status)
            line.say(f"the study is over: {done.trials} trials, {evaluator.rollouts} rollouts here")
