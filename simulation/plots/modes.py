"""Figures of the modes along a sweep of operating points: their frequencies and dampings, and the map of poles."""

from collections.abc import Sequence
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from dualwinch.model.linear.modes import SAMPLES_A_PERIOD, ModeTrack, track_modes
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant
from dualwinch.simulation.plots.linear import point_in_words
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.style import (
    BLUE,
    GREEN,
    GREY,
    LIGHT,
    PURPLE,
    ROPE_COLOURS,
    SKY,
    VERMILION,
    house_style,
)

TRACK_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, SKY)

AXIS_NAMES = {"x": "position x (m)", "v": "speed v (m/s)", "preload": "preload (N)"}

MARKERS = ("x", "+", "o", "s", "^", "d")

TIME = 2 * np.pi
"""Radians in a period."""


def modal_frequencies(
    systems: Sequence[LinearSystem], swept: str, plant: Plant, sample_time: float, *, ax: GivenAxes = None
) -> Figure:
    """Natural frequency and damping ratio of every mode that is not rigid drift of the position, along a sweep.

    Args:
        systems: the sweep.
        swept: its name: x, v or preload.
        plant: the plant that was linearised.
        sample_time: of the controller in s; frequencies it samples `SAMPLES_A_PERIOD` times and twice a period are
            marked.
        ax: axes for frequency and damping; default: a figure of its own.
    """
    tracks = [track for track in track_modes(systems, plant) if np.any(track.natural_frequencies > 0)]
    colours = _colours(tracks)
    values = [system.operating_point[swept] for system in systems]
    with house_style():
        handles = [
            Line2D([], [], color=colour, label=track.label) for track, colour in zip(tracks, colours, strict=True)
        ]
        page = Page(ax, 5.0, f"Modes of the plant along {swept}", point_in_words(systems[0], swept))
        panels = page.panels(2, sharex=True, height_ratios=(1.6, 1))
        for axes in panels[:1]:
            for track, colour in zip(tracks, colours, strict=True):
                axes.semilogy(values, track.natural_frequencies / TIME, color=colour)
            handles += _sampled(axes, sample_time)
            axes.set_ylabel("natural frequency (Hz)")
        for axes in panels[1:]:
            for track, colour in zip(tracks, colours, strict=True):
                axes.plot(values, track.dampings, color=colour)
            axes.set_ylabel("damping ratio")
            axes.set_ylim(bottom=min(0.0, *(track.dampings.min() for track in tracks)))
        panels[-1].set_xlabel(AXIS_NAMES[swept])
        panels[-1].set_xlim(min(values), max(values))
        page.align()
        page.legend(handles)
    return page.figure


def _sampled(axes: Axes, sample_time: float) -> list[Line2D]:
    """Mark the frequencies that are sampled twice and `SAMPLES_A_PERIOD` times a period; returns legend entries."""
    handles = []
    for samples, dashes in ((2, (0, (5, 2))), (SAMPLES_A_PERIOD, (0, (1, 1.5)))):
        axes.axhline(1 / (samples * sample_time), color=GREY, linewidth=0.8, linestyle=dashes)
        words = f"{samples} samples a period at {1 / sample_time:g} Hz"
        handles.append(Line2D([], [], color=GREY, linewidth=0.8, linestyle=dashes, label=words))
    return handles


def pole_map(systems: Sequence[LinearSystem], swept: str, plant: Plant, *, ax: GivenAxes = None) -> Figure:
    """Poles along a sweep: oscillations in the upper half plane, and the real poles against what is swept.

    Of a discrete system, the rates in continuous time that its eigenvalues stand for.

    Args:
        systems: the sweep.
        swept: its name: x, v or preload.
        plant: the plant that was linearised.
        ax: axes for the oscillations and for the real poles; default: a figure of its own.
    """
    tracks = track_modes(systems, plant)
    values = np.array([system.operating_point[swept] for system in systems])
    swinging = [track for track in tracks if np.any(track.rates.imag != 0)]
    drifting = [track for track in tracks if track not in swinging]
    with house_style():
        page = Page(ax, 4.2, f"Poles of the plant along {swept}", point_in_words(systems[0], swept))
        panels = page.panels(1, 2)
        norm = Normalize(values.min(), values.max())
        handles: list[Line2D] = []
        for axes in panels[:1]:
            for track, marker in zip(swinging, cycle(MARKERS), strict=False):
                handles.append(_poles(axes, track.rates.imag, track, values, norm, marker))
            axes.set_title("oscillations (upper half plane)")
            axes.set_xlim(1.3 * axes.get_xlim()[0], max(0.0, axes.get_xlim()[1]))
            axes.set_ylim(0, 1.08 * axes.get_ylim()[1])
            axes.set_xlabel("real part (1/s)")
            axes.set_ylabel("imaginary part (rad/s)")
        for axes in panels[1:]:
            for track, marker in zip(drifting, cycle(MARKERS[2:] + MARKERS[:2]), strict=False):
                handles.append(_poles(axes, values, track, values, norm, marker))
            axes.set_title("without oscillation")
            axes.set_xlabel("real part (1/s)")
            axes.set_ylabel(AXIS_NAMES[swept])
        page.figure.colorbar(ScalarMappable(norm, "viridis"), ax=panels, label=AXIS_NAMES[swept], aspect=30)
        page.legend(handles)
    return page.figure


def _poles(
    axes: Axes,
    heights: NDArray[np.float64],
    track: ModeTrack,
    values: NDArray[np.float64],
    norm: Normalize,
    marker: str,
) -> Line2D:
    """Draw a track with a marker; returns its legend entry."""
    axes.plot(track.rates.real, heights, color=LIGHT, linewidth=0.6, zorder=1)
    axes.scatter(track.rates.real, heights, c=values, norm=norm, cmap="viridis", marker=marker, s=18, linewidths=0.9)
    return Line2D([], [], linestyle="", marker=marker, color=GREY, label=track.label)


def _colours(tracks: Sequence[ModeTrack]) -> list[str]:
    """A rope's own colour for what happens at that rope, others for the rest."""
    others = cycle(TRACK_COLOURS)
    own = {"rope 1 – drum 1": ROPE_COLOURS[0], "rope 2 – drum 2": ROPE_COLOURS[1]}
    return [own.get(track.label) or next(others) for track in tracks]
