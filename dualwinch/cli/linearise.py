"""The command ``linearise``: plant, closed loop or broken loop at an operating point or along a sweep.

Every figure that is printed stands in the file, too, in its entry ``figures``: both come from the same tables.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from cyclopts import App, Parameter
from rich.console import Console
from rich.table import Table
from rich.text import Text

from dualwinch.cli.options import (
    AssignmentsInBrief,
    Case,
    Config,
    Estimator,
    Figure,
    Law,
    Plugins,
    use_parts,
    with_estimator,
)
from dualwinch.cli.output import (
    FIGURE_SUFFIXES,
    FigureColumn,
    FigureTable,
    check_file,
    numbers_between,
    records,
    styled,
    terminal,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dualwinch.model.linear.modes import Mode, ModeTrack
    from dualwinch.model.linear.operating_point import OperatingPoint
    from dualwinch.model.linear.system import LinearSystem
    from dualwinch.model.plant import Plant
    from dualwinch.simulation.analysis.describing_function import AmplitudePoint
    from dualwinch.simulation.analysis.margins import Margins
    from dualwinch.simulation.experiment import Experiment

app = App(
    name="linearise",
    help_epilogue="""Examples:

    dualwinch linearise --x 25 --v 1.8
    dualwinch linearise --x 25 --out plant.json --plot bode.png
    dualwinch linearise --sweep x=1:47:2 --plot modes.png --out track.mat
    dualwinch linearise --sweep v=0:2.4:0.2 --plot poles.svg --figure poles
    dualwinch linearise --loop closed --v 0.5 --plot poles.png
    dualwinch linearise --loop broken --cut tau_1 --v 0.5 --plot margins.png
    dualwinch linearise --loop broken --v 0.5 --plot amplitude.png --figure amplitude
