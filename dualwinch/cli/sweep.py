"""The command ``sweep``: an experiment over values of one or two keys, as tables, data and a figure.

The computation itself is the function ``dualwinch.sweep``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dualwinch.cli.options import CheckpointingWorkerOptions, ControllerOptions, Figure, Json
from dualwinch.cli.output import (
    check_file,
    numbers_between,
    print_figures,
    print_json,
    version_notes,
    write_figure,
    wrote,
)
from dualwinch.cli.progress import ProgressLine

if TYPE_CHECKING:
    from dualwinch.simulation.experiment import Experiment


def sweep(
    *over: str,
    given: ControllerOptions = ControllerOptions(),
    metric: list[str] | None = None,
    out: Path | None = None,
    plot: Figure = None,
    where: CheckpointingWorkerOptions = CheckpointingWorkerOptions(),
    json: Json = False,
) -> None:
    """Run one experiment over values of one or two keys, side by side on all cores.

    Any key of `dualwinch config` can be varied, including those that choose parts or change the compiled code. The
    figure is a line over one key, a heat map over two.

    Args:
        over: One or two keys: key=value,value or key=first:last:step or key=first:last:count:log.
        metric: Figure of merit to show (default mse); may be repeated.
        out: File for the data, a row per run with all figures of merit: .csv, .parquet, .npz.

    Examples:
        dualwinch sweep controller.observer.l0=1:20:1 --case 4
        dualwinch sweep controller.observer.l0=0.5:50:20:log --case 4 --metric mse --metric chatter --plot l0.png
        dualwinch sweep controller.kind=nftsm,adrc,pid-cascade simulation.delay_samples=0:4:1 --case 4 --out sweep.csv
        dualwinch sweep plant.vehicle.mass=8e3:1.2e4:500 controller.coordination.preload=1000:4000:250 --plot mass.svg
        dualwinch sweep reference.kind=profile,uniform --json
    """
    from dualwinch.simulation.results.file_formats import FORMATS, MIXED
    from dualwinch.simulation.sweep import sweep

    base, axes = given.experiment(), axes_from(over)
    given.check_apart(axes)
    metrics = checked_metrics(metric or ["mse"], base)
    check_file(out, *MIXED)
    with ProgressLine("simulating", command="sweep", patient=True) as progress, where.workers(progress) as workers:
        grid = sweep(base, axes, workers=workers, progress=progress)
    if json:
        print_json(grid.to_record() | version_notes())
    else:
        print_figures(grid.figures(metrics))
    if out:
        FORMATS[out.suffix.lower()].write(grid.content, out)
        wrote(out)
    write_figure(plot, lambda: grid.plot(metrics[0]))
    if grid.interrupted:
        raise where.interrupt


def checked_metrics(names: list[str], experiment: Experiment) -> list[str]:
    """Check the names of figures of merit that ``--metric`` gives, and return them.

    Raises:
        ConfigurationError: an unknown name.
    """
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.model.quantities.quantity import unknown
    from dualwinch.simulation.metrics.metrics import metric_quantities

    quantities = metric_quantities(experiment.metrics)
    for name in names:
        if name not in quantities:
            raise ConfigurationError(f"--metric {name}: {unknown('metric', name, quantities)}")
    return names


MOST_KEYS = 2
"""Most keys that a table or a figure can show."""


def axes_from(texts: Sequence[str]) -> dict[str, list[Any]]:
    """Parse the axes of a sweep: key → values.

    An axis is ``key=value,value``, ``key=first:last:step``, ``key=first:last:count:log`` or, as in TOML,
    ``key=[value, value]``.

    Raises:
        ConfigurationError: no axis, more than two, one key twice, or a text of another form.
    """
    from dualwinch.model.errors import ConfigurationError

    if not 1 <= len(texts) <= MOST_KEYS:
        raise ConfigurationError(
            f"give one or two keys with values, e.g. controller.observer.l0=1:20:1, not {len(texts)}"
        )
    axes: dict[str, list[Any]] = {}
    for text in texts:
        key, equals, values = (word.strip() for word in text.partition("="))
        if not (key and equals and values):
            raise ConfigurationError(
                f"{text!r}: must be key=value,value or key=first:last:step, e.g. controller.observer.l0=1:20:1"
            )
        if key in axes:
            raise ConfigurationError(f"{key}: is given twice")
        if "*" in key:
            raise ConfigurationError(f"{key}: must be one key, a sweep takes no patterns")
        axes[key] = _values(key, values)
    return axes


def _values(key: str, text: str) -> list[Any]:
    from dualwinch.config.toml_text import parse_assignment
    from dualwinch.model.errors import ConfigurationError

    if text.startswith("["):
        listed = parse_assignment(f"{key}={text}")[1]
        if not isinstance(listed, list):
            raise ConfigurationError(f"{key}={text}: must be a list as in TOML, e.g. {key}=[1, 2]")
        return listed
    if re.match(r"[\d.+-][^,]*(:|\.\.)", text):
        wrong = f"{key}={text}: must be first:last:step or first:last:count:log, e.g. {key}=1:9:2"
        return [*numbers_between(text, wrong)]
    return [parse_assignment(f"{key}={word}")[1] for word in text.split(",")]
