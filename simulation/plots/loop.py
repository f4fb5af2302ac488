"""Figures of the linear closed loop: Bode diagram with margins, poles, and margins against amplitude."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dualwinch.model.linear.system import LinearSystem
from dualwinch.simulation.analysis.describing_function import AmplitudePoint
from dualwinch.simulation.analysis.margins import Margins
from dualwinch.simulation.plots.linear import curve_handles, point_in_words, shades, spread
from dualwinch.simulation.plots.style import (
    BLUE,
    GOLD,
    GREEN,
    GREY,
    INK,
    VERMILION,
    house_style,
    legend_below,
    new_figure,
)

DEADBEAT = 1e-9
"""Eigenvalues smaller than this are zero but for round-off: gone after a sample, with no rate."""

LOWEST = 1e-2
"""Lowest frequency of the Bode diagram in Hz."""


def loop_bode(systems: Sequence[LinearSystem], found: Sequence[Margins], swept: str | None = None) -> Figure:
    """Gain and phase of a cut loop; of a single one with its margins.

    Args:
        systems: one, or a sweep, of one input and output each.
        found: their margins.
        swept: name of what differs between them.
    """
    chosen = spread(systems)
    colours = shades(len(chosen)) if len(chosen) > 1 else [BLUE]
    title = f"Loop cut at {systems[0].inputs[0].removesuffix('_in')}"
    with house_style():
        figure = new_figure(5.0, title, point_in_words(systems[0], swept))
        gain, phase = figure.subplots(2, 1, sharex=True)
        for system, colour in zip(chosen, colours, strict=True):
            frequency = np.geomspace(LOWEST, 0.5 / (system.dt or 1.0) * (1 - 1e-6), 2000)
            response = system.response(2 * np.pi * frequency)[:, 0, 0]
            if response.any():
                gain.loglog(frequency, np.abs(response), color=colour)
                phase.semilogx(frequency, _lag(response), color=colour)
        gain.axhline(1, color=GREY, linewidth=0.7)
        phase.axhline(-180, color=GREY, linewidth=0.7)
        gain.set_ylabel("gain")
        phase.set_ylabel("phase (°)")
        phase.set_xlabel("frequency (Hz)")
        if len(chosen) == 1:
            _mark(gain, phase, found[0])
        else:
            legend_below(figure, [*curve_handles(chosen, colours, swept or "")])
    return figure


def _lag(response: np.ndarray) -> np.ndarray:
    """Phase in degrees, unwrapped, between −360 and 0 at the lowest frequency."""
    phase = np.degrees(np.unwrap(np.angle(response)))
    return phase - 360 * math.ceil(phase[0] / 360)


def _mark(gain: Axes, phase: Axes, found: Margins) -> None:
    if math.isfinite(found.gain):
        at = found.gain_frequency / (2 * np.pi)
        gain.vlines(at, 1 / found.gain, 1, color=VERMILION, linewidth=2.0)
        phase.plot([at], [-180], "o", color=VERMILION, markersize=4)
    if math.isfinite(found.phase):
        at = found.phase_frequency / (2 * np.pi)
        gain.plot([at], [1], "o", color=GREEN, markersize=4)
        phase.vlines(at, -180, -180 + found.phase, color=GREEN, linewidth=2.0)
    gain.set_title(f"gain margin {found.gain:.3g}, disk margin {found.disk:.3g}", color=VERMILION)
    words = f"phase margin {found.phase:.3g}°, delay margin {1e3 * found.delay:.3g} ms"
    phase.set_title(words, color=GREEN)


def closed_loop_poles(systems: Sequence[LinearSystem], swept: str | None = None) -> Figure:
    """Eigenvalues over one sample in the unit circle, and the rates they stand for.

    Args:
        systems: closed loops: one, or a sweep.
        swept: name of what differs between them.
    """
    chosen = spread(systems)
    colours = shades(len(chosen)) if len(chosen) > 1 else [BLUE]
    with house_style():
        figure = new_figure(4.2, "Poles of the closed loop", point_in_words(systems[0], swept))
        circle, plane = figure.subplots(1, 2)
        angle = np.linspace(0, 2 * np.pi, 400)
        circle.plot(np.cos(angle), np.sin(angle), color=INK, linewidth=0.8)
        for system, colour in zip(chosen, colours, strict=True):
            poles = system.poles()
            circle.plot(poles.real, poles.imag, "x", color=colour, markersize=5)
            rates = np.log(poles[np.abs(poles) > DEADBEAT]) / (system.dt or 1.0)
            plane.plot(rates.real, rates.imag / (2 * np.pi), "x", color=colour, markersize=5)
        circle.set_aspect("equal")
        circle.set_title("eigenvalues of one sample")
        circle.set_xlabel("real part")
        circle.set_ylabel("imaginary part")
        plane.set_xscale("symlog", linthresh=1e-2)
        plane.axvline(0, color=INK, linewidth=0.8)
        plane.set_title("as rates: left of the line is stable")
        plane.set_xlabel("decay or growth (1/s)")
        plane.set_ylabel("frequency (Hz)")
        if len(chosen) > 1:
            legend_below(figure, [*curve_handles(chosen, colours, swept or "")])
    return figure


def amplitude_margins(points: Sequence[AmplitudePoint]) -> Figure:
    """Margins against the amplitude of the speed error; at its left end the Jacobian's.

    Args:
        points: of `simulation.analysis.describing_function.amplitude_sweep`.
    """
    amplitude = 1e3 * np.array([point.amplitude for point in points])
    system = points[0].system
    title = f"Margins of the loop cut at {system.inputs[0].removesuffix('_in')} depend on amplitude"
    with house_style():
        figure = new_figure(5.0, title, point_in_words(system, None))
        factor, delay = figure.subplots(2, 1, sharex=True)
        curves = (
            (factor, [point.margins.gain for point in points], VERMILION, "gain margin"),
            (factor, [point.margins.disk_gain for point in points], GOLD, "gain margin of the disk"),
            (delay, [1e3 * point.margins.delay for point in points], GREEN, "delay margin"),
        )
        for axes, values, colour, _ in curves:
            axes.loglog(amplitude, values, color=colour)
        factor.set_ylabel("factor on the gain")
        delay.set_ylabel("delay (ms)")
        delay.set_xlabel("amplitude of the speed error $e_2$ (mm/s)")
        legend_below(figure, [Line2D([], [], color=colour, label=name) for *_, colour, name in curves])
    return figure
