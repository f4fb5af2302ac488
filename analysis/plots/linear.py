"""Figures of linear systems: Bode plots, modes and poles of plant and closed loop, margins by amplitude.

They draw a sweep of systems along the quantity `swept`, which is x, v or preload; some also a single one, without it.
"""

import math
from collections.abc import Sequence
from itertools import cycle
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from dualwinch.analysis.describing_function import AmplitudePoint
from dualwinch.analysis.linear_figures import listed_modes
from dualwinch.analysis.margins import Margins, continuous_loci
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.modes import (
    SAMPLES_A_PERIOD,
    Mode,
    displacements,
    modes,
    plant_prefix,
    track_modes,
)
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant
from dualwinch.simulation.plots.page import GivenAxes, new_page
from dualwinch.simulation.plots.style import (
    BLUE,
    DASHES,
    GOLD,
    GREEN,
    GREY,
    INK,
    LIGHT,
    PURPLE,
    ROPE_COLOURS,
    SKY,
    VERMILION,
    zero_line,
)

TRACK_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, SKY)

ROPE_TRACKS = {"rope 1 – drum 1": ROPE_COLOURS[0], "rope 2 – drum 2": ROPE_COLOURS[1]}
"""Mode of a rope → colour of the rope."""

OPERATING_POINT = {"x": ("position", "m"), "v": ("speed", "m/s"), "preload": ("", "N")}
"""Quantity of an operating point → name in words, and unit."""

MARKERS = ("x", "+", "o", "s", "^", "d", "v", "*", "p", "<", "P", ">", "h", "X")
"""Markers of the modes in the pole map."""

FREQUENCIES = (1e-2, 1e3)
"""Frequency range of Bode diagrams in Hz; for a discrete system up to half its sample rate."""

MOST_CURVES = 7
"""Maximum number of systems drawn of a sweep."""

TURN = 2 * np.pi
"""Radians in a period."""

DEADBEAT = 1e-9
"""Eigenvalues smaller than this are zero up to round-off: they decay within a sample and have no rate."""

Drawn = list[tuple[LinearSystem, dict[str, Any]]]
"""Systems, each with the style of its lines."""


def _styled(systems: Sequence[LinearSystem], swept: str | None) -> Drawn:
    """At most `MOST_CURVES` evenly spaced systems, in colours with equal steps of lightness; a single one in blue."""
    indices = np.unique(np.linspace(0, len(systems) - 1, MOST_CURVES).round().astype(int))
    if len(indices) == 1:
        return [(systems[0], {"color": BLUE, "label": _value(systems[0], swept) if swept else None})]
    scale = mpl.colormaps["viridis"]
    colours = [scale(0.92 * number / (len(indices) - 1)) for number in range(len(indices))]
    return [
        (systems[index], {"color": colour, "label": _value(systems[index], swept)})
        for index, colour in zip(indices, colours, strict=True)
    ]


def _value(system: LinearSystem, swept: str | None) -> str:
    return f"{swept} = {system.operating_point[swept or '']:.4g}"


def _point_in_words(system: LinearSystem, swept: str | None) -> str:
    """Operating point of a system in words, without the swept quantity."""
    words = [
        f"{name} = {system.operating_point[name]:.4g} {unit}"
        for name, (_, unit) in OPERATING_POINT.items()
        if name != swept and name in system.operating_point
    ]
    return ", ".join(words) + ("" if system.dt is None else f"; sampled every {system.dt:g} s, inputs held")


def _axis_name(swept: str) -> str:
    words, unit = OPERATING_POINT[swept]
    return f"{words} {swept} ({unit})".strip()


