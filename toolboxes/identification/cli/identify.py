"""The command ``identify``: parameters of a machine from its logs, as tables, files and a figure."""

from __future__ import annotations

import re
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from dualwinch.toolbox import ProgressLine, options, output

if TYPE_CHECKING:
    from dualwinch.toolboxes.identification.options import EstimationOptions
    from dualwinch.toolboxes.identification.result import IdentificationResult


def default_max_unrecorded() -> float:
    """The default of an option, imported for the help alone."""
    from dualwinch.toolboxes.identification.options import DEFAULTS

    return DEFAULTS.plausibility.max_unrecorded


def identify(
    *logs: Path,
    fit: list[str] | None = None,
    given: options.ExperimentOptions = options.ExperimentOptions(),
    ensemble: str | None = None,
    prior: options.Priors = None,
    column: list[str] | None = None,
    csv: str = "",
    hold_out: Annotated[str | None, options.default_of("identify", "hold_out", "{:.0%}")] = None,
    starts: Annotated[options.Whole, options.default_of("identify", "starts")] = None,
    seed: Annotated[int, options.WHOLE] = 0,
    profile: list[str] | None = None,
    disturbance: Path | None = None,
    unrecorded: Annotated[
        str | None,
        options.default_of(default_max_unrecorded, words="{:.0%}"),
    ] = None,
    plain: bool = False,
    alternatives: list[str] | None = None,
    data_sheet: list[str] | None = None,
    out: Path | None = None,
    plot: options.Figure = None,
    where: options.CheckpointingWorkerOptions = options.CheckpointingWorkerOptions(),
    json: options.Json = False,
) -> None:
    """Estimate parameters of a machine from its logs, by maximum likelihood.

    The torques of a log drive the plant, an extended Kalman filter predicts all readings one sample ahead, and the
    parameters maximise the likelihood of its innovations. Prints estimates with standard deviations, unidentifiable
    directions, and whiteness tests of the innovations.

    Args:
        logs: Logs of one machine: .csv, .txt, .parquet, .mat or .npz.
        fit: Keys to estimate, separated by commas; * stands for anything; may be repeated.
        ensemble: Ensemble, such as `rig`; parameters that it draws are estimated, too, with its distributions as
            priors, where logs can identify them.
        column: Column and unit of a reading, F1=load_cell_left:kN, or its number, F1=3; times also t=1ms or
            t=sec+nanosec; may be repeated.
        csv: Separator and decimal mark of CSV files, such as ';,'; default: detected in each file.
        hold_out: Share at the end of each log that is held out and predicted.
        starts: Searches from different starting points, to find distinct optima.
        seed: Seed of these starts, and of the ensemble's draws.
        profile: Keys whose profile likelihood is computed; may be repeated.
        disturbance: File for the force on the vehicle, .csv or .parquet, for disturbance.force.file.
        unrecorded: Largest RMS of unrecorded torque or force over the recorded one; above it a fit is refused as one of
            another machine. Where it is given, improbable nuisance parameters are accepted, too.
        plain: Fit the experiment as described only, without alternatives such as a recorder's own clock or a sea.
        alternatives: Alternatives that are compared with the experiment as described: sea,load-cell-lag or all,-sea;
            --alternatives list shows them; may be repeated.
        data_sheet: Standard deviation of a sensor or motor by its data sheet, such as load_cell_error=0.5% or
            torque_error=0; may be repeated.
        out: File for the machine, .toml; beside it go NAME-ensemble.toml and NAME.json.

    Examples:
        dualwinch simulate --case 4 --set simulation.readings=true --out run.parquet    # makes a log
        dualwinch identify run.parquet --fit plant.vehicle.mass,plant.vehicle.drag_coefficient --case 4
        dualwinch identify run.parquet --fit "plant.rope_*.modulus" --hold-out 20% --plot fit.png --out fitted.toml
        dualwinch identify a.csv b.csv --ensemble rig --fit plant.vehicle.mass --column F1=load_cell_left:kN
        dualwinch identify run.mat --fit plant.vehicle.mass,sensors.load_cell_zero_* --prior plant.vehicle.mass=1e4+-500
        dualwinch identify run.parquet --fit plant.vehicle.mass --disturbance force.parquet
        dualwinch simulate --set disturbance.force.file=force.parquet    # the disturbance of that log
        dualwinch tune --ensemble fitted-ensemble.toml --time 60s    # gains for the machines consistent with the logs
    """
    from dualwinch.toolbox import (
        ConfigurationError,
        ensemble_file,
        experiment_file,
        file_formats,
        idealisations,
        tables,
    )
    from dualwinch.toolboxes.identification.alternatives import ALTERNATIVES
    from dualwinch.toolboxes.identification.identify import identify

    if alternatives == ["list"]:
        rows = [[kind, each.meaning] for kind, each in ALTERNATIVES.items()]
        output.terminal(soft_wrap=True).print(tables.markdown(["alternative", "meaning"], rows), highlight=False)
        return
    if not logs:
        raise ConfigurationError("give at least one log: .csv, .txt, .parquet, .mat or .npz")
    if not fit:
        raise ConfigurationError("--fit: give keys to estimate, e.g. --fit plant.vehicle.mass")
    share = options.share_from(hold_out, "--hold-out", 0.2, zero=True)
    limit = options.share_from(unrecorded, "--unrecorded", 0.2, zero=True)
    key_priors = dict(map(prior_from, prior or []))
    output.check_file(out, ".toml")
    output.check_file(disturbance, *file_formats.FORMATS)
    with ProgressLine("fitting", command="identify") as progress, where.workers(progress) as workers:
        result = identify(
            logs,
            fit,
            None if ensemble else given.experiment(),
            ensemble=given.ensemble(ensemble) if ensemble else None,
            priors=key_priors,
            columns=column or [],
            csv=csv,
            seed=seed,
            profiles=profile or [],
            forces=disturbance is not None,
            workers=workers,
            unrecorded=limit,
            progress=progress,
            plain=plain,
            alternatives=alternatives or [],
            options=options_with(data_sheet or []),
            **options.stated(hold_out=share, starts=starts),
        )
    left_out = idealisations.idealisations(result.experiment)
    facts = result.to_record() | {"idealisations": [asdict(one) for one in left_out]} | output.version_notes()
    if json:
        output.print_json(facts)
    else:
        output.terminal(soft_wrap=True).print(repr(result), highlight=False)
        output.print_idealisations(left_out)
    if out:
        output.write_text(out, lambda: experiment_file.to_toml(result.experiment))
        ensemble_path = out.with_name(f"{out.stem}-ensemble.toml")
        output.write_text(ensemble_path, lambda: ensemble_file.ensemble_to_toml(result.ensemble(out.stem, seed)))
        output.write_json(out.with_suffix(".json"), facts)
    if disturbance:
        for file in write_forces(disturbance, result):
            output.wrote(file)
    output.write_figure(plot, result.plot)
    if result.interrupted:
        raise KeyboardInterrupt


