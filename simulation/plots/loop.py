"""Figures of the linear closed loop: Bode diagram with margins, poles, and margins against amplitude."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from dualwinch.model.linear.system import LinearSystem
from dualwinch.simulation.analysis.describing_function import AmplitudePoint
from dualwinch.simulation.analysis.margins import Margins
from dualwinch.simulation.plots.linear import curve_handles, evenly_spaced, point_in_words, shades
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.style import (
    BLUE,
    GOLD,
    GREEN,
    GREY,
    INK,
    VERMILION,
    house_style,
)

DEADBEAT = 1e-9
"""Eigenvalues smaller than this are zero but for round-off: gone after a sample, with no rate."""

LOWEST = 1e-2
"""Lowest frequency of the Bode diagram in Hz."""


def loop_bode(
    systems: Sequence[LinearSystem], found: Sequence[Margins], swept: str | None = None, *, ax: GivenAxes = None
) -> Figure:
    """Gain and phase of a cut loop; of a single one with its margins.

    Args:
        systems: one, or a sweep, of one input and output each.
        found: their margins.
        swept: name of what differs between them.
        ax: axes for gain and phase; default: a figure of its own.
    """
    chosen = evenly_spaced(systems)
    colours = shades(len(chosen)) if len(chosen) > 1 else [BLUE]
    title = f"Loop cut at {systems[0].inputs[0].removesuffix('_in')}"
    margins = found[0] if len(chosen) == 1 else None
    with house_style():
        page = Page(ax, 5.0, title, point_in_words(systems[0], swept))
        panels = page.panels(2, sharex=True)
        for axes, draw in zip(panels, (_gain, _phase), strict=False):
            draw(axes, list(zip(chosen, colours, strict=True)), margins)
        panels[-1].set_xlabel("frequency (Hz)")
        if len(chosen) > 1:
            page.legend(curve_handles(chosen, colours, swept or ""))
    return page.figure


def _gain(axes: Axes, drawn: Sequence[tuple[LinearSystem, str]], found: Margins | None) -> None:
    for system, colour in drawn:
        frequency, response = _response(system)
        if response.any():
            axes.loglog(frequency, np.abs(response), color=colour)
    axes.axhline(1, color=GREY, linewidth=0.7)
    axes.set_ylabel("gain")
    if found is None:
        return
    if math.isfinite(found.gain):
        at = found.gain_frequency / (2 * np.pi)
        axes.vlines(at, 1 / found.gain, 1, color=VERMILION, linewidth=2.0)
    if math.isfinite(found.phase):
        axes.plot([found.phase_frequency / (2 * np.pi)], [1], "o", color=GREEN, markersize=4)
    axes.set_title(f"gain margin {found.gain:.3g}, disk margin {found.disk:.3g}", color=VERMILION)


def _phase(axes: Axes, drawn: Sequence[tuple[LinearSystem, str]], found: Margins | None) -> None:
    for system, colour in drawn:
        frequency, response = _response(system)
        if response.any():
            axes.semilogx(frequency, _lag(response), color=colour)
    axes.axhline(-180, color=GREY, linewidth=0.7)
    axes.set_ylabel("phase (°)")
    if found is None:
        return
    if math.isfinite(found.gain):
        axes.plot([found.gain_frequency / (2 * np.pi)], [-180], "o", color=VERMILION, markersize=4)
    if math.isfinite(found.phase):
        at = found.phase_frequency / (2 * np.pi)
        axes.vlines(at, -180, -180 + found.phase, color=GREEN, linewidth=2.0)
    words = f"phase margin {found.phase:.3g}°, delay margin {1e3 * found.delay:.3g} ms"
    axes.set_title(words, color=GREEN)


def _response(system: LinearSystem) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    frequency = np.geomspace(LOWEST, 0.5 / (system.dt or 1.0) * (1 - 1e-6), 2000)
    return frequency, system.response(2 * np.pi * frequency)[:, 0, 0]


def _lag(response: np.ndarray) -> np.ndarray:
    """Phase in degrees, unwrapped, between −360 and 0 at the lowest frequency."""
    phase = np.degrees(np.unwrap(np.angle(response)))
    return phase - 360 * math.ceil(phase[0] / 360)


def closed_loop_poles(systems: Sequence[LinearSystem], swept: str | None = None, *, ax: GivenAxes = None) -> Figure:
    """Eigenvalues over one sample in the unit circle, and the rates they stand for.

    Args:
        systems: closed loops: one, or a sweep.
        swept: name of what differs between them.
        ax: axes for the eigenvalues and for the rates; default: a figure of its own.
    """
    chosen = evenly_spaced(systems)
    colours = shades(len(chosen)) if len(chosen) > 1 else [BLUE]
    with house_style():
        page = Page(ax, 4.2, "Poles of the closed loop", point_in_words(systems[0], swept))
        for axes, draw in zip(page.panels(1, 2), (_eigenvalues, _rates), strict=False):
            draw(axes, list(zip(chosen, colours, strict=True)))
        if len(chosen) > 1:
            page.legend(curve_handles(chosen, colours, swept or ""))
    return page.figure


def _eigenvalues(axes: Axes, drawn: Sequence[tuple[LinearSystem, str]]) -> None:
    angle = np.linspace(0, 2 * np.pi, 400)
    axes.plot(np.cos(angle), np.sin(angle), color=INK, linewidth=0.8)
    for system, colour in drawn:
        poles = system.poles()
        axes.plot(poles.real, poles.imag, "x", color=colour, markersize=5)
    axes.set_aspect("equal")
    axes.set_title("eigenvalues of one sample")
    axes.set_xlabel("real part")
    axes.set_ylabel("imaginary part")


def _rates(axes: Axes, drawn: Sequence[tuple[LinearSystem, str]]) -> None:
    for system, colour in drawn:
        poles = system.poles()
        rates = np.log(poles[np.abs(poles) > DEADBEAT]) / (system.dt or 1.0)
        axes.plot(rates.real, rates.imag / (2 * np.pi), "x", color=colour, markersize=5)
    axes.set_xscale("symlog", linthresh=1e-2)
    axes.axvline(0, color=INK, linewidth=0.8)
    axes.set_title("as rates: left of the line is stable")
    axes.set_xlabel("decay or growth (1/s)")
    axes.set_ylabel("frequency (Hz)")


def amplitude_margins(points: Sequence[AmplitudePoint], *, ax: GivenAxes = None) -> Figure:
    """Margins against the amplitude of the speed error; at its left end the Jacobian's.

    Args:
        points: of `simulation.analysis.describing_function.amplitude_sweep`.
        ax: axes for the gain margins and for the delay margin; default: a figure of its own.
    """
    system, margins = points[0].system, [point.margins for point in points]
    amplitude = 1e3 * np.array([point.amplitude for point in points])
    title = f"Margins of the loop cut at {system.inputs[0].removesuffix('_in')} depend on amplitude"
    factors = {
        "gain margin": ([margin.gain for margin in margins], VERMILION),
        "gain margin of the disk": ([margin.disk_gain for margin in margins], GOLD),
    }
    delays = {"delay margin": ([1e3 * margin.delay for margin in margins], GREEN)}
    contents = ((factors, "factor on the gain"), (delays, "delay (ms)"))
    with house_style():
        page = Page(ax, 5.0, title, point_in_words(system, None))
        panels = page.panels(2, sharex=True)
        for axes, (curves, name) in zip(panels, contents, strict=False):
            for values, colour in curves.values():
                axes.loglog(amplitude, values, color=colour)
            axes.set_ylabel(name)
        panels[-1].set_xlabel("amplitude of the speed error $e_2$ (mm/s)")
        drawn = (factors | delays).items()
        page.legend([Line2D([], [], color=colour, label=name) for name, (_, colour) in drawn])
    return page.figure
