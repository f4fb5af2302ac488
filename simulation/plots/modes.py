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

from dualwinch.model.linear.mode_tracks import ModeTrack, track_modes
from dualwinch.model.linear.modes import SAMPLES_A_PERIOD
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant
from dualwinch.simulation.plots.linear import point_in_words
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
    legend_below,
    new_figure,
)

TRACK_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, SKY)

AXIS_NAMES = {"x": "position x (m)", "v": "speed v (m/s)", "preload": "preload (N)"}

MARKERS = ("x", "+", "o", "s", "^", "d")

TIME = 2 * np.pi
"""Radians in a period."""


def modal_frequencies(systems: Sequence[LinearSystem], swept: str, plant: Plant, sample_time: float) -> Figure:
    """Natural frequency and damping ratio of every mode that is not rigid drift of the position, along a sweep.

    Args:
        systems: the sweep.
        swept: its name: x, v or preload.
        plant: the plant that was linearised.
        sample_time: of the controller in s; frequencies it samples `SAMPLES_A_PERIOD` times and twice a period are
            marked.
    """
    tracks = [track for track in track_modes(systems, plant) if np.any(track.natural_frequencies > 0)]
    values = [system.operating_point[swept] for system in systems]
    with house_style():
        figure = new_figure(5.0, f"Modes of the plant along {swept}", point_in_words(systems[0], swept))
        frequency, damping = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1))
        handles = []
        for track, colour in zip(tracks, _colours(tracks), strict=True):
            frequency.semilogy(values, track.natural_frequencies / TIME, color=colour)
            damping.plot(values, track.dampings, color=colour)
            handles.append(Line2D([], [], color=colour, label=track.label))
        for samples, dashes in ((2, (0, (5, 2))), (SAMPLES_A_PERIOD, (0, (1, 1.5)))):
            frequency.axhline(1 / (samples * sample_time), color=GREY, linewidth=0.8, linestyle=dashes)
            words = f"{samples} samples a period at {1 / sample_time:g} Hz"
            handles.append(Line2D([], [], color=GREY, linewidth=0.8, linestyle=dashes, label=words))
        frequency.set_ylabel("natural frequency (Hz)")
        damping.set_ylabel("damping ratio")
        damping.set_xlabel(AXIS_NAMES[swept])
        damping.set_ylim(bottom=min(0.0, *(track.dampings.min() for track in tracks)))
        damping.set_xlim(min(values), max(values))
        figure.align_ylabels()
        legend_below(figure, [*handles])
    return figure


def pole_map(systems: Sequence[LinearSystem], swept: str, plant: Plant) -> Figure:
    """Poles along a sweep: oscillations in the upper half plane, and the real poles against what is swept.

    Of a discrete system, the rates in continuous time that its eigenvalues stand for.
    """
    tracks = track_modes(systems, plant)
    values = np.array([system.operating_point[swept] for system in systems])
    swinging = [track for track in tracks if np.any(track.rates.imag != 0)]
    drifting = [track for track in tracks if track not in swinging]
    with house_style():
        figure = new_figure(4.2, f"Poles of the plant along {swept}", point_in_words(systems[0], swept))
        fast, slow = figure.subplots(1, 2)
        norm = Normalize(values.min(), values.max())
        handles = [_poles(fast, track.rates.imag, track, values, norm, place) for place, track in enumerate(swinging)]
        handles += [_poles(slow, values, track, values, norm, 2 + place) for place, track in enumerate(drifting)]
        fast.set_title("oscillations (upper half plane)")
        fast.set_xlim(1.3 * fast.get_xlim()[0], max(0.0, fast.get_xlim()[1]))
        fast.set_ylim(0, 1.08 * fast.get_ylim()[1])
        fast.set_xlabel("real part (1/s)")
        fast.set_ylabel("imaginary part (rad/s)")
        slow.set_title("without oscillation")
        slow.set_xlabel("real part (1/s)")
        slow.set_ylabel(AXIS_NAMES[swept])
        figure.colorbar(ScalarMappable(norm, "viridis"), ax=[fast, slow], label=AXIS_NAMES[swept], aspect=30)
        legend_below(figure, [*handles])
    return figure


def _poles(
    axes: Axes,
    heights: NDArray[np.float64],
    track: ModeTrack,
    values: NDArray[np.float64],
    norm: Normalize,
    place: int,
) -> Line2D:
    """Draw a track with the marker of its place; returns its legend entry."""
    marker = MARKERS[place % len(MARKERS)]
    axes.plot(track.rates.real, heights, color=LIGHT, linewidth=0.6, zorder=1)
    axes.scatter(track.rates.real, heights, c=values, norm=norm, cmap="viridis", marker=marker, s=18, linewidths=0.9)
    return Line2D([], [], linestyle="", marker=marker, color=GREY, label=track.label)


def _colours(tracks: Sequence[ModeTrack]) -> list[str]:
    """A rope's own colour for what happens at that rope, others for the rest."""
    others = cycle(TRACK_COLOURS)
    own = {"rope 1 – drum 1": ROPE_COLOURS[0], "rope 2 – drum 2": ROPE_COLOURS[1]}
    return [own.get(track.label) or next(others) for track in tracks]
