"""Figures of the linearised plant: frequency response, mode shapes."""

from collections.abc import Sequence
from functools import partial

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.modes import Mode, displacements, modes, plant_prefix
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.style import BLUE, GREY, INK, LIGHT, ROPE_COLOURS, house_style

CHANNELS = (("tau_1", "F1"), ("tau_2", "F2"), ("tau_1", "v"))
"""Input and output of each column of the Bode diagram."""

FREQUENCIES = (1e-2, 1e3)
"""Range of the Bode diagram in Hz; that of a discrete system ends at half its sample rate."""

MOST_CURVES = 7
"""Of a longer sweep, so many systems are drawn."""


def bode(systems: Sequence[LinearSystem], swept: str | None = None, *, ax: GivenAxes = None) -> Figure:
    """Bode diagram of each winch's tension and of the vehicle's speed, from the torques.

    Args:
        systems: of the plant: one, or a sweep (of a long one, `MOST_CURVES` evenly spaced).
        swept: name of what differs between them.
        ax: axes for gain and phase of each of the `CHANNELS`; default: a figure of its own.
    """
    chosen = evenly_spaced(systems)
    colours = shades(len(chosen)) if len(chosen) > 1 else [BLUE]
    title = "Bode diagram of the open plant" if swept is None else f"Bode diagrams of the open plant, along {swept}"
    draw = [partial(panel, channel=channel) for channel in CHANNELS for panel in (_gain, _phase)]
    with house_style():
        page = Page(ax, 4.6, title, point_in_words(chosen[0], swept))
        for axes, panel in zip(page.panels(2, len(CHANNELS), sharex=True), draw, strict=False):
            panel(axes, chosen, colours)
        page.align()
        if swept is not None:
            page.legend(curve_handles(chosen, colours, swept))
    return page.figure


def _gain(axes: Axes, systems: Sequence[LinearSystem], colours: Sequence[str], channel: tuple[str, str]) -> None:
    cause, effect = channel
    for system, colour in zip(systems, colours, strict=True):
        frequency, response = _response(system, cause, effect)
        axes.loglog(frequency, np.abs(response), color=colour)
    units = systems[0].units
    axes.set_title(f"{cause} → {effect}")
    axes.set_ylabel(f"gain ({units[effect]} per {units[cause]})")


def _phase(axes: Axes, systems: Sequence[LinearSystem], colours: Sequence[str], channel: tuple[str, str]) -> None:
    for system, colour in zip(systems, colours, strict=True):
        frequency, response = _response(system, *channel)
        axes.semilogx(frequency, np.degrees(np.unwrap(np.angle(response))), color=colour)
    axes.set_ylabel("phase (°)")
    axes.yaxis.set_major_locator(MultipleLocator(45))
    axes.set_xlabel("frequency (Hz)")


def _response(system: LinearSystem, cause: str, effect: str) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    last = FREQUENCIES[1] if system.dt is None else min(FREQUENCIES[1], 0.5 / system.dt)
    frequency = np.geomspace(FREQUENCIES[0], last, 1500)
    return frequency, system.between([cause], [effect]).response(2 * np.pi * frequency)[:, 0, 0]


def mode_shapes(system: LinearSystem, plant: Plant, *, ax: GivenAxes = None) -> Figure:
    """How drums and vehicle move along the track in every mode, the largest displacement drawn as one.

    Args:
        system: holds the plant's states.
        plant: the plant that was linearised.
        ax: axes for the modes, the slowest first; default: a figure of its own.

    Raises:
        ConfigurationError: the system does not hold the plant's states.
    """
    prefix = plant_prefix(system.states)
    if prefix is None:
        raise ConfigurationError("mode shapes need the states of the plant: there are none in this system")
    found = modes(system, plant)
    rows = -(-len(found) // 2)
    with house_style():
        page = Page(ax, 1.0 + 1.45 * rows, "Mode shapes of the plant", point_in_words(system, None))
        panels = page.panels(rows, 2, order="C", sharex=True, sharey=True)
        for axes, mode in zip(panels, found, strict=False):
            _shape(axes, mode, plant, prefix)
        for axes in panels[len(found) :]:
            axes.set_visible(False)
        for axes in panels[::2]:
            axes.set_ylabel("displacement")
    return page.figure


def _shape(axes: Axes, mode: Mode, plant: Plant, prefix: str) -> None:
    vehicle, drum_1, drum_2 = displacements(mode.shape, plant, prefix)
    moved = np.array([drum_2, vehicle, drum_1])
    moved = (moved / moved[np.argmax(np.abs(moved))]).real
    for rope, ends in ((2, [0, 1]), (1, [1, 2])):
        axes.plot(ends, moved[ends], color=ROPE_COLOURS[rope - 1], linewidth=1.2)
    axes.vlines([0, 1, 2], 0, moved, color=LIGHT, linewidth=4, zorder=1)
    axes.plot([0, 1, 2], moved, "o", color=INK, markersize=4.5)
    axes.axhline(0, color=GREY, linewidth=0.6, zorder=1)
    axes.set_xticks([0, 1, 2], ["drum 2's rim", "vehicle", "drum 1's rim"])
    axes.set_xlim(-0.3, 2.3)
    axes.set_ylim(-1.25, 1.25)
    axes.grid(visible=False, axis="x")
    axes.set_title(mode.label)
    words = f"{mode.natural_frequency / (2 * np.pi):.3g} Hz, damping {mode.damping:.2g}"
    if not mode.rate.imag:
        words = f"time constant {mode.time_constant:.3g} s" if mode.rate else "stays where it is"
    axes.set_title(words, loc="right", fontsize=7.5, color=GREY)


def evenly_spaced(systems: Sequence[LinearSystem]) -> list[LinearSystem]:
    """At most `MOST_CURVES` systems, evenly spaced, the first and the last among them."""
    chosen = np.unique(np.linspace(0, len(systems) - 1, MOST_CURVES).round().astype(int))
    return [systems[index] for index in chosen]


def shades(count: int) -> list[str]:
    """Colours from one end of a sweep to the other, of even steps in lightness."""
    scale = mpl.colormaps["viridis"]
    return [to_hex(scale(0.92 * index / max(count - 1, 1))) for index in range(count)]


def curve_handles(systems: Sequence[LinearSystem], colours: Sequence[str], swept: str) -> list[Line2D]:
    """Legend entries of systems drawn in colours."""
    return [
        Line2D([], [], color=colour, label=f"{swept} = {system.operating_point[swept]:.4g}")
        for system, colour in zip(systems, colours, strict=True)
    ]


def point_in_words(system: LinearSystem, swept: str | None) -> str:
    """Where a system was linearised, without what is swept."""
    units = {"x": "m", "v": "m/s", "preload": "N"}
    words = [
        f"{name} = {system.operating_point[name]:.4g} {unit}"
        for name, unit in units.items()
        if name != swept and name in system.operating_point
    ]
    sampled = "" if system.dt is None else f"; sampled every {system.dt:g} s, inputs held"
    return ", ".join(words) + sampled
