"""The command ``show``: the lab's page with the user's own run."""

from pathlib import Path

from dualwinch.toolbox import output
from dualwinch.toolboxes.lab.cli.lab import PAGES, Browser, page_of, write_page


def show(run: Path, /, *, out: Path | None = None, browser: Browser = False) -> None:
    """Write the lab's page with a run of your own, as run A to compare with.

    Args:
        run: A run that `simulate --out` has written: .parquet, .csv, .npz or .mat.
        out: The page (.html; default: beside the run).

    Examples:
        dualwinch simulate --case 4 --set controller.observer.l0=20 --out run.parquet
        dualwinch show run.parquet
        dualwinch show run.parquet --out run.html --browser
    """
    from dualwinch.toolbox import ConfigurationError, file_formats
    from dualwinch.toolboxes.lab.assemble import own_run

    if not run.is_file():
        raise ConfigurationError(f"cannot read {run}: no such file")
    file = out or run.with_suffix(".html")
    output.check_file(file, *PAGES)
    result = file_formats.load_result(run)
    if not len(result.columns.get("t", ())):
        raise ConfigurationError(f"{run}: holds no rows to draw")
    write_page(page_of(own_run(run.name, result)), file)
    if browser:
        import webbrowser

        webbrowser.open(file.absolute().as_uri())
