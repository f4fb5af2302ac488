"""The command ``identify``: a machine's numbers from its logs, as tables, files for other commands, and drawn."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from dualwinch.cli.doctor import versions
from dualwinch.cli.options import WHOLE, AssignmentsInBrief, Case, Config, Figure, Plugins, Priors, use_parts
from dualwinch.cli.output import terminal, write_figure, wrote
from dualwinch.cli.progress import ProgressLine

if TYPE_CHECKING:
    from dualwinch.identification.result import IdentificationResult
    from dualwinch.simulation.ensembles.ensemble import Ensemble
    from dualwinch.simulation.experiment import Experiment

app = App(
    name="identify",
    help_epilogue="""Examples:

    dualwinch simulate --case 4 --set simulation.readings=true --out run.parquet    # a log, for want of one
    dualwinch identify run.parquet --fit plant.vehicle.mass,plant.vehicle.drag_coefficient --case 4
    dualwinch identify run.parquet --fit "plant.rope_*.modulus" --hold-out 20% --plot fit.png --out fitted.toml
    dualwinch identify a.csv b.csv --ensemble rig --fit plant.vehicle.mass --column F1=load_cell_left:kN
    dualwinch identify run.mat --fit plant.vehicle.mass,sensors.load_cell_zero_* --prior plant.vehicle.mass=1e4+-500
    dualwinch identify run.parquet --fit plant.vehicle.mass --disturbance force.parquet
    dualwinch simulate --set disturbance.force.file=force.parquet    # the sea of that log, again
    dualwinch tune --ensemble fitted-ensemble.toml --time 60s    # gains for the machines that the logs allow for
