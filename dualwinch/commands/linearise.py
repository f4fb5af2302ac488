"""The command ``linearise``: the plant at an operating point or along a sweep, its modes, its data and its figure.

The module does not bear the command's name: importing it would hide the function ``dualwinch.linearise``.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from dualwinch.commands.folders import check_folder
from dualwinch.commands.linearise_tables import print_point, print_sweep
from dualwinch.commands.ranges import numbers_between
from dualwinch.commands.simulate import check_plot
from dualwinch.commands.terminal import terminal
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.linearisation import linearise_at
from dualwinch.model.linear.modes import track_modes
from dualwinch.model.linear.operating_point import OperatingPoint, operating_points
from dualwinch.model.linear.system import LinearSystem, save_sweep, writer
from dualwinch.model.quantities.quantity import nearest
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override

Loop: TypeAlias = Callable[[Experiment, Sequence[OperatingPoint], float | None], list[LinearSystem]]
"""What linearises an experiment at operating points; the last argument is the sample time asked for, in s."""

FigureName: TypeAlias = Literal["amplitude", "bode", "modes", "poles", "shapes"]

SWEPT = ("x", "v", "preload")


def open_loop(experiment: Experiment, points: Sequence[OperatingPoint], dt: float | None) -> list[LinearSystem]:
    """The plant alone, from motor torques, disturbance force and current."""
    return linearise_at(points, experiment.plant, dt)


LOOPS: dict[str, Loop] = {"open": open_loop}
"""`--loop` → what linearises."""


def linearise(
    experiment: Experiment,
    given: dict[str, float | None],
    sweep: str | None,
    *,
    loop: str,
    cut: str | None,
    dt: float | None,
    out: Path | None,
    plot: Path | None,
    figure: FigureName | None,
) -> None:
    """Linearise, print, write. Everything that can be wrong with the files is found before.

    Args:
        experiment: plant, controller and sample time.
        given: x, v and preload, where they were given.
        sweep: as for `grid`.
        loop: ``open``, ``closed`` or ``broken``.
        cut: where the loop is broken.
        dt: sample time in s of a discrete plant.
        out: file of the matrices.
        plot: file of the figure.
        figure: which figure.
    """
    if given["preload"] is not None:
        experiment = override(experiment, {"controller.coordination.preload": float(given["preload"])})
    if out:
        writer(out)
        check_folder(out.parent)
    check_plot(plot)
    if figure and not plot:
        raise ConfigurationError("--figure: needs --plot")
    if loop != "open":
        from dualwinch.commands.linearise_loop import linearise_loop

        swept = _swept_name(sweep) if sweep else None
        values = grid(given, sweep, experiment)
        linearise_loop(experiment, values, swept, loop=loop, cut=cut, dt=dt, out=out, plot=plot, figure=figure)
        return
    _check_figure(figure, sweep)
    values = grid(given, sweep, experiment)
    points = _operating_points(experiment, values)
    console = terminal(stderr=True)
    with console.status("linearising"):
        systems = LOOPS[loop](experiment, points, dt)
        tracks = track_modes(systems, experiment.plant)
    if sweep is None:
        print_point(systems[0], points[0], experiment.plant)
    else:
        print_sweep(tracks, points, _swept_name(sweep))
    if out:
        systems[0].save(out) if sweep is None else save_sweep(systems, out)
        console.print(f"wrote {out}")
    if plot:
        with console.status(f"drawing {plot}"):
            _draw(systems, experiment, _swept_name(sweep) if sweep else None, plot, figure)
        console.print(f"wrote {plot}")


def _check_figure(figure: FigureName | None, sweep: str | None) -> None:
    if figure == "amplitude":
        raise ConfigurationError("--figure amplitude: needs --loop broken")
    if sweep is None and figure in {"modes", "poles"}:
        raise ConfigurationError(f"--figure {figure}: needs --sweep")
    if sweep is not None and figure == "shapes":
        raise ConfigurationError("--figure shapes: shows one operating point; give no --sweep")


def grid(given: dict[str, float | None], sweep: str | None, experiment: Experiment) -> dict[str, list[float]]:
    """Values of x, v and preload at every point.

    Args:
        given: those given on the command line.
        sweep: ``name=first:last:step``, the last one included; None: one point.
        experiment: gives the preload where it is not given.

    Raises:
        ConfigurationError: an unknown name, no range, or a name both given and swept.
    """
    defaults = {"x": experiment.plant.track.length / 2, "v": 0.0, "preload": experiment.controller.limits.preload}
    values = {name: [defaults[name] if given[name] is None else float(given[name] or 0.0)] for name in SWEPT}
    if sweep is not None:
        name = _swept_name(sweep)
        if given[name] is not None:
            raise ConfigurationError(f"--{name} and --sweep {name}: give one of them")
        values[name] = _range(sweep)
    return values


def _swept_name(sweep: str) -> str:
    name = sweep.partition("=")[0].strip()
    if name not in SWEPT:
        raise ConfigurationError(
            f"--sweep {sweep}: unknown name '{name}'; did you mean '{nearest(name, SWEPT)}'? "
            f"One of {', '.join(SWEPT)} can be swept"
        )
    return name


def _range(sweep: str) -> list[float]:
    name, _, text = sweep.partition("=")
    values = numbers_between(text, f"--sweep {sweep}: must be name=first:last:step, e.g. x=1:47:2")
    if len(values) < 2:
        raise ConfigurationError(f"--sweep {sweep}: one point only; give --{name} {values[0]:g}")
    return [float(value) for value in values]


def _operating_points(experiment: Experiment, values: dict[str, list[float]]) -> list[OperatingPoint]:
    limits = experiment.controller.limits
    return operating_points(
        np.array(values["x"]),
        np.array(values["v"]),
        np.array(values["preload"]),
        experiment.plant,
        tension_min=limits.tension_min,
        tension_max=limits.tension_max,
    )


def _draw(
    systems: Sequence[LinearSystem], experiment: Experiment, swept: str | None, plot: Path, figure: FigureName | None
) -> None:
    from dualwinch.simulation.plots import linear
    from dualwinch.simulation.plots import save as save_figure

    chosen = figure or ("modes" if swept else "bode")
    drawn = {
        "bode": lambda: linear.bode(systems, swept),
        "modes": lambda: linear.modal_frequencies(
            systems, swept or "", experiment.plant, experiment.simulation.sample_time
        ),
        "poles": lambda: linear.pole_map(systems, swept or "", experiment.plant),
        "shapes": lambda: linear.mode_shapes(systems[0], experiment.plant),
    }[chosen]()
    save_figure(drawn, plot)
