"""Figures of linear models: operating point, modes, margins, and the rule for the drums' resonance."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis import resonance
from dualwinch.analysis.describing_function import amplitude_sweep
from dualwinch.analysis.large_signal import LargeSignalStability
from dualwinch.analysis.linear_loop import closed, fastest_growing
from dualwinch.analysis.margins import Margins, margins
from dualwinch.analysis.remarks import in_words, stability_of
from dualwinch.analysis.stability import SLIDING_MODE
from dualwinch.model.linear.modes import SAMPLES_A_PERIOD, Mode, modes, numbered, plant_prefix, track_modes
from dualwinch.model.linear.operating_point import OperatingPoint
from dualwinch.model.linear.properties import dc_gains, is_controllable, is_stable, sufficient_sensors
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.description import describe, describe_parts
from dualwinch.model.quantities.figures import FigureColumn, Figures, FigureTable, Sentence, measured
from dualwinch.model.quantities.tables import readable_unit
from dualwinch.model.quantities.tree import numbers
from dualwinch.simulation.experiment import Experiment

PRINTED_AMPLITUDES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 3e-2, 1e-1, 3e-1)
"""Printed amplitudes of the speed error in m/s."""

PRINTED_STATES = 8
"""Largest number of states of a system whose matrices are printed."""

MOST_COLUMNS = 6
"""Most modes beside each other in a sweep's table."""

MARGIN_COLUMNS = (
    FigureColumn("gain"),
    FigureColumn("gain_frequency", "Hz", "at Hz", form=".3g"),
    FigureColumn("least_gain", heading="least gain"),
    FigureColumn("phase", "deg", "phase °"),
    FigureColumn("phase_frequency", "Hz", "at Hz", form=".3g"),
    FigureColumn("delay", "s", "delay ms", 1e3),
    FigureColumn("disk"),
)
"""Columns of `Margins`."""

STABILITY_COLUMNS = (
    FigureColumn("stable", "", "", words={True: "", False: "UNSTABLE"}),
    FigureColumn("growing_mode", "", form=""),
)
"""Columns behind them: whether the closed loop is stable, and the mode that grows."""


def point_columns(*names: str, point: OperatingPoint | None = None) -> list[FigureColumn]:
    """Columns of numbers of an operating point, from its metadata or, without a point, from that of all plants."""
    descriptions = describe(OperatingPoint) if point is None else describe_parts(point)
    rounded_off = {"residual", "tension_rate"}
    return [
        FigureColumn.of(name, descriptions[name].quantity, ".2g" if name in rounded_off else ".7g") for name in names
    ]


def margins_table(
    name: str, parameter: FigureColumn | None, values: Sequence[float], loops: Sequence[LinearSystem], plant: Plant
) -> tuple[FigureTable, list[Sentence]]:
    """Margins of loops over a parameter, if there is one, and the growing mode of each unstable loop."""
    rows, sentences = [], []
    for value, loop in zip(values, loops, strict=True):
        margin_row = _margin_row(loop, margins(loop), plant)
        rows.append([*([value] if parameter else []), *margin_row])
        if margin_row[-1]:
            where = f"at {parameter.name} = {value:g} {parameter.unit}: " if parameter else ""
            sentences.append(Sentence(f"{where}{margin_row[-1]}"))
    columns = (*([parameter] if parameter else []), *MARGIN_COLUMNS, *STABILITY_COLUMNS)
    return FigureTable(name, columns, rows), sentences


def _margin_row(loop: LinearSystem, loop_margins: Margins, plant: Plant) -> list[float | bool | str]:
    """The row of `MARGIN_COLUMNS` and `STABILITY_COLUMNS`; margins of an unstable loop are meaningless, and NaN."""
    if loop_margins.stable:
        units = [2 * math.pi if column.unit == "Hz" else 1 for column in MARGIN_COLUMNS]
        values = [getattr(loop_margins, column.name) for column in MARGIN_COLUMNS]
        return [*(value / unit for value, unit in zip(values, units, strict=True)), True, ""]
    mode = fastest_growing(closed(loop), plant)
    return [*[math.nan] * len(MARGIN_COLUMNS), False, f"deviations {in_words(mode)}" if mode else ""]


