"""The command ``sensitivities``: derivatives of a run by parameters, as tables, data and a figure."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

from dualwinch.cli.options import ControllerOptions, Figure, Json
from dualwinch.cli.output import check_file, print_figures, print_json, version_notes, write_figure, wrote
from dualwinch.cli.progress import ProgressLine
from dualwinch.cli.sweep import checked_metrics

if TYPE_CHECKING:
    from dualwinch.simulation.experiment import Experiment


def sensitivities(
    *keys: str,
    given: ControllerOptions = ControllerOptions(),
    metric: list[str] | None = None,
    column: list[str] | None = None,
    out: Path | None = None,
    plot: Figure = None,
    json: Json = False,
) -> None:
    """Differentiate a run by parameters of plant, sensors, disturbance and controller, exactly.

    Any continuous parameter of these in `dualwinch config` may be given, and nominal.* for the controller's nominal
    model of the plant, which plant.* leaves unchanged. Random signals keep their draws, and quantised sensors are
    taken as continuous. Tables and figure show first-order changes for one more percent of each parameter.

    Args:
        keys: Keys of continuous parameters, also separated by commas; * stands for anything.
        metric: Figure of merit to show (default mse); may be repeated.
        column: Column of the result over time (default e); may be repeated.
        out: File for the columns and their derivatives: .csv, .parquet, .npz.

    Examples:
        dualwinch sensitivities "plant.vehicle.*" --case 4
        dualwinch sensitivities plant.vehicle.mass controller.observer.l0 --case 4 --metric mse --metric peak_tension
        dualwinch sensitivities "plant.rope_*.modulus" nominal.vehicle.mass --column F1 --column tau_1 --plot slopes.png
        dualwinch sensitivities "sensors.load_cell_*" --set simulation.readings=true --column F1_read --out slopes.csv
        dualwinch sensitivities "plant.winch_*.radius_error" sensors.position_bias --case 4 --json
    """
    from dualwinch.simulation.batch.effects import Effects
    from dualwinch.simulation.batch.sensitivities import sensitivities
    from dualwinch.simulation.prepare import check_memory
    from dualwinch.simulation.results.file_formats import FORMATS, MIXED

    base = given.experiment()
    metrics, columns = checked_metrics(metric or ["mse"], base), column or ["e"]
    values = values_of(keys, base)
    check_memory(base.samples, 1, (len(columns) + 1) * (len(values) + 1))
    check_file(out, *MIXED)
    with ProgressLine("differentiating", command="sensitivities", patient=True) as progress:
        derivatives = sensitivities(list(values), [list(values.values())], [base], columns=columns, progress=progress)
    if derivatives.interrupted:
        raise KeyboardInterrupt
    effects = Effects(base, values, derivatives)
    if json:
        print_json(effects.to_record() | version_notes())
    else:
        print_figures(effects.figures(metrics))
    if out:
        FORMATS[out.suffix.lower()].write(effects.content, out)
        wrote(out)
    write_figure(plot, effects.plot)


def values_of(words: Sequence[str], experiment: Experiment) -> dict[str, float]:
    """Key → value of the parameters that words name; `sensitivities` refuses those without a derivative.

    Raises:
        ConfigurationError: no key, or a pattern that matches none.
    """
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.simulation.batch.sensitivities import differentiable_numbers
    from dualwinch.simulation.settings import current

    numbers = differentiable_numbers(experiment)
    selection: dict[str, float] = {}
    for word in (part.strip() for text in words for part in text.split(",")):
        key = current(word)
        matching = [name for name in numbers if fnmatchcase(name, key)] if "*" in key else [key]
        if not matching:
            raise ConfigurationError(f"{word}: matches no parameter that runs can be differentiated by")
        selection |= {name: numbers.get(name, 0.0) for name in matching}
    if not selection:
        raise ConfigurationError('give keys to differentiate by, e.g. plant.vehicle.mass or "plant.rope_*.modulus"')
    return selection
