"""Options of ``dualwinch worker``."""

from typing import Annotated

from cyclopts import App, Parameter

from dualwinch.cli.options import WHOLE, Plugins, use_parts

app = App(
    name="worker",
    help_epilogue="""Examples:

    dualwinch worker --storage postgresql+psycopg://me@host/studies --study sea
    DUALWINCH_STORAGE=postgresql+psycopg://me:secret@host/studies dualwinch worker --study sea
""",
)


@app.default
def worker(
    *,
    storage: Annotated[
        str | None, Parameter(help="postgresql+psycopg://USER@HOST/DATABASE.", env_var="DUALWINCH_STORAGE")
    ] = None,
    study: Annotated[str, Parameter(help="Name of the study.")] = "tuning",
    threads: Annotated[int | None, WHOLE, Parameter(help="Threads (default: one per core).")] = None,
    plugin: Plugins = None,
) -> None:
    """Join a study that `dualwinch tune` has started in a database, and work on it until it ends.

    Your own parts are imported from where they were when the study was started. On another machine, or if they have
    moved, --plugin says where they are; they must be unchanged.
    """
    from dualwinch.commands.progress import StatusLine

    with StatusLine("worker") as status:
        status.phase("joining the study")
        from dualwinch.commands.worker import worker as run

        use_parts(plugin)
        run(storage, study, threads, status)