def margins_by_amplitude(experiment: Experiment, x: float, v: float, opening: str) -> Figures:
    """Margins of the loop of a sliding-mode law over the amplitude of the speed error; none for other laws."""
    if not isinstance(experiment.controller.law, SLIDING_MODE):
        return []
    points = amplitude_sweep(experiment, x, v, opening, PRINTED_AMPLITUDES)
    parameter = FigureColumn("amplitude", "m/s", "e2 m/s", form="g")
    amplitudes, loops = [point.amplitude for point in points], [point.system for point in points]
    table, growing = margins_table("margins_by_amplitude", parameter, amplitudes, loops, experiment.plant)
    title = "by amplitude of the speed error"
    return [replace(table, title=title, subtitle=" (describing functions)"), *growing]


def resonance_figures(experiment: Experiment, x: float | None = None) -> Figures:
    """The rule for the drums' resonance on their ropes, and large-signal stability; none for laws without the rule.

    The position x in m is the middle of the track by default.
    """
    if not isinstance(experiment.controller.law, SLIDING_MODE):
        return []
    quantities = {name: leaf.quantity for name, leaf in describe(resonance.ResonanceGain).items()}
    columns = [
        FigureColumn(name, quantity.unit, shown_unit=readable_unit(quantity.unit), meaning=quantity.meaning)
        for name, quantity in quantities.items()
    ]
    rows = [[*vars(each).values(), each.verdict] for each in resonance.resonance_gains(experiment, x)]
    low, high = resonance.UNDECIDED
    limits = {
        "threshold": resonance.THRESHOLD,
        "threshold_of_one_drum": resonance.OF_ONE_DRUM,
        "undecided_from": low,
        "undecided_to": high,
    }
    title, subtitle = "drums' resonance on their ropes", " (loop gain there)"
    return [
        FigureTable("resonance", (*columns, FigureColumn("verdict", "", "")), rows, title, subtitle),
        FigureTable("resonance_limits", [*map(FigureColumn, limits)], [list(limits.values())], layout="file"),
        Sentence(
            f"at most {resonance.THRESHOLD:g} where both drums swing alike, in the middle of the track, "
            f"{resonance.OF_ONE_DRUM:g} where one does; from {low:g} to {high:g} look at the eigenvalues"
        ),
        *_large_signal_figures(experiment),
    ]


def _large_signal_figures(experiment: Experiment) -> Figures:
    """Large-signal stability at rest at mid-track; none without steady motion there."""
    if (stability := stability_of(experiment)) is None:
        return []
    columns = [FigureColumn.of(name, leaf.quantity) for name, leaf in describe(LargeSignalStability).items()]
    return [
        FigureTable("large_signal", columns, [list(vars(stability).values())], layout="file"),
        Sentence(str(stability)),
    ]


def closed_sweep_table(
    systems: Sequence[LinearSystem], plant: Plant, name: str, values: Sequence[float]
) -> FigureTable:
    """Spectral radius, slowest decay and least damping of the closed loop over a number of the operating point."""
    columns = (
        *point_columns(name),
        FigureColumn("spectral_radius", heading="spectral radius", form=".7g"),
        FigureColumn("slowest_decay", "s", "slowest decay (s)"),
        FigureColumn("least_damping", heading="least damping", form=".3g"),
        FigureColumn("least_damped_frequency", "Hz", "at (Hz)"),
    )
    rows = []
    for value, system in zip(values, systems, strict=True):
        system_modes = modes(system, plant)
        slowest = max(system_modes, key=lambda mode: abs(mode.eigenvalue))
        least_damped = min(system_modes, key=lambda mode: mode.damping)
        frequency = least_damped.natural_frequency / (2 * math.pi)
        rows.append((value, abs(slowest.eigenvalue), slowest.time_constant, least_damped.damping, frequency))
    return FigureTable("closed_loop", columns, rows)


def operating_point_figures(point: OperatingPoint) -> Figures:
    """The numbers of an operating point, remarks on it, and the limits that it violates."""
    columns, words = point_columns(*numbers(point), point=point), FigureColumn("words", "")
    within = [] if point.violations else [Sentence("all limits are respected; both ropes are taut")]
    return [
        FigureTable("operating_point", columns, [list(numbers(point).values())], "operating point", layout="columns"),
        *map(Sentence, point.remarks),
        *(Sentence(f": {violation}", "limit passed", "red") for violation in point.violations),
        *within,
        FigureTable("limits_passed", (words,), [(text,) for text in point.violations], layout="file"),
    ]


