"""The command ``linearise``: plant, closed loop or open loop at an operating point or along a sweep.

The entry ``figures`` of the file holds every printed number: both come from the same tables.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from dualwinch.cli.options import ControllerOptions, Figure, NominalMachine
from dualwinch.cli.output import (
    FigureColumn,
    FigureTable,
    check_file,
    measured,
    numbers_between,
    records,
    styled,
    terminal,
    write_figure,
    wrote,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dualwinch.analysis.margins import Margins
    from dualwinch.model.linear.modes import Mode
    from dualwinch.model.linear.operating_point import OperatingPoint
    from dualwinch.model.linear.system import LinearSystem
    from dualwinch.model.plant import Plant
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
    from dualwinch.analysis.linear_loop import learns
    from dualwinch.model.linear.system import WRITERS, save_sweep

    loop = "open" if loop == "broken" else loop
    experiment = given.nominal(ensemble)
    if preload is not None:
        experiment = _with_preload(experiment, preload)
    check_file(out, *WRITERS)
    swept = _swept_name(sweep) if sweep else None
    _check(loop, opening, dt, swept, figure, plot)
    points = grid({"x": x, "v": v, "preload": preload}, sweep, experiment)
    with terminal(stderr=True).status("linearising"):
        systems, operating_points = linear_systems(experiment, points, loop, opening or "u", dt)
    if loop == "open":
        tables = print_open(systems, experiment, points, swept, opening or "u")
    elif swept is None:
        tables = print_point(systems[0], operating_points[0], experiment.plant, closed=loop == "closed")
    elif loop == "closed":
        tables = print_closed_sweep(systems, experiment.plant, points, swept)
    else:
        tables = print_sweep(systems, operating_points, experiment.plant, swept)
    if loop != "plant" and learns(experiment):
        terminal().print("what the estimator learns of the machine is held, at its true values")
    if loop != "plant" and swept is None:
        resonance = resonance_tables(_with_preload(experiment, points[0].preload), points[0].x)
        print_resonance(resonance)
        tables += resonance
    if out:
        facts = records(tables)
        save_sweep(systems, out, facts) if swept else systems[0].save(out, facts)
        wrote(out)
    write_figure(plot, lambda: _drawn(systems, experiment, points[0], swept, loop, opening or "u", figure))


class Point(NamedTuple):
    """A point to linearise at: position in m, speed in m/s and sum of both tensions in N."""

    x: float
    v: float
    preload: float


FIGURES = {"plant": ("bode", "modes", "poles", "shapes"), "closed": ("poles",), "open": ("bode", "amplitude")}
"""Loop → its figures, the default of one point first."""


def _check(
    loop: str, opening: str | None, dt: float | None, swept: str | None, figure: str | None, plot: Path | None
) -> None:
    """Raise `ConfigurationError` where options contradict each other."""
    from dualwinch.model.errors import ConfigurationError

    if figure and not plot:
        raise ConfigurationError("--figure: needs --plot")
    if dt is not None and loop != "plant":
        raise ConfigurationError(f"--dt and --loop {loop}: the loop has the controller's, simulation.sample_time")
    if opening and loop != "open":
        raise ConfigurationError("--opening: needs --loop open")
    if figure == "amplitude" and loop == "plant":
        raise ConfigurationError("--figure amplitude: needs --loop open")
    if figure and figure not in FIGURES[loop]:
        raise ConfigurationError(f"--figure {figure} and --loop {loop}: must be {' or '.join(FIGURES[loop])}")
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
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.model.quantities.quantity import unknown

    name = sweep.partition("=")[0].strip()
    if name not in Point._fields:
        raise ConfigurationError(f"--sweep {sweep}: {unknown('name', name, Point._fields)}")
    return name


def _with_preload(experiment: Experiment, preload: float) -> Experiment:
    from dualwinch.simulation.settings import override

    return override(experiment, {"controller.coordination.preload": float(preload)})


def linear_systems(
    experiment: Experiment, points: Sequence[Point], loop: str, opening: str, dt: float | None
) -> tuple[list[LinearSystem], list[OperatingPoint]]:
    """The linear system at every point, and the plant's operating points (empty for an open loop).

    Raises:
        ConfigurationError: a point without an operating point of the plant.
    """
    import numpy as np

    from dualwinch.analysis.linear_loop import linear_closed_loop, linear_open_loop
    from dualwinch.model.linear.linearisation import linearise_at
    from dualwinch.model.linear.operating_point import operating_points

    if loop == "open":
        return [linear_open_loop(_with_preload(experiment, preload), x, v, opening) for x, v, preload in points], []
    limits = experiment.controller.limits
    tension_max = limits.tension_max if loop == "plant" else limits.command_max
    x, v, preload = np.array(points).T
    found = operating_points(x, v, preload, experiment.plant, tension_min=limits.tension_min, tension_max=tension_max)
    if loop == "plant":
        return list(linearise_at(found, experiment.plant, dt)), found
    return [linear_closed_loop(_with_preload(experiment, preload), x, v) for x, v, preload in points], found


def _drawn(
    systems: Sequence[LinearSystem],
    experiment: Experiment,
    first: Point,
    swept: str | None,
    loop: str,
    opening: str,
    figure: str | None,
) -> Any:
    """Draw the requested figure, or the default one."""
    from dualwinch.analysis.describing_function import amplitude_sweep
    from dualwinch.analysis.margins import margins
    from dualwinch.analysis.plots import linear

    if loop == "closed":
        return linear.closed_loop_poles(systems, swept)
    if figure == "amplitude":
        varied = amplitude_sweep(_with_preload(experiment, first.preload), first.x, first.v, opening)
        return linear.amplitude_margins(varied)
    if loop == "open":
        return linear.loop_bode(systems, list(map(margins, systems)), swept)
    match figure or ("modes" if swept else "bode"):
        case "shapes":
            drawing = linear.mode_shapes(systems[0], experiment.plant)
        case "poles":
            drawing = linear.pole_map(systems, swept or "", experiment.plant)
        case "modes":
            drawing = linear.modal_frequencies(
                systems, swept or "", experiment.plant, experiment.simulation.sample_time
            )
        case _:
            drawing = linear.bode(systems, swept)
    return drawing


def _point_columns(*names: str, point: OperatingPoint | None = None) -> list[FigureColumn]:
    """Columns of numbers of an operating point, from its metadata or, without a point, from that of all plants."""
    from dualwinch.model.linear.operating_point import OperatingPoint
    from dualwinch.model.quantities.description import describe, describe_parts

    descriptions = describe(OperatingPoint) if point is None else describe_parts(point)
    rounded_off = {"residual", "tension_rate"}
    return [
        FigureColumn.of(name, descriptions[name].quantity, ".2g" if name in rounded_off else ".7g") for name in names
    ]


PRINTED_AMPLITUDES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 3e-2, 1e-1, 3e-1)
"""Printed amplitudes of the speed error in m/s."""

MARGIN_COLUMNS = (
    FigureColumn("gain"),
    FigureColumn("gain_frequency", "Hz", "at Hz", form=".3g"),
    FigureColumn("least_gain", heading="least gain"),
    FigureColumn("phase", "deg", "phase °"),
    FigureColumn("phase_frequency", "Hz", "at Hz", form=".3g"),
    FigureColumn("delay", "s", "delay ms", 1e3),
    FigureColumn("disk"),
)
"""Columns of `Margins`, printed and written."""

STABILITY_COLUMNS = (
    FigureColumn("stable", "", "", words={True: "", False: "UNSTABLE"}),
    FigureColumn("growing_mode", "", form=""),
)
"""Columns behind them: whether the closed loop is stable, and the mode that grows."""


def _margin_row(loop: LinearSystem, found: Margins, plant: Plant) -> list[float | bool | str]:
    """The row of `MARGIN_COLUMNS` and `STABILITY_COLUMNS`; margins of an unstable loop are meaningless, and NaN."""
    from dualwinch.analysis.linear_loop import closed, fastest_growing
    from dualwinch.analysis.remarks import in_words

    if found.stable:
        values = [getattr(found, each.name) / (2 * math.pi if each.unit == "Hz" else 1) for each in MARGIN_COLUMNS]
        return [*values, True, ""]
    mode = fastest_growing(closed(loop), plant)
    return [*[math.nan] * len(MARGIN_COLUMNS), False, f"deviations {in_words(mode)}" if mode else ""]


def print_open(
    systems: Sequence[LinearSystem], experiment: Experiment, points: Sequence[Point], swept: str | None, opening: str
) -> list[FigureTable]:
    """Print margins of open loops and, for one point of a sliding-mode law, their dependence on the amplitude."""
    from dualwinch.analysis.describing_function import amplitude_sweep
    from dualwinch.analysis.linear_loop import OPENED_SIGNALS
    from dualwinch.analysis.margins import margins
    from dualwinch.analysis.stability import SLIDING_MODE
    from dualwinch.model.linear.operating_point import contact
    from dualwinch.simulation.loop.closed_loop import LOOP_OPENINGS

    console = terminal()
    ratio = f" ({', '.join(map('/'.join, zip(systems[0].outputs, systems[0].inputs, strict=True)))})"
    console.print(styled("bold", f"margins of the loop opened at {opening}", ratio))
    if not any(system.B.any() for system in systems):
        returned = " and ".join(LOOP_OPENINGS[signal] for signal in OPENED_SIGNALS[opening])
        console.print(f"no loop gain: {returned} rests on its limit or does not respond here")
    rows = [
        [*([getattr(point, swept)] if swept else []), *_margin_row(system, margins(system), experiment.plant)]
        for point, system in zip(points, systems, strict=True)
    ]
    point_columns = _point_columns(swept) if swept else []
    tables = [FigureTable("margins", (*point_columns, *MARGIN_COLUMNS, *STABILITY_COLUMNS), rows)]
    console.print(tables[0].render())
    _print_growing(tables[0])
    for words in contact(systems[0].operating_point, experiment.plant):
        console.print(words)
    if swept is None and isinstance(experiment.controller.law, SLIDING_MODE) and systems[0].B.any():
        ((x, v, preload),) = points
        varied = amplitude_sweep(_with_preload(experiment, preload), x, v, opening, PRINTED_AMPLITUDES)
        amplitude = FigureColumn("amplitude", "m/s", "e2 m/s", form="g")
        rows = [[each.amplitude, *_margin_row(each.system, each.margins, experiment.plant)] for each in varied]
        columns = amplitude, *MARGIN_COLUMNS, *STABILITY_COLUMNS
        tables.append(FigureTable("margins_by_amplitude", columns, rows))
        console.print(styled("bold", "by amplitude of the speed error", " (describing functions)"))
        console.print(tables[1].render())
        _print_growing(tables[1])
    return tables


def _print_growing(table: FigureTable) -> None:
    """Name the growing mode of each unstable loop of a table whose last column has it."""
    for row in table.rows:
        if row[-1]:
            unit = table.columns[0].unit
            where = "" if table.columns[0] is MARGIN_COLUMNS[0] else f"at {table.columns[0].name} = {row[0]:g} {unit}: "
            terminal().print(f"{where}{row[-1]}", highlight=False)


def resonance_tables(experiment: Experiment, x: float | None = None) -> list[FigureTable]:
    """The rule for the drums' resonance on their ropes, and its limits; empty for laws other than sliding-mode ones.

    The position x in m is the middle of the track by default.
    """
    from dualwinch.analysis import resonance
    from dualwinch.analysis.stability import SLIDING_MODE
    from dualwinch.model.quantities.description import describe
    from dualwinch.model.quantities.tables import readable_unit

    if not isinstance(experiment.controller.law, SLIDING_MODE):
        return []
    quantities = {name: leaf.quantity for name, leaf in describe(resonance.ResonanceGain).items()}
    columns = [
        FigureColumn(name, quantity.unit, shown_unit=readable_unit(quantity.unit), meaning=quantity.meaning)
        for name, quantity in quantities.items()
    ]
    rows = [[*vars(each).values(), each.verdict] for each in resonance.resonance_gains(experiment, x)]
    limits = {"threshold": resonance.THRESHOLD, "threshold_of_one_drum": resonance.OF_ONE_DRUM}
    limits |= dict(zip(("undecided_from", "undecided_to"), resonance.UNDECIDED, strict=True))
    return [
        FigureTable("resonance", (*columns, FigureColumn("verdict", "", "")), rows),
        FigureTable("resonance_limits", [FigureColumn(name) for name in limits], [list(limits.values())]),
        *_large_signal_table(experiment),
    ]


def _large_signal_table(experiment: Experiment) -> list[FigureTable]:
    """Large-signal stability at rest at mid-track; empty without steady motion there."""
    from dualwinch.analysis.large_signal import LargeSignalStability, large_signal_stability
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.model.quantities.description import describe

    try:
        stability = large_signal_stability(experiment)
    except ConfigurationError:
        return []
    columns = [FigureColumn.of(name, leaf.quantity) for name, leaf in describe(LargeSignalStability).items()]
    return [FigureTable("large_signal", columns, [list(vars(stability).values())])]


def print_resonance(tables: Sequence[FigureTable]) -> None:
    """Print `resonance_tables`."""
    from dualwinch.analysis.large_signal import LargeSignalStability

    if not tables:
        return
    console, (threshold, of_one, low, high) = terminal(), tables[1].rows[0]
    console.print(styled("bold", "drums' resonance on their ropes", " (loop gain there)"))
    console.print(tables[0].render())
    console.print(
        f"at most {threshold:g} where both drums swing alike, in the middle of the track, {of_one:g} where one does; "
        f"from {low:g} to {high:g} look at the eigenvalues"
    )
    for table in tables[2:]:
        console.print(str(LargeSignalStability(*table.rows[0])))


def print_closed_sweep(
    systems: Sequence[LinearSystem], plant: Plant, points: Sequence[Point], swept: str
) -> list[FigureTable]:
    """Print spectral radius, slowest decay and least damping of the closed loop at every point."""
    from dualwinch.model.linear.modes import modes

    columns = (
        *_point_columns(swept),
        FigureColumn("spectral_radius", heading="spectral radius", form=".7g"),
        FigureColumn("slowest_decay", "s", "slowest decay (s)"),
        FigureColumn("least_damping", heading="least damping", form=".3g"),
        FigureColumn("least_damped_frequency", "Hz", "at (Hz)"),
    )
    rows = []
    for point, system in zip(points, systems, strict=True):
        system_modes = modes(system, plant)
        slowest = max(system_modes, key=lambda mode: abs(mode.eigenvalue))
        least_damped = min(system_modes, key=lambda mode: mode.damping)
        frequency = least_damped.natural_frequency / (2 * math.pi)
        decay = abs(slowest.eigenvalue), slowest.time_constant
        rows.append((getattr(point, swept), *decay, least_damped.damping, frequency))
    table = FigureTable("closed_loop", columns, rows)
    terminal().print(table.render())
    return [table]


PRINTED_STATES = 8
"""Largest number of states of a system whose matrices are printed."""


def print_point(system: LinearSystem, point: OperatingPoint, plant: Plant, *, closed: bool) -> list[FigureTable]:
    """Print operating point, matrices (small systems), modes, DC gains, sufficient sensors, and a loop's stability."""
    import numpy as np

    from dualwinch.model.linear.modes import modes, plant_prefix
    from dualwinch.model.linear.properties import dc_gains, is_stable
    from dualwinch.model.quantities.tree import numbers

    console, small = terminal(), len(system.states) <= PRINTED_STATES
    console.print(styled("bold", "operating point"))
    columns = _point_columns(*numbers(point), point=point)
    tables = [FigureTable("operating_point", columns, [list(numbers(point).values())])]
    console.print(tables[0].render_down())
    for remark in point.remarks:
        console.print(remark)
    for violation in point.violations:
        console.print(styled("red", "limit passed", f": {violation}"))
    if not point.violations:
        console.print("all limits are respected; both ropes are taut")
    for name, words in (("remarks", point.remarks), ("limits_passed", point.violations)):
        tables.append(FigureTable(name, (FigureColumn("words", ""),), [(text,) for text in words]))
    if small:
        time = "continuous time" if system.dt is None else f"sampled every {system.dt:g} s, inputs held"
        for name, inputs in (("A", system.states), ("B", system.inputs)):
            console.print(styled("bold", f"\n{name}", f" ({time})"))
            console.print(_matrix(name, "", system.states, map(FigureColumn, inputs), getattr(system, name)).render())
    tables += _print_modes(listed(modes(system, plant), closed=closed), system.dt, closed=closed)
    if small and plant_prefix(system.states) is not None:
        console.print(styled("bold", "DC gains", ": steady-state change of an output per unit of an input"))
        inputs = (FigureColumn(name, f"output/({system.units[name]})") for name in system.inputs)
        tables.append(_matrix("dc_gains", "output", system.outputs, inputs, dc_gains(system)))
        console.print(tables[-1].render())
        tables += _print_structure(system)
    if closed:
        radius, stable = float(np.abs(system.poles()).max()), is_stable(system)
        console.print(f"spectral radius over a sample {radius:.9g}: {'stable' if stable else 'UNSTABLE'}")
        columns = [FigureColumn("spectral_radius"), FigureColumn("stable", "")]
        tables.append(FigureTable("stability", columns, [(radius, stable)]))
    return tables


