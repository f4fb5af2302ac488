"""What ``linearise`` prints."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from rich.text import Text

from dualwinch.commands.terminal import styled, terminal
from dualwinch.model.linear.modes import SAMPLES_A_PERIOD, Mode, ModeTrack, modes, plant_prefix
from dualwinch.model.linear.operating_point import OperatingPoint
from dualwinch.model.linear.properties import dc_gains, is_controllable, sufficient_sensors
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.tree import numbers

SMALL = 8
"""Systems of up to so many states are printed whole."""


def print_point(system: LinearSystem, point: OperatingPoint, plant: Plant) -> None:
    """Print operating point, matrices (of a small system), modes, DC gains and what sensors suffice."""
    console = terminal()
    console.print(styled("bold", "operating point"))
    _print_operating_point(console, point)
    if len(system.states) <= SMALL:
        time = "continuous time" if system.dt is None else f"sampled every {system.dt:g} s, inputs held"
        for name, columns in (("A", system.states), ("B", system.inputs)):
            console.print(styled("bold", f"\n{name}", f" ({time})"))
            console.print(_matrix(system.states, columns, getattr(system, name)))
    found = modes(system, plant)
    console.print(styled("bold", "\nmodes"))
    console.print(_modes(found))
    console.print(f"f_s: {SAMPLES_A_PERIOD} samples a period, which a controller that acts on the mode needs")
    console.print(styled("bold", "\nparticipation of the states"))
    console.print(_participation(found))
    if len(system.states) <= SMALL and plant_prefix(system.states) is not None:
        console.print(styled("bold", "\nDC gains", ": lasting change of an output for each unit of an input"))
        console.print(_matrix(system.outputs, system.inputs, dc_gains(system)))
        _print_structure(console, system)


def print_sweep(tracks: Sequence[ModeTrack], points: Sequence[OperatingPoint], swept: str) -> None:
    """Print natural frequency and damping of every mode at every point, and limits that are not respected."""
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


def _modes(found: Sequence[Mode]) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column("mode", overflow="fold")
    for heading in ("eigenvalue", "Hz", "damping", "decay (s)", "f_s (Hz)"):
        table.add_column(heading, justify="right", no_wrap=True)
    for mode in found:
        table.add_row(
            mode.label,
            _complex(mode.eigenvalue),
            *_pace(mode),
        )
    return table


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


def _print_structure(console: Console, system: LinearSystem) -> None:
    torques = [name for name in system.inputs if name.startswith("tau_")]
    console.print()
    for chosen in (*([name] for name in torques), torques):
        able = "moves" if is_controllable(system, chosen) else "does not move"
        console.print(
            f"{' and '.join(chosen)} {able} every mode".replace("s every", " every" if chosen[1:] else "s every")
        )
    sets = [" + ".join(chosen) for chosen in sufficient_sensors(system)]
    words = "; or ".join(sets) if sets else "none: not even all outputs together"
    console.print(f"outputs from which every mode can be seen: {words}")


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