def matrix_tables(system: LinearSystem) -> Figures:
    """The matrices A and B of a system with few states; none of a larger one. Files have them as matrices."""
    if len(system.states) > PRINTED_STATES:
        return []
    time = " (continuous time)" if system.dt is None else f" (sampled every {system.dt:g} s, inputs held)"
    return [
        matrix_table("", "", system.states, map(FigureColumn, inputs), getattr(system, name), f"\n{name}", time)
        for name, inputs in (("A", system.states), ("B", system.inputs))
    ]


def input_output_figures(system: LinearSystem) -> Figures:
    """DC gains, controllability, and outputs that suffice to observe every mode; of a plant with few states."""
    if len(system.states) > PRINTED_STATES or plant_prefix(system.states) is None:
        return []
    inputs = (FigureColumn(name, f"output/({system.units[name]})") for name in system.inputs)
    title, subtitle = "DC gains", ": steady-state change of an output per unit of an input"
    gains = matrix_table("dc_gains", "output", system.outputs, inputs, dc_gains(system), title, subtitle)
    torques = [name for name in system.inputs if name.startswith("tau_")]
    groups = [*([name] for name in torques), torques]
    controllable = [(group, is_controllable(system, group)) for group in groups]
    verbs = {1: {True: "moves", False: "does not move"}, 2: {True: "move", False: "do not move"}}
    sets = [" + ".join(outputs) for outputs in sufficient_sensors(system)]
    words = "; or ".join(sets) if sets else "none: not even all outputs together"
    columns = FigureColumn("inputs", ""), FigureColumn("moves_every_mode", "")
    return [
        gains,
        FigureTable("controllability", columns, controllable, layout="file"),
        *(Sentence(f"{' and '.join(group)} {verbs[len(group)][able]} every mode") for group, able in controllable),
        FigureTable("sufficient_outputs", (FigureColumn("outputs", ""),), [(each,) for each in sets], layout="file"),
        Sentence(f"outputs from which every mode can be seen: {words}"),
    ]


def matrix_table(
    name: str,
    rows_of: str,
    rows: Sequence[str],
    columns: Iterable[FigureColumn],
    values: NDArray[np.float64],
    title: str,
    subtitle: str,
) -> FigureTable:
    """A matrix with named rows and columns."""
    cells = [(row, *line) for row, line in zip(rows, values.tolist(), strict=True)]
    return FigureTable(name, (FigureColumn(rows_of, ""), *columns), cells, title, subtitle)


def stability_figures(system: LinearSystem) -> Figures:
    """Spectral radius of a closed loop over a sample, and whether it is stable."""
    radius, stable = float(np.abs(system.poles()).max()), is_stable(system)
    columns = [FigureColumn("spectral_radius"), FigureColumn("stable", "")]
    return [
        Sentence(f"spectral radius over a sample {radius:.9g}: {'stable' if stable else 'UNSTABLE'}"),
        FigureTable("stability", columns, [(radius, stable)], layout="file"),
    ]


def modes_figures(system: LinearSystem, plant: Plant, *, of_loop: bool) -> Figures:
    """Modes of a plant or a closed loop, and the participation of the states in them."""
    listed = listed_modes(modes(system, plant), of_loop=of_loop)
    rate = f"f_s: {SAMPLES_A_PERIOD} samples a period, which a controller that acts on the mode needs"
    shares = [
        (mode.label, ", ".join(f"{name} {100 * mode.participation[name]:.3g} %" for name in mode.main_states))
        for mode in listed
    ]
    label, rows = FigureColumn("mode", ""), [_mode_row(mode, of_loop=of_loop) for mode in listed]
    return [
        FigureTable("modes", mode_columns(system.dt, of_loop=of_loop), rows, "\nmodes"),
        *([] if of_loop else [Sentence(rate)]),
        FigureTable("", (label, FigureColumn("states", "")), shares, "\nparticipation of the states"),
        FigureTable(
            "participation",
            (label, FigureColumn("state", ""), FigureColumn("share", factor=100)),
            [(mode.label, state, share) for mode in listed for state, share in mode.participation.items()],
            layout="file",
        ),
    ]


