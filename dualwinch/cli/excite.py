"""The command ``excite``: optimal experiment design for identification."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from dualwinch.cli.identify import prior_from
from dualwinch.cli.options import (
    EXPERIMENT,
    WHOLE,
    ExperimentOptions,
    Figure,
    Json,
    Priors,
    default_of,
    seconds_from,
    stated,
)
from dualwinch.cli.output import (
    FIGURE_SUFFIXES,
    check_file,
    print_json,
    terminal,
    version_notes,
    write_figure,
    write_text,
)
from dualwinch.cli.progress import ProgressLine

app = App(
    name="excite",
    help_epilogue="""Examples:

    dualwinch excite --fit plant.vehicle.mass,plant.vehicle.drag_coefficient --case 4 --out exciting.toml
    dualwinch excite --fit "plant.rope_*.modulus" --duration 30s --speed 1 --track 40 --time 2min
    dualwinch excite --ensemble rig --fit plant.vehicle.mass --criterion A --plot exciting.png
    dualwinch simulate --config exciting.toml --out run.parquet    # the run with that motion
""",
)


EXCITE = "excite"
"""Public function whose defaults the options have."""


@app.default
def excite(
    *,
    fit: Annotated[
        list[str],
        Parameter(help="Keys to estimate, separated by commas; * stands for anything.", negative=""),
    ],
    given: ExperimentOptions = EXPERIMENT,
    ensemble: Annotated[
        str | None,
        Parameter(help="Ensemble, such as `rig`; identifiable parameters that it draws are estimated, too."),
    ] = None,
    prior: Priors = None,
    duration: Annotated[
        str | None, default_of(EXCITE, "duration", "{:g}s"), Parameter(help="Length of the run, e.g. 60s, 2min.")
    ] = None,
    criterion: Annotated[
        Literal["D", "A"] | None,
        default_of(EXCITE, "criterion"),
        Parameter(help="D: volume of the estimates' confidence region; A: mean of their variances."),
    ] = None,
    track: Annotated[float | None, Parameter(help="Farthest position in m (default: a metre before the end).")] = None,
    speed: Annotated[float | None, Parameter(help="Largest speed in m/s (default: the reference's).")] = None,
    acceleration: Annotated[
        float | None,
        Parameter(help="Largest acceleration in m/s^2 (default: that of half the ropes' largest net force)."),
    ] = None,
    torque: Annotated[float | None, Parameter(help="Largest torque of a motor in N m (default: any).")] = None,
    trials: Annotated[
        int | None,
        WHOLE,
        default_of("identification.options:DEFAULTS.excitation.max_trials", words="{} without --time"),
        Parameter(help="Motions to simulate."),
    ] = None,
    time: Annotated[str | None, Parameter(help="Time of the search, e.g. 60s, 5min.")] = None,
    seed: Annotated[int | None, WHOLE, default_of(EXCITE, "seed"), Parameter(help="Seed of the search.")] = None,
    out: Annotated[Path | None, Parameter(help="File for the experiment with that motion, .toml.")] = None,
    plot: Figure = None,
    json: Json = False,
) -> None:
    """Design the experiment that identifies parameters of a machine best (D- or A-optimal).

    Motions through way-points, within limits of track, speed, tension and torque, are simulated in the closed loop;
    the filter of `identify` gives the Fisher information of each log. Prints the expected standard deviations beside
    those of the present motion.
    """
    from dualwinch.config.experiment_file import to_toml
    from dualwinch.identification.experiment_design import excite
    from dualwinch.identification.options import DEFAULTS

    search = DEFAULTS.excitation
    length = (
        None if duration is None else seconds_from(duration, "--duration", search.min_duration, search.max_duration)
    )
    known = dict(map(prior_from, prior or []))
    limit = None if time is None else seconds_from(time)
    check_file(out, ".toml")
    check_file(plot, *FIGURE_SUFFIXES)
    with ProgressLine("searching") as progress:
        found = excite(
            fit,
            None if ensemble else given.experiment(),
            ensemble=given.ensemble(ensemble) if ensemble else None,
            priors=known,
            track=track,
            speed=speed,
            acceleration=acceleration,
            torque=torque,
            trials=trials,
            seconds=limit,
            progress=progress,
            **stated(duration=length, criterion=criterion, seed=seed),
        )
    if json:
        print_json(found.to_record() | version_notes())
    else:
        terminal(soft_wrap=True).print(repr(found), highlight=False)
    write_text(out, lambda: to_toml(found.experiment))
    write_figure(plot, found.plot)