def _print_modes(found: Sequence[Mode], dt: float | None, *, closed: bool) -> list[FigureTable]:
    """Print modes and the participation of the states."""
    from dualwinch.model.linear.modes import SAMPLES_A_PERIOD

    console = terminal()
    console.print(styled("bold", "\nmodes"))
    columns = _mode_columns(dt, closed=closed)
    tables = [
        FigureTable("modes", columns, [_mode_row(mode, closed=closed) for mode in found]),
        FigureTable(
            "participation",
            (FigureColumn("mode", ""), FigureColumn("state", ""), FigureColumn("share", factor=100)),
            [(mode.label, state, share) for mode in found for state, share in mode.participation.items()],
        ),
        FigureTable("sampling", (FigureColumn("samples_per_period"),), [(SAMPLES_A_PERIOD,)]),
    ]
    console.print(tables[0].render())
    if not closed:
        console.print(f"f_s: {SAMPLES_A_PERIOD} samples a period, which a controller that acts on the mode needs")
    console.print(styled("bold", "\nparticipation of the states"))
    shares = [
        (mode.label, ", ".join(f"{name} {100 * mode.participation[name]:.3g} %" for name in mode.main_states))
        for mode in found
    ]
    console.print(FigureTable("", (FigureColumn("mode", ""), FigureColumn("states", "")), shares).render())
    return tables


