"""The command ``linearise``: plant, closed loop or open loop at an operating point or along a sweep.

What is printed and written is computed in `analysis.linearisation`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from dualwinch.cli.options import ControllerOptions, Figure, NominalMachine
from dualwinch.cli.output import NOTES, check_file, numbers_between, print_figures, terminal, write_figure, wrote

if TYPE_CHECKING:
    from dualwinch.analysis.linearisation import LoopName, Point
    from dualwinch.simulation.experiment import Experiment


def linearise(
    *,
    x: float | None = None,
    v: float | None = None,
    preload: float | None = None,
    sweep: str | None = None,
    loop: Literal["plant", "open", "broken", "closed"] = "plant",
    opening: Literal["u", "tau_1", "tau_2", "torques"] | None = None,
    dt: float | None = None,
    ensemble: NominalMachine = None,
    given: ControllerOptions = ControllerOptions(),
    out: Path | None = None,
    plot: Figure = None,
    figure: Literal["amplitude", "bode", "modes", "poles", "shapes"] | None = None,
) -> None:
    """Linearise the plant at an operating point or along a sweep; print its modes and the sample rate they need.

    At rest the operating point is an equilibrium, else steady motion with constant tensions. Derivatives are exact.
    Ropes with mass and sag, and elastic gearboxes, add their modes; ropes are assumed taut and teeth in contact.

    The closed loop maps the states of plant and controller over one sample. The open loop is the same, opened at
    a signal: its gain, phase, delay and disk margins are printed, and how they depend on the amplitude of the speed
    error. With either loop, the rule for the drums' resonance on their ropes is checked, and constants of the machine
    that the estimator learns are held at their true values.

    Args:
        x: Position in m (default: middle of the track).
        v: Speed in m/s (default 0); negative: towards winch 2.
        preload: Sum of both tensions in N (default: controller.coordination.preload).
        sweep: Many points: name=first:last:step, the name x, v or preload.
        loop: What to linearise: the plant alone, or the loop over a sample, opened at a signal (also `broken`) or
            closed.
        opening: open: signal at which the loop is opened: force command (default), torque of a winch, or both torques,
            which then change alike.
        dt: Sample time in s: discrete time, inputs held (default: continuous).
        out: File for the matrices: .json, .mat or .npz.
        figure: Which figure. plant: bode (default of one point), modes (of a sweep), poles, shapes; closed: poles;
            open: bode with margins (default), or margins against the amplitude of the speed error.

    Examples:
        dualwinch linearise --x 25 --v 1.8
        dualwinch linearise --x 25 --out plant.json --plot bode.png
        dualwinch linearise --sweep x=1:47:2 --plot modes.png --out track.mat
        dualwinch linearise --sweep v=0:2.4:0.2 --plot poles.svg --figure poles
        dualwinch linearise --loop closed --v 0.5 --plot poles.png
        dualwinch linearise --loop open --opening tau_1 --v 0.5 --plot margins.png
        dualwinch linearise --loop open --v 0.5 --plot amplitude.png --figure amplitude
        dualwinch linearise --ensemble site --v 1
        dualwinch linearise --ensemble site --loop closed --v 1 --set controller.winch_1.damping=164
    """
    from dualwinch.analysis.linearisation import linearisation
    from dualwinch.model.linear.system import WRITERS
    from dualwinch.simulation.settings import override

    linearised: LoopName = "open" if loop == "broken" else loop
    experiment = given.nominal(ensemble)
    if preload is not None:
        experiment = override(experiment, {"controller.coordination.preload": preload})
    check_file(out, *WRITERS)
    swept = _swept_name(sweep) if sweep else None
    _check(linearised, opening, dt, swept, figure, plot)
    points = grid({"x": x, "v": v, "preload": preload}, sweep, experiment)
    with terminal(stderr=True).status("linearising"):
        result = linearisation(experiment, points, linearised, opening or "u", dt, swept)
    print_figures(result.figures)
    if out:
        result.save(out, NOTES.get() or ())
        wrote(out)
    write_figure(plot, lambda: result.plot(figure))


def _check(
    loop: LoopName, opening: str | None, dt: float | None, swept: str | None, figure: str | None, plot: Path | None
) -> None:
    """Raise `ConfigurationError` where options contradict each other."""
    from dualwinch.analysis.linearisation import DRAWINGS
    from dualwinch.model.errors import ConfigurationError

    if figure and not plot:
        raise ConfigurationError("--figure: needs --plot")
    if dt is not None and loop != "plant":
        raise ConfigurationError(f"--dt and --loop {loop}: the loop has the controller's, simulation.sample_time")
    if opening and loop != "open":
        raise ConfigurationError("--opening: needs --loop open")
    if figure == "amplitude" and loop == "plant":
        raise ConfigurationError("--figure amplitude: needs --loop open")
    if figure and figure not in DRAWINGS[loop]:
        raise ConfigurationError(f"--figure {figure} and --loop {loop}: must be {' or '.join(DRAWINGS[loop])}")
    if swept is None and loop == "plant" and figure in {"modes", "poles"}:
        raise ConfigurationError(f"--figure {figure}: needs --sweep")
    if swept and figure in {"amplitude", "shapes"}:
        raise ConfigurationError(f"--figure {figure}: shows one operating point; give no --sweep")


def grid(given: dict[str, float | None], sweep: str | None, experiment: Experiment) -> list[Point]:
    """The points: a single one, or those of a sweep ``name=first:last:step``, the last one included.

    Values that are not `given` are the middle of the track, rest and the experiment's preload.

    Raises:
        ConfigurationError: an unknown name, no range, or a name both given and swept.
    """
    from dualwinch.analysis.linearisation import Point
    from dualwinch.model.errors import ConfigurationError

    usual = Point(experiment.plant.track.length / 2, 0.0, experiment.controller.limits.preload)
    point = usual._replace(**{name: float(value) for name, value in given.items() if value is not None})
    if sweep is None:
        return [point]
    name = _swept_name(sweep)
    if given[name] is not None:
        raise ConfigurationError(f"--{name} and --sweep {name}: give one of them")
    wrong = f"--sweep {sweep}: must be name=first:last:step, e.g. x=1:47:2"
    numbers = [float(value) for value in numbers_between(sweep.partition("=")[2], wrong)]
    if len(numbers) < 2:
        raise ConfigurationError(f"--sweep {sweep}: one point only; give --{name} {numbers[0]:g}")
    return [point._replace(**{name: value}) for value in numbers]


def _swept_name(sweep: str) -> str:
    from dualwinch.analysis.linearisation import Point
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.model.quantities.quantity import unknown

    name = sweep.partition("=")[0].strip()
    if name not in Point._fields:
        raise ConfigurationError(f"--sweep {sweep}: {unknown('name', name, Point._fields)}")
    return name
