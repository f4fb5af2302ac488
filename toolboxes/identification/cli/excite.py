"""The command ``excite``: optimal experiment design for identification."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from dualwinch.toolbox import ProgressLine, options, output
from dualwinch.toolboxes.identification.cli.identify import prior_from


def default_max_trials() -> int:
    """The default of an option, imported for the help alone."""
    from dualwinch.toolboxes.identification.options import DEFAULTS

    return DEFAULTS.excitation.max_trials


def excite(
    *,
    fit: list[str],
    given: options.ExperimentOptions = options.ExperimentOptions(),
    ensemble: str | None = None,
    prior: options.Priors = None,
    duration: Annotated[str | None, options.default_of("excite", "duration", "{:g}s")] = None,
    criterion: Annotated[Literal["D", "A"] | None, options.default_of("excite", "criterion")] = None,
    track: float | None = None,
    speed: float | None = None,
    acceleration: float | None = None,
    torque: float | None = None,
    trials: Annotated[
        options.Whole,
        options.default_of(default_max_trials, words="{} without --time"),
    ] = None,
    time: str | None = None,
    seed: Annotated[options.Whole, options.default_of("excite", "seed")] = None,
    out: Path | None = None,
    plot: options.Figure = None,
    json: options.Json = False,
) -> None:
    """Design the experiment that identifies parameters of a machine best (D- or A-optimal).

    Motions through way-points, within limits of track, speed, tension and torque, are simulated in the closed loop;
    the filter of `identify` gives the Fisher information of each log. Prints the expected standard deviations beside
    those of the present motion.

    Args:
        fit: Keys to estimate, separated by commas; * stands for anything.
        ensemble: Ensemble, such as `rig`; identifiable parameters that it draws are estimated, too.
        duration: Length of the run, e.g. 60s, 2min.
        criterion: D: volume of the estimates' confidence region; A: mean of their variances.
        track: Farthest position in m (default: a metre before the end).
        speed: Largest speed in m/s (default: the reference's).
        acceleration: Largest acceleration in m/s^2 (default: that of half the ropes' largest net force).
        torque: Largest torque of a motor in N m (default: any).
        trials: Motions to simulate at least; the search completes the generation that reaches them.
        time: Time of the search, e.g. 60s, 5min.
        seed: Seed of the search.
        out: File for the experiment with that motion, .toml.

    Examples:
        dualwinch excite --fit plant.vehicle.mass,plant.vehicle.drag_coefficient --case 4 --out exciting.toml
        dualwinch excite --fit "plant.rope_*.modulus" --duration 30s --speed 1 --track 40 --time 2min
        dualwinch excite --ensemble rig --fit plant.vehicle.mass --criterion A --plot exciting.png
        dualwinch simulate --config exciting.toml --out run.parquet    # the run with that motion
    """
    from dualwinch.toolbox import experiment_file
    from dualwinch.toolboxes.identification.experiment_design import excite
    from dualwinch.toolboxes.identification.options import DEFAULTS

    search = DEFAULTS.excitation
    length = options.seconds_from(duration, "--duration", search.min_duration, search.max_duration)
    key_priors = dict(map(prior_from, prior or []))
    limit = options.seconds_from(time)
    output.check_file(out, ".toml")
    with ProgressLine("searching", command="excite", patient=True) as progress:
        design = excite(
            fit,
            None if ensemble else given.experiment(),
            ensemble=given.ensemble(ensemble) if ensemble else None,
            priors=key_priors,
            track=track,
            speed=speed,
            acceleration=acceleration,
            torque=torque,
            trials=trials,
            seconds=limit,
            progress=progress,
            **options.stated(duration=length, criterion=criterion, seed=seed),
        )
    if json:
        output.print_json(design.to_record() | output.version_notes())
    else:
        output.terminal(soft_wrap=True).print(repr(design), highlight=False)
    output.write_text(out, lambda: experiment_file.to_toml(design.experiment))
    output.write_figure(plot, design.plot)
    if design.interrupted:
        raise KeyboardInterrupt(
            f"this is the best of {design.tried} motions; the same call searches from the beginning"
        )