MOST_COLUMNS = 6
"""Most modes beside each other in a sweep's table."""


def print_sweep(
    systems: Sequence[LinearSystem], points: Sequence[OperatingPoint], plant: Plant, swept: str
) -> list[FigureTable]:
    """Print natural frequency and damping of every mode at every point, and violated limits."""
    from dualwinch.model.linear.modes import SAMPLES_A_PERIOD, track_modes

    console, tracks = terminal(), track_modes(systems, plant)
    values = [getattr(point, swept) for point in points]
    (point_column,) = _point_columns(swept)
    console.print("natural frequency in Hz (damping ratio)")
    wide = len(tracks) > MOST_COLUMNS  # then a row per mode, at the ends and in the middle of the sweep
    indices = sorted({0, (len(points) - 1) // 2, len(points) - 1}) if wide else range(len(points))
    cells = [
        [
            f"{measured(mode.natural_frequency / (2 * math.pi))} ({mode.damping:.3g})"
            for mode in map(track.modes.__getitem__, indices)
        ]
        for track in tracks
    ]
    if wide:
        columns = [FigureColumn("mode", ""), *(FigureColumn(f"{swept} = {values[k]:g}") for k in indices)]
        rows = [[track.label, *line] for track, line in zip(tracks, cells, strict=True)]
    else:
        columns = [FigureColumn(swept, point_column.unit, f"{swept} ({point_column.unit})", form="g")]
        columns += [FigureColumn(track.label) for track in tracks]
        rows = [[value, *line] for value, line in zip(values, zip(*cells, strict=True), strict=True)]
    console.print(FigureTable("", columns, rows).render())
    tracked_modes = [mode for track in tracks for mode in track.modes]
    highest = max(mode.sample_rate for mode in [mode for mode in tracked_modes if mode.rate.imag] or tracked_modes)
    console.print(f"{SAMPLES_A_PERIOD} samples a period of the fastest mode: {measured(highest)} Hz")
    passed = [(value, words) for value, point in zip(values, points, strict=True) for words in point.violations]
    if passed:
        count = len({value for value, _ in passed})
        words = f" at {count} of {len(points)} points; at {swept} = {passed[0][0]:g}: {passed[0][1]}"
        console.print(styled("red", "limits passed", words))
    return [
        FigureTable(
            "modes",
            (point_column, *_mode_columns(systems[0].dt)),
            [
                (value, track.label, *_mode_row(track.modes[k])[1:])
                for k, value in enumerate(values)
                for track in tracks
            ],
        ),
        FigureTable("highest_sample_rate", (FigureColumn("sample_rate", "Hz"),), [(highest,)]),
        FigureTable("sampling", (FigureColumn("samples_per_period"),), [(SAMPLES_A_PERIOD,)]),
        FigureTable("limits_passed", (point_column, FigureColumn("limit", "")), passed),
    ]


def _mode_columns(dt: float | None, *, closed: bool = False) -> tuple[FigureColumn, ...]:
    """Columns of a mode; eigenvalues of a sampled system are those over a sample.

    The sample rate that a mode needs is printed for the plant alone: a closed loop has a sample rate.
    """
    unit = "1/s" if dt is None else "1"
    return (
        FigureColumn("mode", ""),
        FigureColumn("eigenvalue", unit),
        FigureColumn("eigenvalue_real", unit, form=""),
        FigureColumn("eigenvalue_imaginary", unit, form=""),
        FigureColumn("natural_frequency", "Hz", "Hz"),
        FigureColumn("damping", form=".3g"),
        FigureColumn("time_constant", "s", "decay (s)"),
        FigureColumn("sample_rate", "Hz", "f_s (Hz)", form="" if closed else ".4g"),
        FigureColumn("deadbeat", "", form=""),
        FigureColumn("unstable", "", form=""),
        FigureColumn("remark", "", "", words={UNSTABLE: styled("bold red", UNSTABLE)}),
    )


UNSTABLE = "unstable"
"""Remark on an unstable mode of the closed loop."""


def listed(found: Sequence[Mode], *, closed: bool) -> list[Mode]:
    """Modes in the order of the tables, unstable ones of a closed loop first; equal names get numbers."""
    from dualwinch.model.linear.modes import numbered

    each = sorted(found, key=lambda mode: closed and not mode.grows)
    labels = numbered([mode.label for mode in each])
    return [replace(mode, label=label) for mode, label in zip(each, labels, strict=True)]


def _mode_row(mode: Mode, *, closed: bool = False) -> tuple[Any, ...]:
    value, frequency = mode.eigenvalue, mode.natural_frequency / (2 * math.pi)
    words = f"{measured(value.real)} ± {measured(abs(value.imag))}j" if value.imag else measured(value.real)
    pace = frequency, mode.damping, mode.time_constant, mode.sample_rate
    deadbeat, unstable = math.isinf(frequency), closed and mode.grows
    remark = UNSTABLE if unstable else "deadbeat" if deadbeat else ""
    return mode.label, words, value.real, value.imag, *pace, deadbeat, unstable, remark


def _print_structure(system: LinearSystem) -> list[FigureTable]:
    from dualwinch.model.linear.properties import is_controllable, sufficient_sensors

    console = terminal()
    torques = [name for name in system.inputs if name.startswith("tau_")]
    controllable = [(inputs, is_controllable(system, inputs)) for inputs in (*([name] for name in torques), torques)]
    for inputs, able in controllable:
        verb = ("move" if able else "do not move") if inputs[1:] else ("moves" if able else "does not move")
        console.print(f"{' and '.join(inputs)} {verb} every mode")
    sets = [" + ".join(inputs) for inputs in sufficient_sensors(system)]
    words = "; or ".join(sets) if sets else "none: not even all outputs together"
    console.print(f"outputs from which every mode can be seen: {words}")
    return [
        FigureTable(
            "controllability", (FigureColumn("inputs", ""), FigureColumn("moves_every_mode", "")), controllable
        ),
        FigureTable("sufficient_outputs", (FigureColumn("outputs", ""),), [(each,) for each in sets]),
    ]


def _matrix(
    name: str, rows_of: str, rows: Sequence[str], columns: Iterable[FigureColumn], values: NDArray[np.float64]
) -> FigureTable:
    cells = [(row, *line) for row, line in zip(rows, values.tolist(), strict=True)]
    return FigureTable(name, (FigureColumn(rows_of, ""), *columns), cells)