""",
)


@app.default
def linearise(
    *,
    x: Annotated[float | None, Parameter(help="Position in m (default: middle of the track).")] = None,
    v: Annotated[float | None, Parameter(help="Speed in m/s (default 0); negative: towards winch 2.")] = None,
    preload: Annotated[
        float | None, Parameter(help="Sum of both tensions in N (default: controller.coordination.preload).")
    ] = None,
    sweep: Annotated[str | None, Parameter(help="Many points: name=first:last:step, the name x, v or preload.")] = None,
    loop: Annotated[
        Literal["open", "closed", "broken"],
        Parameter(help="What to linearise: plant alone, closed loop over a sample, or that loop cut open."),
    ] = "open",
    cut: Annotated[
        Literal["u", "tau_1", "tau_2"] | None,
        Parameter(help="broken: where the loop is cut, at the force command (default) or at a winch's torque."),
    ] = None,
    dt: Annotated[
        float | None, Parameter(help="Sample time in s: discrete time, inputs held (default: continuous).")
    ] = None,
    case: Case = None,
    config: Config = None,
    controller: Law = None,
    estimator: Estimator = None,
    set_: AssignmentsInBrief = None,
    plugin: Plugins = None,
    out: Annotated[Path | None, Parameter(help="File for the matrices: .json, .mat or .npz.")] = None,
    plot: Figure = None,
    figure: Annotated[
        Literal["amplitude", "bode", "modes", "poles", "shapes"] | None,
        Parameter(
            help="Which figure. open: bode (default of one point), modes (of a sweep), poles, shapes; closed: poles; "
            "broken: bode with margins (default), or margins against the amplitude of the speed error."
        ),
    ] = None,
) -> None:
    """Linearise the plant at an operating point or along a sweep; print its modes and the sample rate they need.

    At rest the operating point is an equilibrium, else steady motion with constant tensions. Every derivative is
    exact.

    The closed loop is that of one sample of plant and controller, the broken one is it cut open at a signal; of it,
    gain, phase, delay and disk margins are printed, and how they depend on the amplitude of the speed error.
    """
    from dualwinch.config.experiment_file import experiment_from
    from dualwinch.config.folders import check_folder
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.model.linear.linearisation import linearise_at
    from dualwinch.model.linear.modes import track_modes
    from dualwinch.model.linear.system import writer
    from dualwinch.simulation.settings import override

    use_parts(plugin)
    experiment = experiment_from(case, config, controller, with_estimator(estimator, set_))
    given = {"x": x, "v": v, "preload": preload}
    if given["preload"] is not None:
        experiment = override(experiment, {"controller.coordination.preload": float(given["preload"])})
    if out:
        writer(out)
        check_folder(out.parent)
    check_file(plot, *FIGURE_SUFFIXES)
    if figure and not plot:
        raise ConfigurationError("--figure: needs --plot")
    if loop != "open":
        swept = _swept_name(sweep) if sweep else None
        values = grid(given, sweep, experiment)
        linearise_loop(experiment, values, swept, loop=loop, cut=cut, dt=dt, out=out, plot=plot, figure=figure)
        return
    _check_figure(figure, sweep)
    values = grid(given, sweep, experiment)
    points = _operating_points(experiment, values)
    console = terminal(stderr=True)
    with console.status("linearising"):
        systems = linearise_at(points, experiment.plant, dt)
        tracks = track_modes(systems, experiment.plant)
    if sweep is None:
        tables = print_point(systems[0], points[0], experiment.plant)
    else:
        tables = print_sweep(tracks, points, _swept_name(sweep), dt)
    if out:
        _save(systems, tables, out)
    if plot:
        with console.status(f"drawing {plot}"):
            _draw(systems, experiment, _swept_name(sweep) if sweep else None, plot, figure)
        console.print(f"wrote {plot}")


FigureName: TypeAlias = Literal["amplitude", "bode", "modes", "poles", "shapes"]

SWEPT = ("x", "v", "preload")


def _save(systems: Sequence[LinearSystem], tables: Sequence[FigureTable], out: Path) -> None:
    """Write systems with every figure that was printed of them."""
    from dualwinch.model.linear.system import save_sweep

    systems[0].save(out, records(tables)) if len(systems) == 1 else save_sweep(systems, out, records(tables))
    terminal(stderr=True).print(f"wrote {out}")


def _check_figure(figure: FigureName | None, sweep: str | None) -> None:
    from dualwinch.model.errors import ConfigurationError

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
    from dualwinch.model.errors import ConfigurationError

    defaults = {"x": experiment.plant.track.length / 2, "v": 0.0, "preload": experiment.controller.limits.preload}
    values = {name: [defaults[name] if given[name] is None else float(given[name] or 0.0)] for name in SWEPT}
    if sweep is not None:
        name = _swept_name(sweep)
        if given[name] is not None:
            raise ConfigurationError(f"--{name} and --sweep {name}: give one of them")
        values[name] = _range(sweep)
    return values


def _swept_name(sweep: str) -> str:
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.model.quantities.quantity import nearest

    name = sweep.partition("=")[0].strip()
    if name not in SWEPT:
        raise ConfigurationError(
            f"--sweep {sweep}: unknown name '{name}'; did you mean '{nearest(name, SWEPT)}'? "
            f"One of {', '.join(SWEPT)} can be swept"
        )
    return name


def _range(sweep: str) -> list[float]:
    from dualwinch.model.errors import ConfigurationError

    name, _, text = sweep.partition("=")
    values = numbers_between(text, f"--sweep {sweep}: must be name=first:last:step, e.g. x=1:47:2")
    if len(values) < 2:
        raise ConfigurationError(f"--sweep {sweep}: one point only; give --{name} {values[0]:g}")
    return [float(value) for value in values]


def _operating_points(experiment: Experiment, values: dict[str, list[float]]) -> list[OperatingPoint]:
    import numpy as np

    from dualwinch.model.linear.operating_point import operating_points

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


FIGURES = {"closed": ("poles",), "broken": ("bode", "amplitude")}
"""What is linearised → its figures, the default first."""

PRINTED_AMPLITUDES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
"""Amplitudes of the speed error in m/s that are printed."""


def linearise_loop(
    experiment: Experiment,
    values: dict[str, list[float]],
    swept: str | None,
    *,
    loop: str,
    cut: str | None,
    dt: float | None,
    out: Path | None,
    plot: Path | None,
    figure: str | None,
) -> None:
    """Linearise, print, write; `values` holds x, v and preload of every point, `swept` says which of them varies."""
    import numpy as np

    from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
    from dualwinch.controllers.laws.nftsm import Nftsm
    from dualwinch.simulation.analysis.describing_function import amplitude_sweep
    from dualwinch.simulation.analysis.linear_loop import linear_broken_loop, linear_closed_loop
    from dualwinch.simulation.analysis.margins import margins

    _check(loop, cut, dt, swept, figure)
    joint, console = cut or "u", terminal(stderr=True)
    points = np.broadcast_arrays(*(np.array(values[name]) for name in ("x", "v", "preload")))
    systems = []
    for x, v, preload in zip(*(column.tolist() for column in points), strict=True):
        asked = _with_preload(experiment, preload)
        systems.append(linear_closed_loop(asked, x, v) if loop == "closed" else linear_broken_loop(asked, x, v, joint))
    found = [margins(system) for system in systems] if loop == "broken" else []
    x, v, preload = (float(column[0]) for column in points)
    if loop == "closed":
        tables = _print_closed(systems, experiment, swept, values)
    else:
        tables = [_print_margins(systems, found, swept, values)]
        if swept is None and isinstance(experiment.controller.law, FandoNftsm | Nftsm) and systems[0].B.any():
            asked = _with_preload(experiment, preload)
            tables.append(_print_amplitudes(amplitude_sweep(asked, x, v, joint, PRINTED_AMPLITUDES)))
    if out:
        _save(systems, tables, out)
    if plot:
        from dualwinch.simulation.plots import save as save_figure
        from dualwinch.simulation.plots.linear import amplitude_margins, closed_loop_poles, loop_bode

        if loop == "closed":
            picture = closed_loop_poles(systems, swept)
        elif figure == "amplitude":
            picture = amplitude_margins(amplitude_sweep(_with_preload(experiment, preload), x, v, joint))
        else:
            picture = loop_bode(systems, found, swept)
        save_figure(picture, plot)
        console.print(f"wrote {plot}")


def _check(loop: str, cut: str | None, dt: float | None, swept: str | None, figure: str | None) -> None:
    from dualwinch.model.errors import ConfigurationError

    if dt is not None:
        raise ConfigurationError(f"--dt and --loop {loop}: the loop has the controller's, simulation.sample_time")
    if cut and loop != "broken":
        raise ConfigurationError("--cut: needs --loop broken")
    if figure and figure not in FIGURES[loop]:
        raise ConfigurationError(f"--figure {figure} and --loop {loop}: must be {' or '.join(FIGURES[loop])}")
    if figure == "amplitude" and swept:
        raise ConfigurationError("--figure amplitude: shows one operating point; give no --sweep")


def _with_preload(experiment: Experiment, preload: float) -> Experiment:
    from dualwinch.simulation.settings import override

    return override(experiment, {"controller.coordination.preload": float(preload)})


def _print_closed(
    systems: Sequence[LinearSystem], experiment: Experiment, swept: str | None, values: dict[str, list[float]]
) -> list[FigureTable]:
    import numpy as np

    from dualwinch.model.linear.modes import modes
    from dualwinch.model.linear.operating_point import operating_point

    console = terminal()
    if swept is None:
        limits, (system,) = experiment.controller.limits, systems
        point = operating_point(
            values["x"][0],
            values["v"][0],
            values["preload"][0],
            experiment.plant,
            tension_min=limits.tension_min,
            tension_max=limits.command_max,
        )
        tables = print_point(system, point, experiment.plant)
        radius = float(np.abs(system.poles()).max())
        console.print(f"\nspectral radius over a sample {radius:.9g}: {'stable' if radius < 1 else 'UNSTABLE'}")
        columns = (FigureColumn("spectral_radius"), FigureColumn("stable", ""))
        return [*tables, FigureTable("stability", columns, [(radius, radius < 1)])]
    columns = (
        FigureColumn(swept, _swept_unit(swept), form="g"),
        FigureColumn("spectral_radius", heading="spectral radius", form=".7g"),
        FigureColumn("slowest_decay", "s", "slowest decay (s)"),
        FigureColumn("least_damping", heading="least damping", form=".3g"),
        FigureColumn("least_damped_frequency", "Hz", "at (Hz)"),
    )
    rows = []
    for value, system in zip(values[swept], systems, strict=True):
        found = modes(system, experiment.plant)
        slowest = max(found, key=lambda mode: abs(mode.eigenvalue))
        softest = min(found, key=lambda mode: mode.damping)
        frequency = softest.natural_frequency / (2 * math.pi)
        rows.append((value, abs(slowest.eigenvalue), slowest.time_constant, softest.damping, frequency))
    table = FigureTable("closed_loop", columns, rows)
    console.print(table.render())
    return [table]


def _swept_unit(swept: str) -> str:
    from dualwinch.model.linear.operating_point import OperatingPoint
    from dualwinch.model.quantities.description import describe

    return describe(OperatingPoint)[swept].quantity.unit


def _print_margins(
    systems: Sequence[LinearSystem], found: Sequence[Margins], swept: str | None, values: dict[str, list[float]]
) -> FigureTable:
    from dualwinch.simulation.loop.closed_loop import LOOP_OPENINGS

    console = terminal()
    cut = systems[0].inputs[0].removesuffix("_in")
    ratio = f" ({systems[0].outputs[0]}/{systems[0].inputs[0]})"
    console.print(styled("bold", f"margins of the loop cut at {cut}", ratio))
    if not any(system.B.any() for system in systems):
        console.print(f"nothing comes back: {LOOP_OPENINGS[cut]} rests on its limit or answers to nothing here")
    first = [FigureColumn(swept, _swept_unit(swept), form="g")] if swept else []
    rows = [(*([values[swept][k]] if swept else []), *_margin_row(margin)) for k, margin in enumerate(found)]
    table = FigureTable("margins", (*first, *MARGIN_COLUMNS), rows)
    console.print(table.render())
    return table


def _print_amplitudes(points: Sequence[AmplitudePoint]) -> FigureTable:
    console = terminal()
    console.print(styled("bold", "by amplitude of the speed error", " (describing functions)"))
    amplitude = FigureColumn("amplitude", "m/s", "e2 m/s", form="g")
    rows = [(point.amplitude, *_margin_row(point.margins)) for point in points]
    table = FigureTable("margins_by_amplitude", (amplitude, *MARGIN_COLUMNS), rows)
    console.print(table.render())
    return table


MARGIN_COLUMNS = (
    FigureColumn("gain"),
    FigureColumn("gain_frequency", "Hz", "at Hz"),
    FigureColumn("least_gain", heading="least"),
    FigureColumn("phase", "deg", "phase °"),
    FigureColumn("phase_frequency", "Hz", "at Hz"),
    FigureColumn("delay", "s", "delay ms", 1e3),
    FigureColumn("disk"),
    FigureColumn("stable", "", "", words={True: "", False: "UNSTABLE"}),
)
"""Of `Margins`: how they are printed and written."""


def _margin_row(found: Margins) -> tuple[float | bool, ...]:
    return (
        found.gain,
        found.gain_frequency / (2 * math.pi),
        found.least_gain,
        found.phase,
        found.phase_frequency / (2 * math.pi),
        found.delay,
        found.disk,
        found.stable,
    )


SMALL = 8
"""Systems of up to so many states are printed whole."""


def _sampling() -> FigureTable:
    """What sample rates of modes are computed with."""
    from dualwinch.model.linear.modes import SAMPLES_A_PERIOD

    return FigureTable("sampling", (FigureColumn("samples_per_period"),), [(SAMPLES_A_PERIOD,)])


def print_point(system: LinearSystem, point: OperatingPoint, plant: Plant) -> list[FigureTable]:
    """Print operating point, matrices (of a small system), modes, DC gains and what sensors suffice."""
    from dualwinch.model.linear.modes import SAMPLES_A_PERIOD, modes, plant_prefix
    from dualwinch.model.linear.properties import dc_gains

    console = terminal()
    console.print(styled("bold", "operating point"))
    _print_operating_point(console, point)
    tables = [_point_table(point)]
    if len(system.states) <= SMALL:
        time = "continuous time" if system.dt is None else f"sampled every {system.dt:g} s, inputs held"
        for name, columns in (("A", system.states), ("B", system.inputs)):
            console.print(styled("bold", f"\n{name}", f" ({time})"))
            console.print(_matrix(system.states, columns, getattr(system, name)))
    found = modes(system, plant)
    console.print(styled("bold", "\nmodes"))
    table = _modes(found, system.dt)
    console.print(table.render())
    console.print(f"f_s: {SAMPLES_A_PERIOD} samples a period, which a controller that acts on the mode needs")
    console.print(styled("bold", "\nparticipation of the states"))
    console.print(_participation(found))
    tables += [table, _participation_table(found), _sampling()]
    if len(system.states) <= SMALL and plant_prefix(system.states) is not None:
        console.print(styled("bold", "\nDC gains", ": lasting change of an output for each unit of an input"))
        gains = dc_gains(system)
        console.print(_matrix(system.outputs, system.inputs, gains))
        units = (f"({system.units[name]})" for name in system.inputs)
        columns = (FigureColumn("output", ""), *map(FigureColumn, system.inputs, (f"output/{unit}" for unit in units)))
        rows = [(name, *row.tolist()) for name, row in zip(system.outputs, gains, strict=True)]
        tables += [FigureTable("dc_gains", columns, rows), *_print_structure(console, system)]
    return tables


def print_sweep(
    tracks: Sequence[ModeTrack], points: Sequence[OperatingPoint], swept: str, dt: float | None
) -> list[FigureTable]:
    """Print natural frequency and damping of every mode at every point, and limits that are not respected."""
    from dualwinch.model.linear.modes import SAMPLES_A_PERIOD
    from dualwinch.model.linear.operating_point import OperatingPoint
    from dualwinch.model.quantities.description import describe

    console = terminal()
    unit = describe(OperatingPoint)[swept].quantity.unit
    console.print("natural frequency in Hz (damping ratio)")
    table = Table(box=None, pad_edge=False)
    table.add_column(f"{swept} ({unit})", justify="right")
    for track in tracks:
        table.add_column(track.label, justify="right")
    for k, point in enumerate(points):
        entries = [track.modes[k] for track in tracks]
        words = [f"{_number(mode.natural_frequency / (2 * math.pi))} ({mode.damping:.3g})" for mode in entries]
        table.add_row(f"{getattr(point, swept):g}", *words)
    console.print(table)
    highest = max(mode.sample_rate for track in tracks for mode in track.modes)
    console.print(f"{SAMPLES_A_PERIOD} samples a period of the fastest mode: {_number(highest)} Hz")
    for line in _summed_up(points, swept):
        console.print(line)
    columns = (FigureColumn(swept, unit), FigureColumn("mode", ""), *_mode_columns(dt)[1:])
    rows = [
        (getattr(point, swept), track.label, *_mode_row(track.modes[k])[1:])
        for k, point in enumerate(points)
        for track in tracks
    ]
    passed = [(getattr(point, swept), words) for point in points for words in point.violations]
    return [
        FigureTable("modes", columns, rows),
        FigureTable("highest_sample_rate", (FigureColumn("sample_rate", "Hz"),), [(highest,)]),
        _sampling(),
        FigureTable("limits_passed", (FigureColumn(swept, unit), FigureColumn("limit", "")), passed),
    ]


def _summed_up(points: Sequence[OperatingPoint], swept: str) -> list[Text]:
    """One line where some points pass limits: how many, and the first."""
    beyond = [point for point in points if point.violations]
    if not beyond:
        return []
    first = beyond[0]
    where = f"{swept} = {getattr(first, swept):g}"
    words = f" at {len(beyond)} of {len(points)} points; at {where}: {first.violations[0]}"
    return [styled("red", "limits passed", words)]


def _print_operating_point(console: Console, point: OperatingPoint) -> None:
    from dualwinch.model.linear.operating_point import OperatingPoint
    from dualwinch.model.quantities.description import describe
    from dualwinch.model.quantities.tree import numbers

    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold")
    table.add_column(justify="right")
    table.add_column()
    table.add_column(style="dim")
    known = describe(OperatingPoint)
    for name, value in numbers(point).items():
        quantity = known[name].quantity
        shown = f"{value:.1e}" if name in {"residual", "tension_rate"} and value else f"{value:.7g}"
        table.add_row(name, shown, quantity.unit.replace("^2", "²"), quantity.meaning)
    console.print(table)
    for remark in point.remarks:
        console.print(remark)
    for violation in point.violations:
        console.print(styled("red", "limit passed", f": {violation}"))
    if not point.violations:
        console.print("all limits are respected; both ropes are taut")


def _point_table(point: OperatingPoint) -> FigureTable:
    from dualwinch.model.linear.operating_point import OperatingPoint
    from dualwinch.model.quantities.description import describe
    from dualwinch.model.quantities.tree import numbers

    known = describe(OperatingPoint)
    values = numbers(point)
    columns = [FigureColumn(name, known[name].quantity.unit) for name in values]
    words = ("remarks", point.remarks), ("limits_passed", point.violations)
    columns += [FigureColumn(name, "") for name, _ in words]
    return FigureTable("operating_point", columns, [(*values.values(), *(list(texts) for _, texts in words))])


def _mode_columns(dt: float | None) -> tuple[FigureColumn, ...]:
    """Of a mode, in files; eigenvalues of a sampled system are those of a sample."""
    unit = "1/s" if dt is None else "1"
    return (
        FigureColumn("mode", ""),
        FigureColumn("eigenvalue_real", unit),
        FigureColumn("eigenvalue_imaginary", unit),
        FigureColumn("natural_frequency", "Hz"),
        FigureColumn("damping"),
        FigureColumn("time_constant", "s"),
        FigureColumn("sample_rate", "Hz"),
    )


@dataclass(frozen=True)
class ModeTable(FigureTable):
    """A table of modes, in which both parts of an eigenvalue are printed as one."""

    modes: Sequence[Mode] = ()

    def render(self) -> Table:
        """The table on a terminal."""
        table = Table(box=None, pad_edge=False)
        table.add_column("mode", overflow="fold")
        for heading in ("eigenvalue", "Hz", "damping", "decay (s)", "f_s (Hz)"):
            table.add_column(heading, justify="right", no_wrap=True)
        for mode in self.modes:
            table.add_row(mode.label, _complex(mode.eigenvalue), *_pace(mode))
        return table


def _modes(found: Sequence[Mode], dt: float | None) -> ModeTable:
    return ModeTable("modes", _mode_columns(dt), [_mode_row(mode) for mode in found], found)


def _mode_row(mode: Mode) -> tuple[Any, ...]:
    value, frequency = mode.eigenvalue, mode.natural_frequency / (2 * math.pi)
    return mode.label, value.real, value.imag, frequency, mode.damping, mode.time_constant, mode.sample_rate


def _participation_table(found: Sequence[Mode]) -> FigureTable:
    columns = (FigureColumn("mode", ""), FigureColumn("state", ""), FigureColumn("participation"))
    rows = [(mode.label, state, share) for mode in found for state, share in mode.participation.items()]
    return FigureTable("participation", columns, rows)


def _pace(mode: Mode) -> tuple[str, str, str, str]:
    """Natural frequency, damping, time constant and sample rate; a mode gone after a sample has none."""
    if math.isinf(mode.natural_frequency):
        return "", "deadbeat", "", ""
    return (
        _number(mode.natural_frequency / (2 * math.pi)),
        f"{mode.damping:.3g}",
        _number(mode.time_constant),
        _number(mode.sample_rate),
    )


def _participation(found: Sequence[Mode]) -> Table:
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(no_wrap=True)
    table.add_column()
    for mode in found:
        shares = [f"{name} {100 * mode.participation[name]:.3g} %" for name in mode.main_states]
        table.add_row(mode.label, ", ".join(shares))
    return table


def _print_structure(console: Console, system: LinearSystem) -> list[FigureTable]:
    from dualwinch.model.linear.properties import is_controllable, sufficient_sensors

    torques = [name for name in system.inputs if name.startswith("tau_")]
    console.print()
    moved = []
    for chosen in (*([name] for name in torques), torques):
        moved.append((list(chosen), is_controllable(system, chosen)))
        able = "moves" if moved[-1][1] else "does not move"
        console.print(
            f"{' and '.join(chosen)} {able} every mode".replace("s every", " every" if chosen[1:] else "s every")
        )
    sets = [" + ".join(chosen) for chosen in sufficient_sensors(system)]
    words = "; or ".join(sets) if sets else "none: not even all outputs together"
    console.print(f"outputs from which every mode can be seen: {words}")
    return [
        FigureTable("controllability", (FigureColumn("inputs", ""), FigureColumn("moves_every_mode", "")), moved),
        FigureTable("sufficient_outputs", (FigureColumn("outputs", ""),), [([*s.split(" + ")],) for s in sets]),
    ]


def _matrix(rows: Sequence[str], columns: Sequence[str], values: NDArray[np.float64]) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column(style="bold")
    for name in columns:
        table.add_column(name, justify="right")
    for name, row in zip(rows, values, strict=True):
        table.add_row(name, *(_number(float(value)) for value in row))
    return table


def _number(value: float) -> str:
    return f"{value:.4g}".replace("inf", "∞")


def _complex(value: complex) -> str:
    if not value.imag:
        return _number(value.real)
    return f"{_number(value.real)} ± {_number(abs(value.imag))}j"