""",
)


@app.default
def identify(
    logs: Annotated[list[Path], Parameter(help="Logs of one machine: .csv, .parquet, .mat or .npz.", negative="")],
    *,
    fit: Annotated[
        list[str],
        Parameter(help="Keys to estimate, separated by commas; * stands for anything; may be repeated.", negative=""),
    ],
    case: Case = None,
    config: Config = None,
    ensemble: Annotated[
        str | None,
        Parameter(
            help="Ensemble, such as `rig`: parameters that it draws are estimated, too, with its distributions as "
            "priors, where logs can identify them."
        ),
    ] = None,
    set_: AssignmentsInBrief = None,
    prior: Priors = None,
    column: Annotated[
        list[str] | None,
        Parameter(help="Where a reading is found, F1=load_cell_left:kN; may be repeated.", negative=""),
    ] = None,
    hold_out: Annotated[str, Parameter(help="Share of each log, its end, that is held out and predicted.")] = "0%",
    starts: Annotated[int, WHOLE, Parameter(help="Searches from different starts, which find distinct optima.")] = 1,
    seed: Annotated[int, WHOLE, Parameter(help="Seed of these starts, and of the ensemble's draws.")] = 0,
    profile: Annotated[
        list[str] | None,
        Parameter(help="Keys whose profile likelihood is computed; may be repeated.", negative=""),
    ] = None,
    disturbance: Annotated[
        Path | None,
        Parameter(help="File for what acted on the vehicle, .csv or .parquet; disturbance.force.file takes it."),
    ] = None,
    unrecorded: Annotated[
        str,
        Parameter(
            help="RMS torque or force that is not recorded, over the recorded one, from which on a fit is refused as "
            "one of another machine."
        ),
    ] = "10%",
    plugin: Plugins = None,
    out: Annotated[
        Path | None,
        Parameter(help="File for the machine, .toml; beside it go NAME-ensemble.toml and NAME.json."),
    ] = None,
    plot: Figure = None,
) -> None:
    """Estimate parameters of a machine from its logs, by maximum likelihood.

    The torques of a log drive the plant, an extended Kalman filter predicts all readings one sample ahead, and the
    parameters maximise the likelihood of its innovations. Prints estimates with standard deviations, unidentifiable
    directions, and whiteness tests of the innovations.
    """
    from dualwinch.config.folders import check_folder
    from dualwinch.identification.identify import identify
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.simulation.results.file_formats import format_of

    use_parts(plugin)
    share, most = _share("--hold-out", hold_out), _share("--unrecorded", unrecorded)
    known = dict(map(prior_from, prior or []))
    if out and out.suffix.lower() != ".toml":
        raise ConfigurationError(f"--out {out}: must end in .toml")
    if disturbance:
        format_of(disturbance)
        check_folder(disturbance.parent)
    experiment, drawn = prior_model(case, config, ensemble, set_ or [])
    with ProgressLine("fitting") as progress:
        found = identify(
            list(logs),
            fit,
            experiment,
            ensemble=drawn,
            priors=known,
            columns=column or [],
            hold_out=share,
            starts=starts,
            seed=seed,
            profiles=profile or [],
            forces=disturbance is not None,
            unrecorded=most,
            progress=progress,
        )
    terminal(soft_wrap=True).print(repr(found), highlight=False)
    written = [*(write_identified(out, found, seed) if out else [])]
    written += write_forces(disturbance, found) if disturbance else []
    if plot:
        write_figure(plot, found.plot())
    for file in written:
        wrote(file)


def prior_model(
    case: int | None, config: Path | None, ensemble: str | None, assignments: Sequence[str]
) -> tuple[Experiment | None, Ensemble | None]:
    """The prior model that options describe: an experiment or an ensemble.

    Raises:
        ConfigurationError: both, or anything wrong with one.
    """
    from dualwinch.config.ensemble_file import load_ensemble, reset
    from dualwinch.config.experiment_file import experiment_from
    from dualwinch.config.toml_text import parse_assignment
    from dualwinch.model.errors import ConfigurationError

    if not ensemble:
        return experiment_from(case, config, None, assignments), None
    if case is not None or config:
        raise ConfigurationError("give --ensemble, which has an experiment of its own, or --case or --config")
    return None, reset(load_ensemble(ensemble), dict(map(parse_assignment, assignments)))


def write_forces(file: Path, found: IdentificationResult) -> list[Path]:
    """Write the force on the vehicle in each log, as ``disturbance.force.file`` takes it.

    Returns:
        The files: the one, or of several logs NAME-1, NAME-2, ...
    """
    from dualwinch.simulation.results.file_formats import format_of

    many = len(found.forces) > 1
    files = [file.with_stem(f"{file.stem}-{k}") if many else file for k in range(1, len(found.forces) + 1)]
    for path, force in zip(files, found.forces, strict=True):
        format_of(path).write(force.content, path)
    return files


def write_identified(out: Path, found: IdentificationResult, seed: int) -> list[Path]:
    """Write the machine, the ensemble of machines that the logs allow for, and all numbers as JSON.

    Returns:
        The files.
    """
    from dualwinch.codegen.files import atomic
    from dualwinch.config.ensemble_file import ensemble_to_toml
    from dualwinch.config.experiment_file import to_toml

    beside = out.with_name(f"{out.stem}-ensemble.toml"), out.with_suffix(".json")
    record = found.to_record() | {f"version_{name}": version for name, version in versions().items()}
    texts = (
        to_toml(found.experiment),
        ensemble_to_toml(found.ensemble(out.stem, seed)),
        json.dumps(record, indent=1, allow_nan=False) + "\n",
    )
    files = [out, *beside]
    for file, text in zip(files, texts, strict=True):
        with atomic(file) as unfinished:
            unfinished.write_text(text, encoding="utf-8")
    return files


def _share(option: str, text: str) -> float:
    from dualwinch.model.errors import ConfigurationError

    parts = re.fullmatch(r"\s*([0-9.]+)\s*(%?)\s*", text)
    try:
        value = float(parts[1]) / (100 if parts[2] else 1) if parts else -1.0
    except ValueError:
        value = -1.0
    if not 0 <= value < 1:
        raise ConfigurationError(f"{option} {text}: must be 0% to less than 100%, e.g. 20%")
    return value


def prior_from(text: str) -> tuple[str, tuple[float, float]]:
    """A key with mean and deviation, from a text such as ``plant.vehicle.mass=1e4±500``.

    Raises:
        ConfigurationError: anything else.
    """
    from dualwinch.model.errors import ConfigurationError

    parts = re.fullmatch(r"\s*([\w.]+)\s*=\s*(\S+?)\s*(?:±|\+-)\s*(\S+)\s*", text)
    values: Any = (parts[2], parts[3]) if parts else ("", "")
    try:
        mean, deviation = map(float, values)
    except ValueError:
        mean = deviation = -1.0
    if not parts or not 0 < deviation < float("inf") or abs(mean) == float("inf"):
        raise ConfigurationError(f"--prior {text}: must be KEY=MEAN±DEVIATION, e.g. plant.vehicle.mass=1e4±500")
    return parts[1], (mean, deviation)
