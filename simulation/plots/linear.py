"""Figures of linear systems: Bode plots, modes and poles of plant and closed loop, margins by amplitude."""

import math
from collections.abc import Sequence
from functools import partial
from itertools import cycle

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.modes import (
    SAMPLES_A_PERIOD,
    Mode,
    ModeTrack,
    displacements,
    modes,
    plant_prefix,
    track_modes,
)
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant
from dualwinch.simulation.analysis.describing_function import AmplitudePoint
from dualwinch.simulation.analysis.margins import Margins
from dualwinch.simulation.plots.page import GivenAxes, Page
from dualwinch.simulation.plots.style import (
    BLUE,
    GOLD,
    GREEN,
    GREY,
    INK,
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
        for axes, draw in zip(panels, (_loop_gain, _loop_phase), strict=False):
            draw(axes, list(zip(chosen, colours, strict=True)), margins)
        panels[-1].set_xlabel("frequency (Hz)")
        if len(chosen) > 1:
            page.legend(curve_handles(chosen, colours, swept or ""))
    return page.figure


def _loop_gain(axes: Axes, drawn: Sequence[tuple[LinearSystem, str]], found: Margins | None) -> None:
    for system, colour in drawn:
        frequency, response = _loop_response(system)
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


def _loop_phase(axes: Axes, drawn: Sequence[tuple[LinearSystem, str]], found: Margins | None) -> None:
    for system, colour in drawn:
        frequency, response = _loop_response(system)
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


def _loop_response(system: LinearSystem) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
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