def write_forces(file: Path, result: IdentificationResult) -> list[Path]:
    """Write the force on the vehicle in each log, for ``disturbance.force.file``.

    Returns:
        The files: one, or NAME-1, NAME-2, ... for several logs.
    """
    from dualwinch.toolbox import file_formats

    many = len(result.forces) > 1
    files = [file.with_stem(f"{file.stem}-{k}") if many else file for k in range(1, len(result.forces) + 1)]
    for path, force in zip(files, result.forces, strict=True):
        file_formats.format_of(path).write(force.content, path)
    return files


def options_with(data_sheet: list[str]) -> EstimationOptions:
    """The default options with other deviations by data sheets, each such as ``load_cell_error=0.5%``.

    Raises:
        ConfigurationError: another form, an unknown name, or a deviation out of its range.
    """
    from dualwinch.toolbox import ConfigurationError, quantities
    from dualwinch.toolboxes.identification.options import DEFAULTS

    sheet = DEFAULTS.data_sheet
    for text in data_sheet:
        name, _, value = (part.strip() for part in text.partition("="))
        if not hasattr(sheet, name):
            hint = quantities.suggestion(name, vars(sheet))
            raise ConfigurationError(f"--data-sheet {text}: must be NAME=DEVIATION, e.g. load_cell_error=0.5%; {hint}")
        try:
            deviation = float(value.removesuffix("%")) / (100 if value.endswith("%") else 1)
        except ValueError:
            raise ConfigurationError(f"--data-sheet {text}: must be a number or a percentage, e.g. 0.5%") from None
        sheet = replace(sheet, **{name: deviation})
    return replace(DEFAULTS, data_sheet=sheet)


def prior_from(text: str) -> tuple[str, tuple[float, float]]:
    """Parse ``key=mean±sd``, such as ``plant.vehicle.mass=1e4±500``, into key, mean and standard deviation.

    Raises:
        ConfigurationError: another form.
    """
    from dualwinch.toolbox import ConfigurationError

    parts = re.fullmatch(r"\s*([\w.]+)\s*=\s*(\S+?)\s*(?:±|\+-)\s*(\S+)\s*", text)
    try:
        if parts:
            return parts[1], (float(parts[2]), float(parts[3]))
    except ValueError:
        pass
    raise ConfigurationError(f"--prior {text}: must be KEY=MEAN±DEVIATION, e.g. plant.vehicle.mass=1e4±500")