def modes_sweep_figures(
    systems: Sequence[LinearSystem], points: Sequence[OperatingPoint], plant: Plant, name: str
) -> Figures:
    """Natural frequency and damping of every mode over a number of the operating point, and violated limits."""
    tracks, values = track_modes(systems, plant), [getattr(point, name) for point in points]
    (parameter,) = point_columns(name)
    tracked_modes = [mode for track in tracks for mode in track.modes]
    highest = max(mode.sample_rate for mode in [mode for mode in tracked_modes if mode.rate.imag] or tracked_modes)
    violations = [(value, words) for value, point in zip(values, points, strict=True) for words in point.violations]
    rows = [(value, track.label, *_mode_row(track.modes[k])[1:]) for k, value in enumerate(values) for track in tracks]
    sentences = [Sentence(f"{SAMPLES_A_PERIOD} samples a period of the fastest mode: {measured(highest)} Hz")]
    if violations:
        count, (value, words) = len({value for value, _ in violations}), violations[0]
        passed = f" at {count} of {len(points)} points; at {name} = {value:g}: {words}"
        sentences.append(Sentence(passed, "limits passed", "red"))
    return [
        _frequency_table([track.label for track in tracks], [track.modes for track in tracks], parameter, values),
        *sentences,
        FigureTable("modes", (parameter, *mode_columns(systems[0].dt)), rows, layout="file"),
        FigureTable("highest_sample_rate", (FigureColumn("sample_rate", "Hz"),), [(highest,)], layout="file"),
        FigureTable("limits_passed", (parameter, FigureColumn("limit", "")), violations, layout="file"),
    ]


def _frequency_table(
    labels: Sequence[str], tracks: Sequence[Sequence[Mode]], parameter: FigureColumn, values: Sequence[float]
) -> FigureTable:
    """Frequencies and damping ratios: a column per mode; of many modes a row, at the ends and in the middle."""
    wide, name = len(labels) > MOST_COLUMNS, parameter.name
    indices = sorted({0, (len(values) - 1) // 2, len(values) - 1}) if wide else range(len(values))
    cells = [
        [f"{measured(track[k].natural_frequency / (2 * math.pi))} ({track[k].damping:.3g})" for k in indices]
        for track in tracks
    ]
    title = "natural frequency in Hz (damping ratio)"
    if wide:
        columns = [FigureColumn("mode", ""), *(FigureColumn(f"{name} = {values[k]:g}") for k in indices)]
        return FigureTable("", columns, [[label, *line] for label, line in zip(labels, cells, strict=True)], title)
    columns = [FigureColumn(name, parameter.unit, f"{name} ({parameter.unit})", form="g"), *map(FigureColumn, labels)]
    rows = [[value, *line] for value, line in zip(values, zip(*cells, strict=True), strict=True)]
    return FigureTable("", columns, rows, title)


UNSTABLE = "unstable"
"""Remark on an unstable mode of the closed loop."""


def mode_columns(dt: float | None, *, of_loop: bool = False) -> tuple[FigureColumn, ...]:
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
        FigureColumn("sample_rate", "Hz", "f_s (Hz)", form="" if of_loop else ".4g"),
        FigureColumn("deadbeat", "", form=""),
        FigureColumn("unstable", "", form=""),
        FigureColumn("remark", "", "", styles={UNSTABLE: "bold red"}),
    )


def listed_modes(system_modes: Sequence[Mode], *, of_loop: bool) -> list[Mode]:
    """Modes in the order of the tables, unstable ones of a closed loop first; equal names get numbers."""
    ordered = sorted(system_modes, key=lambda mode: of_loop and not mode.grows)
    labels = numbered([mode.label for mode in ordered])
    return [replace(mode, label=label) for mode, label in zip(ordered, labels, strict=True)]


def _mode_row(mode: Mode, *, of_loop: bool = False) -> tuple[Any, ...]:
    value, frequency = mode.eigenvalue, mode.natural_frequency / (2 * math.pi)
    words = f"{measured(value.real)} ± {measured(abs(value.imag))}j" if value.imag else measured(value.real)
    pace = frequency, mode.damping, mode.time_constant, mode.sample_rate
    deadbeat, unstable = math.isinf(frequency), of_loop and mode.grows
    remark = UNSTABLE if unstable else "deadbeat" if deadbeat else ""
    return mode.label, words, value.real, value.imag, *pace, deadbeat, unstable, remark
