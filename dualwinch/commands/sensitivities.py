"""The command ``sensitivities``: how a run changes with its numbers, as tables, data and a figure."""

import sys
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path

from dualwinch.commands.output import terminal
from dualwinch.commands.sensitivities_tables import Effects, as_json, content_of, print_effects
from dualwinch.commands.simulate import check_plot
from dualwinch.commands.sweep_run import writer
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import nearest
from dualwinch.simulation.batch.sensitivities import differentiable_numbers, sensitivities
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metrics import BUILT_IN
from dualwinch.simulation.prepare import check_memory
from dualwinch.simulation.settings import current


def run_sensitivities(
    experiment: Experiment,
    keys: Sequence[str],
    metrics: Sequence[str],
    columns: Sequence[str],
    *,
    out: Path | None,
    plot: Path | None,
    json: bool,
) -> None:
    """Run, print, write. Everything that can be wrong with words and files is found before the run.

    Args:
        experiment: what is run.
        keys: what to differentiate by; patterns, also separated by commas.
        metrics: figures of merit to print.
        columns: columns of the result to print, draw and write.
        out: file of the data.
        plot: file of the figure.
        json: whether JSON is printed, and no table.

    Raises:
        ConfigurationError: anything wrong with a key, a name or a file.
        KeyboardInterrupt: interrupted.
    """
    values = values_of(keys, experiment)
    known = (*BUILT_IN, *(metric.table() for metric in experiment.metrics))
    for name in metrics:
        if name not in known:
            raise ConfigurationError(f"--metric {name}: unknown metric; did you mean '{nearest(name, known)}'?")
    check_memory(experiment.samples, 1, (len(columns) + 1) * (len(values) + 1))
    write = writer(out) if out else None
    check_plot(plot)
    console = terminal(stderr=True)
    with console.status("differentiating"):
        found = sensitivities(list(values), [list(values.values())], [experiment], columns=columns)
    if found.interrupted:
        raise KeyboardInterrupt
    effects = Effects(experiment, values, found)
    if json:
        sys.stdout.write(as_json(effects) + "\n")
    else:
        print_effects(effects, metrics)
    if out and write:
        write(content_of(effects), out)
        console.print(f"wrote {out}")
    if plot:
        from dualwinch.simulation.plots import save as save_figure
        from dualwinch.simulation.plots.analyses import effects_figure

        save_figure(effects_figure(experiment, effects.changes(), effects.found.quantities), plot)
        console.print(f"wrote {plot}")


def values_of(words: Sequence[str], experiment: Experiment) -> dict[str, float]:
    """Key → value of the numbers that some words name; those without a derivative are left to be refused by name.

    Raises:
        ConfigurationError: none, or a word that names nothing.
    """
    known = differentiable_numbers(experiment)
    found: dict[str, float] = {}
    for word in (part.strip() for text in words for part in text.split(",")):
        key = current(word)
        matching = [name for name in known if fnmatchcase(name, key)] if "*" in key else [key]
        if not matching:
            raise ConfigurationError(f"{word}: no number that runs can be differentiated by has such a key")
        found |= {name: known.get(name, 0.0) for name in matching}
    if not found:
        raise ConfigurationError('give keys to differentiate by, e.g. plant.vehicle.mass or "plant.rope_*.modulus"')
    return found
