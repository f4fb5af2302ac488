"""The command ``sweep``: an experiment over values of one or two keys, its tables, its data and its figure.

The module does not bear the command's name: that is the function ``dualwinch.sweep``, which does the work.
"""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from dualwinch.commands.folders import check_folder
from dualwinch.commands.output import terminal
from dualwinch.commands.progress import ProgressLine
from dualwinch.commands.simulate import check_plot
from dualwinch.commands.sweep_axes import axes_from
from dualwinch.commands.sweep_tables import as_json, content_of, print_sweep
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import nearest
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metrics import BUILT_IN
from dualwinch.simulation.results.file_formats import FORMATS, FileContent
from dualwinch.simulation.sweep import sweep

SUFFIXES = (".csv", ".parquet", ".npz")
"""Formats that hold words beside numbers."""


def run_sweep(
    experiment: Experiment,
    over: Sequence[str],
    metrics: Sequence[str],
    *,
    out: Path | None,
    plot: Path | None,
    json: bool,
) -> None:
    """Run, print, write. Everything that can be wrong with words and files is found before the runs.

    Args:
        experiment: where all other values come from.
        over: keys and values, as for `axes_from`.
        metrics: figures of merit to print; the figure shows the first.
        out: file of the data.
        plot: file of the figure.
        json: whether JSON is printed, and no table.

    Raises:
        ConfigurationError: anything wrong with a key, a value, a name or a file.
        KeyboardInterrupt: interrupted; what was finished is printed and written.
    """
    axes = axes_from(over)
    known = (*BUILT_IN, *(metric.table() for metric in experiment.metrics))
    for name in metrics:
        if name not in known:
            raise ConfigurationError(f"--metric {name}: unknown metric; did you mean '{nearest(name, known)}'?")
    write = writer(out) if out else None
    check_plot(plot)
    console = terminal(stderr=True)
    with ProgressLine("simulating") as progress:
        found = sweep(experiment, axes, progress=progress)
    if json:
        sys.stdout.write(as_json(found) + "\n")
    else:
        print_sweep(found, metrics)
    if out and write:
        write(content_of(found), out)
        console.print(f"wrote {out}")
    if plot:
        from dualwinch.simulation.plots import save as save_figure

        save_figure(found.plot(metrics[0]), plot)
        console.print(f"wrote {plot}")
    if found.interrupted:
        raise KeyboardInterrupt


def writer(out: Path) -> Callable[[FileContent, Path], None]:
    """What writes a file of words and numbers.

    Raises:
        ConfigurationError: unknown suffix, or a folder that cannot be written to.
    """
    if out.suffix.lower() not in SUFFIXES:
        raise ConfigurationError(f"{out.name}: unknown suffix {out.suffix!r}; must be one of {', '.join(SUFFIXES)}")
    check_folder(out.parent)
    return FORMATS[out.suffix.lower()].write