def _track_looks(labels: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Label → colour and line style: no two alike up to 25; successive ones, which may coincide, differ in both."""
    colours, dashes = len(TRACK_COLOURS), len(DASHES)
    return {
        label: {"color": TRACK_COLOURS[k % colours], "linestyle": DASHES[(k + k // colours) % dashes]}
        for k, label in enumerate(labels)
    }


def modal_frequencies(
    systems: Sequence[LinearSystem], swept: str, plant: Plant, sample_time: float, *, ax: GivenAxes = None
) -> Figure:
    """Natural frequency and damping ratio of every mode that is not rigid drift of the position, along a sweep.

    The frequencies with `SAMPLES_A_PERIOD` and with two samples per period of the controller, whose sample time is in
    s, are marked. Panels: frequency and damping.
    """
    tracks = [track for track in track_modes(systems, plant) if np.any(track.natural_frequencies > 0)]
    looks = _track_looks([track.label for track in tracks if track.label not in ROPE_TRACKS])
    values = [system.operating_point[swept] for system in systems]
    with new_page(ax, 5.0, f"Modes of the plant along {swept}", _point_in_words(systems[0], swept)) as page:
        frequency, damping = panels = page.panels(2, sharex=True, height_ratios=(1.6, 1))
        for track in tracks:
            style = looks.get(track.label) or {"color": ROPE_TRACKS[track.label]}
            frequency.semilogy(values, track.natural_frequencies / TURN, **style, label=track.label)
            damping.plot(values, track.dampings, **style, label=track.label)
        for samples, dashes in ((2, (0, (5, 2))), (SAMPLES_A_PERIOD, (0, (1, 1.5)))):
            words = f"{samples} samples a period at {1 / sample_time:g} Hz"
            frequency.axhline(1 / (samples * sample_time), color=GREY, linewidth=0.8, linestyle=dashes, label=words)
        frequency.set_ylabel("natural frequency (Hz)")
        damping.set_ylabel("damping ratio")
        damping.set_ylim(bottom=min(0.0, *(track.dampings.min() for track in tracks)))
        for axes in panels:
            axes.set_xlim(min(values), max(values))
        page.name_x(panels, _axis_name(swept))
        page.legend()
    return page.figure


def pole_map(systems: Sequence[LinearSystem], swept: str, plant: Plant, *, ax: GivenAxes = None) -> Figure:
    """Poles along a sweep: oscillations in the upper half-plane, and real poles against the swept quantity.

    For a discrete system, the equivalent continuous-time poles. Panels: oscillations, real poles.
    """
    values = np.array([system.operating_point[swept] for system in systems])
    norm = Normalize(values.min(), values.max())
    with new_page(ax, 4.2, f"Poles of the plant along {swept}", _point_in_words(systems[0], swept)) as page:
        swinging, drifting = page.panels(1, 2)
        markers = {swinging: cycle(MARKERS), drifting: cycle(MARKERS[2:] + MARKERS[:2])}
        for track in track_modes(systems, plant):
            swings = np.any(track.rates.imag != 0)
            axes, heights = (swinging, track.rates.imag) if swings else (drifting, values)
            marker = next(markers[axes])
            axes.plot(track.rates.real, heights, color=LIGHT, linewidth=0.6, zorder=1)
            coloured = {"c": values, "norm": norm, "cmap": "viridis"}
            axes.scatter(track.rates.real, heights, **coloured, marker=marker, s=18, linewidths=0.9)
            axes.plot([], [], linestyle="", marker=marker, color=GREY, label=track.label)
        swinging.set_title("oscillations (upper half plane)")
        swinging.set_xlim(1.3 * swinging.get_xlim()[0], max(0.0, swinging.get_xlim()[1]))
        swinging.set_ylim(0, 1.08 * swinging.get_ylim()[1])
        swinging.set(xlabel="real part (1/s)", ylabel="imaginary part (rad/s)")
        drifting.set(title="without oscillation", xlabel="real part (1/s)", ylabel=_axis_name(swept))
        page.figure.colorbar(ScalarMappable(norm, "viridis"), ax=page.drawn, label=_axis_name(swept), aspect=30)
        page.legend()
    return page.figure


def mode_shapes(system: LinearSystem, plant: Plant, *, ax: GivenAxes = None) -> Figure:
    """Displacements along the track in every mode, normalised to a maximum of one; modes of one name are numbered.

    Dots are nodes of ropes, squares the rotors behind elastic gearboxes, triangles the depth of a sag. A panel for each
    mode, the slowest first.

    Raises:
        ConfigurationError: the system does not have the plant's states.
    """
    prefix = plant_prefix(system.states)
    if prefix is None:
        raise ConfigurationError("mode shapes need the states of the plant: there are none in this system")
    system_modes = listed_modes(modes(system, plant), of_loop=False)
    rows = -(-len(system_modes) // 2)
    with new_page(ax, 1.0 + 1.6 * rows, "Mode shapes of the plant", _point_in_words(system, None)) as page:
        panels = page.panels(rows, 2, order="C", sharex=True, sharey=True)
        for axes, mode in zip(panels, system_modes, strict=False):
            _shape(axes, mode, plant, prefix)
        for axes in panels[len(system_modes) :]:
            axes.set_visible(False)
        for axes in panels[::2]:
            axes.set_ylabel("displacement")
    return page.figure


REMARK = {"fontsize": 7.5, "color": GREY}
"""Style of the remark under the name of a mode."""

ROTOR = 0.2
"""Distance of a rotor from its drum in a mode shape's figure, relative to that of the vehicle."""


def _shape(axes: Axes, mode: Mode, plant: Plant, prefix: str) -> None:
    displaced = displacements(mode.shape, plant, prefix)
    for side, colour, place in zip(displaced.sides[::-1], ROPE_COLOURS[::-1], (0, 2), strict=True):
        amplitudes = (np.array([side.drum, *side.nodes, displaced.vehicle]) / displaced.largest).real
        at = np.linspace(place, 1, len(amplitudes))
        axes.plot(at, amplitudes, color=colour, linewidth=1.2)
        axes.plot(at[1:-1], amplitudes[1:-1], ".", color=colour)
        axes.vlines(at, 0, amplitudes, color=LIGHT, linewidth=4, zorder=1)
        axes.plot(at[[0, -1]], amplitudes[[0, -1]], "o", color=INK, markersize=4.5)
        if side.rotor is not None:
            ends, turned = [place, place + ROTOR * (place - 1)], (side.rotor / displaced.largest).real
            axes.plot(ends, [amplitudes[0], turned], ":", color=INK, linewidth=1)
            axes.plot(ends[1], turned, "s", color=INK, markersize=3.5)
        if side.sag:
            axes.plot((place + 1) / 2, (side.sag / displaced.largest).real, "v", color=colour, fillstyle="none")
    zero_line(axes)
    axes.set_xticks([0, 1, 2], ["drum 2's rim", "vehicle", "drum 1's rim"])
    axes.set(xlim=(-0.3, 2.3), ylim=(-1.25, 1.25))
    axes.grid(visible=False, axis="x")
    words = f"{mode.natural_frequency / TURN:.3g} Hz, damping {mode.damping:.2g}"
    if not mode.rate.imag:
        words = f"time constant {mode.time_constant:.3g} s" if mode.rate else "stays where it is"
    axes.set_title(mode.label, pad=13)  # above the remark: beside it, long names have no room
    axes.annotate(words, (0, 1), xytext=(0, 4), textcoords="offset points", xycoords="axes fraction", **REMARK)


CHANNELS = (("tau_1", "F1"), ("tau_2", "F2"), ("tau_1", "v"))
"""Input and output of each column of the Bode diagram."""


def bode(systems: Sequence[LinearSystem], swept: str | None = None, *, ax: GivenAxes = None) -> Figure:
    """Bode diagram of each winch's tension and of the vehicle's speed, from the torques, of one plant or a sweep.

    Panels: gain and phase of each of the `CHANNELS`.
    """
    title = "Bode diagram of the open plant" if swept is None else f"Bode diagrams of the open plant, along {swept}"
    units = systems[0].units
    with new_page(ax, 4.6, title, _point_in_words(systems[0], swept)) as page:
        panels = page.panels(2, len(CHANNELS), sharex=True)
        for gain, phase, (cause, effect) in zip(panels[::2], panels[1::2], CHANNELS, strict=True):
            for system, style in _styled(systems, swept):
                frequency, responses = _responses(system.between([cause], [effect]))
                response = responses[:, 0, 0]
                gain.loglog(frequency, np.abs(response), **style)
                phase.semilogx(frequency, np.degrees(np.unwrap(np.angle(response))), **style)
            gain.set(title=f"{cause} → {effect}", ylabel=f"gain ({units[effect]} per {units[cause]})")
            phase.set(xlabel="frequency (Hz)", ylabel="phase (°)")
            phase.yaxis.set_major_locator(MultipleLocator(45))
        page.legend()
    return page.figure


def _responses(system: LinearSystem) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Frequencies in Hz (k,), and the frequency response of a system (k, outputs, inputs)."""
    last = FREQUENCIES[1] if system.dt is None else 0.5 / system.dt * (1 - 1e-9)
    frequency = np.geomspace(FREQUENCIES[0], last, 2000)
    return frequency, system.response(TURN * frequency)


def _loci(response: NDArray[np.complex128]) -> list[NDArray[np.complex128]]:
    """The loop gain (k,) of one signal, or the characteristic loci of two with equal changes."""
    if response.shape[1] == 1:
        return [response[:, 0, 0]]
    return list(continuous_loci(*np.linalg.eigvals(response).T))


def _opening(system: LinearSystem) -> str:
    """Opening of a loop in words."""
    return " and ".join(name.removesuffix("_in") for name in system.inputs)


def loop_bode(
    systems: Sequence[LinearSystem], loop_margins: Sequence[Margins], swept: str | None = None, *, ax: GivenAxes = None
) -> Figure:
    """Gain and phase of a loop opened at one signal or at both torques; of a single one with its margins.

    Panels: gain, phase.
    """
    looks = _styled(systems, swept)
    title = f"Loop opened at {_opening(systems[0])}"
    with new_page(ax, 5.0, title, _point_in_words(systems[0], swept)) as page:
        gain, phase = panels = page.panels(2, sharex=True)
        for system, style in looks:
            frequency, response = _responses(system)
            for locus in _loci(response):
                if locus.any():
                    gain.loglog(frequency, np.abs(locus), **style)
                    phase.semilogx(frequency, _lag(locus), **style)
        for axes, level, name in ((gain, 1, "gain"), (phase, -180, "phase (°)")):
            axes.axhline(level, color=GREY, linewidth=0.7)
            axes.set_ylabel(name)
        if len(looks) == 1:
            _mark_margins(gain, phase, loop_margins[0])
        page.name_x(panels, "frequency (Hz)")
        page.legend()
    return page.figure


def _lag(response: np.ndarray) -> np.ndarray:
    """Phase in degrees, unwrapped, between −360 and 0 at the lowest frequency."""
    phase = np.degrees(np.unwrap(np.angle(response)))
    return phase - 360 * math.ceil(phase[0] / 360)


def _mark_margins(gain: Axes, phase: Axes, margins_of_loop: Margins) -> None:
    """Mark gain and phase margin as distances, with dots at their frequencies in the other panel.

    An unstable loop has no margins.
    """
    if not margins_of_loop.stable:
        gain.set_title("unstable: no margins", color=VERMILION)
        return
    if math.isfinite(margins_of_loop.gain):
        at = margins_of_loop.gain_frequency / TURN
        gain.vlines(at, 1 / margins_of_loop.gain, 1, color=VERMILION, linewidth=2.0)
        phase.plot([at], [-180], "o", color=VERMILION, markersize=4)
    if math.isfinite(margins_of_loop.phase):
        at = margins_of_loop.phase_frequency / TURN
        gain.plot([at], [1], "o", color=GREEN, markersize=4)
        phase.vlines(at, -180, -180 + margins_of_loop.phase, color=GREEN, linewidth=2.0)
    gain.set_title(f"gain margin {margins_of_loop.gain:.3g}, disk margin {margins_of_loop.disk:.3g}", color=VERMILION)
    phase.set_title(
        f"phase margin {margins_of_loop.phase:.3g}°, delay margin {1e3 * margins_of_loop.delay:.3g} ms", color=GREEN
    )


def closed_loop_poles(systems: Sequence[LinearSystem], swept: str | None = None, *, ax: GivenAxes = None) -> Figure:
    """Eigenvalues of closed loops over one sample in the unit circle, and the equivalent rates; a panel each."""
    angle = np.linspace(0, TURN, 400)
    with new_page(ax, 4.2, "Poles of the closed loop", _point_in_words(systems[0], swept)) as page:
        circle, plane = page.panels(1, 2)
        circle.plot(np.cos(angle), np.sin(angle), color=INK, linewidth=0.8)
        for system, style in _styled(systems, swept):
            poles = system.poles()
            rates = np.log(poles[np.abs(poles) > DEADBEAT]) / (system.dt or 1.0)
            circle.plot(poles.real, poles.imag, "x", markersize=5, **style)
            plane.plot(rates.real, rates.imag / TURN, "x", markersize=5, **style)
        circle.set_aspect("equal")
        circle.set(title="eigenvalues of one sample", xlabel="real part", ylabel="imaginary part")
        plane.set_xscale("symlog", linthresh=1e-2)
        plane.axvline(0, color=INK, linewidth=0.8)
        plane.set(title="as rates: left of the line is stable", xlabel="decay or growth (1/s)", ylabel="frequency (Hz)")
        page.legend()
    return page.figure


def amplitude_margins(points: Sequence[AmplitudePoint], *, ax: GivenAxes = None) -> Figure:
    """Margins against the amplitude of the speed error, with the Jacobian's at the left end; gaps where unstable.

    For the points of `analysis.describing_function.amplitude_sweep`. Panels: gain margins, delay margin.
    """
    system, margins = points[0].system, [point.margins for point in points]
    amplitude = 1e3 * np.array([point.amplitude for point in points])
    sound = [1.0 if each.stable else math.nan for each in margins]
    title = f"Margins of the loop opened at {_opening(system)} depend on amplitude"
    with new_page(ax, 5.0, title, _point_in_words(system, None)) as page:
        gain, delay = panels = page.panels(2, sharex=True)
        for axes, name, label, colour, factor in (
            (gain, "gain", "gain margin", VERMILION, 1.0),
            (gain, "disk_gain", "gain margin of the disk", GOLD, 1.0),
            (delay, "delay", "delay margin", GREEN, 1e3),
        ):
            values = factor * np.array([getattr(each, name) for each in margins]) * sound
            axes.loglog(amplitude, values, color=colour, label=label)
        gain.set_ylabel("factor on the gain")
        delay.set_ylabel("delay (ms)")
        page.name_x(panels, "amplitude of the speed error $e_2$ (mm/s)")
        page.legend()
    return page.figure
