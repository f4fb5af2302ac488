"""Figures of runs over time: the paper's Figures 5 to 20, and any columns."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator
from matplotlib.typing import LineStyleType

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.plots.page import GivenAxes, Page, headings
from dualwinch.simulation.plots.style import (
    BLUE,
    DASHES,
    GOLD,
    GREEN,
    GREY,
    INK,
    PURPLE,
    SKY,
    VERMILION,
    WINE,
    house_style,
    law_colour,
    law_dashes,
    law_kind,
    law_label,
    plain,
    shade,
    steady_handle,
    time_axis,
)
from dualwinch.simulation.plots.traces import Floats, drawable, finely, largest, peaks, thin, within
from dualwinch.simulation.results.result import Result

Runs: TypeAlias = Mapping[Any, Result] | Iterable[Result] | Result
"""Label → run, runs that are labelled by their position laws, or one run."""

Look: TypeAlias = tuple[str, LineStyleType]
"""Colour and line style."""

PALETTE = (GOLD, WINE, GREY, PURPLE, SKY, GREEN, VERMILION, BLUE)
"""Colours of runs whose law's own is taken; colours of no law come first."""


@dataclass(frozen=True)
class Curve:
    """A run as every panel draws it.

    Attributes:
        label: its name.
        result: the run.
        colour, dashes: of its lines.
    """

    label: str
    result: Result
    colour: str
    dashes: LineStyleType

    @property
    def experiment(self) -> Experiment:
        """What was run."""
        return self.result.experiment

    @property
    def handle(self) -> Line2D:
        """Its entry in a legend, with the run's end where it ended early."""
        return Line2D([], [], color=self.colour, linestyle=self.dashes, label=f"{self.label}{ending(self.result)}")

    def draw(self, axes: Axes, t: Floats, values: Floats, **style: Any) -> None:
        """Draw a line of the run: times and values (rows,)."""
        axes.plot(*thin(t, values), **{"color": self.colour, "linestyle": self.dashes, "label": self.label} | style)


def curves(runs: Runs) -> list[Curve]:
    """Runs as a figure draws them, in the order given; none is left out.

    A run has its position law's own colour and line style, where no run before it has them; else others. A label that
    is the name of the run's law in configurations stands for that law's name in figures.

    Args:
        runs: label → run, runs, or one run.

    Raises:
        ConfigurationError: there is none, or one keeps no rows.
    """
    labelled = _labelled(runs)
    if not labelled:
        raise ConfigurationError("a figure needs at least one result")
    for label, result in labelled:
        if not isinstance(result, Result):
            raise ConfigurationError(f"{label}: a figure draws results of simulate, not {type(result).__name__}")
        if not len(result["t"]):
            raise ConfigurationError(f"the result of {label} keeps no rows: simulate with stride >= 1")
    looks = _looks([result.experiment for _, result in labelled])
    return [
        Curve(_named(label, result), result, colour, dashes)
        for (label, result), (colour, dashes) in zip(labelled, looks, strict=True)
    ]


def ending(result: Result) -> str:
    """How a run ended, in brackets; nothing for one that was completed."""
    if result.outcome == "completed":
        return ""
    return f" ({result.outcome.replace('_', ' ')} at {result.end_time:.3g} s)"


def longest(drawn: Iterable[Curve]) -> Experiment:
    """The experiment that lasts longest: a time axis has room for it."""
    return max((curve.experiment for curve in drawn), key=lambda experiment: experiment.duration)


def _labelled(runs: Runs) -> list[tuple[str, Result]]:
    if isinstance(runs, Result):
        return [(law_label(runs.experiment), runs)]
    if isinstance(runs, Mapping):
        return [(str(label), result) for label, result in runs.items()]
    given = list(runs)
    names = [law_label(result.experiment) if isinstance(result, Result) else "results" for result in given]
    count, seen = Counter(names), Counter[str]()
    labels: list[str] = []
    for name in names:
        seen[name] += 1
        labels.append(f"{name} ({seen[name]})" if count[name] > 1 else name)
    return list(zip(labels, given, strict=True))


def _named(label: str, result: Result) -> str:
    return plain(law_label(result.experiment) if label == law_kind(result.experiment) else label)


def _looks(experiments: list[Experiment]) -> list[Look]:
    """Colour and line style of every run: its law's own, or else the first that no other has."""
    own: list[Look] = [(law_colour(experiment), law_dashes(experiment)) for experiment in experiments]
    taken = list(dict.fromkeys(own))
    looks: list[Look] = []
    for look in own:
        chosen = look if look not in looks else _free(taken)
        taken.append(chosen)
        looks.append(chosen)
    return looks


def _free(taken: list[Look]) -> Look:
    """A look of a colour that is not taken, while there is one, and of the line style that fewest have."""
    colours = {colour for colour, _ in taken}
    rare = sorted(DASHES, key=[dashes for _, dashes in taken].count)
    looks = [look for look in product(PALETTE, rare) if look not in taken] or list(product(PALETTE, rare))
    return next((look for look in looks if look[0] not in colours), looks[0])


PREFIXES = ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm"))
"""Units of length an error is shown in, the largest first."""

COMPARABLE = 10.0
"""Errors up to this many times the smallest controller's share a panel; a larger one is given in words."""

ZOOM = 0.4
"""Length in s of the stretch of a trajectory shown enlarged."""

INTERVALS = 200
"""Intervals of a run whose largest |e| is drawn on the logarithmic panel."""

REFERENCE = {"color": INK, "linestyle": ":", "linewidth": 1.0, "label": "reference"}
"""How a reference is drawn."""


def length_unit(largest: float) -> tuple[float, str]:
    """The unit (in m) and its name that show a length in m with few digits."""
    for unit, name in PREFIXES:
        if largest >= unit:
            return unit, name
    return PREFIXES[-1]


def trajectory(results: Runs, *, ax: GivenAxes = None) -> Figure:
    """Position and speed against the reference, with a zoom on where they part most (Figures 5, 9, 13, 17).

    Args:
        results: label → result, or results that are labelled by their position laws.
        ax: axes for the position and the speed; default: a figure of its own.

    Raises:
        ConfigurationError: there is nothing to draw.
    """
    runs = curves(results)
    with house_style():
        page = Page(ax, 5.2, *headings([run.experiment for run in runs], "trajectory", "tracking trajectory"))
        panels = page.panels(2, sharex=True, height_ratios=(1.6, 1))
        for axes, draw in zip(panels, (_position, _speed), strict=False):
            draw(axes, runs)
        page.time_axes(panels, longest(runs))
        reference = Line2D([], [], color=INK, linestyle=":", label="reference")
        page.legend([*(run.handle for run in runs), reference, steady_handle()])
    return page.figure


def error(results: Runs, *, ax: GivenAxes = None) -> Figure:
    """Tracking error: whole run, largest magnitude on a logarithmic axis, steady state (Figures 6, 10, 14, 18).

    Args:
        results: label → result, or results that are labelled by their position laws.
        ax: axes for these three; default: a figure of its own.

    Raises:
        ConfigurationError: there is nothing to draw.
    """
    runs = curves(results)
    with house_style():
        page = Page(ax, 5.4, *headings([run.experiment for run in runs], "error", "tracking error"))
        panels = page.mosaic([["whole", "whole"], ["decades", "steady"]], height_ratios=(1.05, 1))
        for axes, draw in zip(panels, (_whole_error, _error_decades, _steady_error), strict=False):
            draw(axes, runs)
        page.legend([*(run.handle for run in runs), steady_handle()])
    return page.figure


def _position(axes: Axes, runs: Sequence[Curve]) -> None:
    _against_reference(axes, runs, "x", "x_ref")
    axes.set_ylabel("position $x$ (m)")
    _zoom(axes, runs, _late_steady_state(runs[0].experiment))


def _speed(axes: Axes, runs: Sequence[Curve]) -> None:
    _against_reference(axes, runs, "v", "v_ref")
    axes.set_ylabel("speed $v$ (m/s)")


def _against_reference(axes: Axes, runs: Sequence[Curve], column: str, reference: str) -> None:
    shade(axes, runs[0].experiment)
    for run in runs:
        run.draw(axes, run.result["t"], run.result[column])
    for run in _references(runs):
        run.draw(axes, run.result["t"], run.result[reference], **REFERENCE)


def _references(runs: Sequence[Curve]) -> list[Curve]:
    """A run of every reference."""
    found: dict[object, Curve] = {}
    for run in runs:
        found.setdefault((run.experiment.reference, run.experiment.duration), run)
    return list(found.values())


def _late_steady_state(experiment: Experiment) -> tuple[float, float]:
    """Start and end in s of the last stretch of the steady state, where the lags that stay are seen."""
    end = min(experiment.steady_window[1], experiment.duration)
    return max(end - ZOOM, 0.0), end


def _zoom(axes: Axes, runs: Sequence[Curve], window: tuple[float, float]) -> None:
    inset = axes.inset_axes((0.69, 0.13, 0.29, 0.42))
    lowest, highest = np.inf, -np.inf
    lines = [(run, "x", {"linewidth": 1.0}) for run in runs]
    lines += [(run, "x_ref", REFERENCE) for run in _references(runs)]
    for run, column, style in lines:
        rows = within(run.result["t"], *window)
        t, values = thin(run.result["t"][rows], run.result[column][rows])
        if np.isfinite(values).any():
            lowest, highest = min(lowest, np.nanmin(values)), max(highest, np.nanmax(values))
        run.draw(inset, t, values, **style)
    inset.set_xlim(*window)
    inset.tick_params(labelsize=7, length=2)
    inset.set_title(f"{window[0]:g} to {window[1]:g} s, enlarged", fontsize=7.5, color=GREY, pad=3)
    if not highest > lowest:
        return
    inset.set_ylim(lowest, highest)
    axes.indicate_inset((window[0], lowest, window[1] - window[0], highest - lowest), edgecolor=INK)


def _whole_error(axes: Axes, runs: Sequence[Curve]) -> None:
    unit, name = length_unit(max(largest(run.result["e"]) for run in runs))
    shade(axes, runs[0].experiment)
    for run in runs:
        run.draw(axes, run.result["t"], run.result["e"] / unit)
    axes.axhline(0, color=GREY, linewidth=0.6, zorder=1)
    time_axis(axes, longest(runs))
    axes.set_title("whole run")
    axes.set_ylabel(rf"error $e = x - x_\mathrm{{ref}}$ ({name})")


def _error_decades(axes: Axes, runs: Sequence[Curve]) -> None:
    experiment = longest(runs)
    width = experiment.duration / INTERVALS
    shade(axes, runs[0].experiment)
    for run in runs:
        run.draw(axes, *peaks(run.result["t"], run.result["e"], width))
    axes.set_yscale("log")
    bottom, top = axes.get_ylim()
    axes.set_ylim(max(bottom, 1e-8), top)
    axes.yaxis.set_major_locator(LogLocator(base=10, numticks=12))
    axes.yaxis.set_minor_locator(NullLocator())
    time_axis(axes, experiment)
    axes.set_title(f"size of the error (largest in each {width:g} s)")
    axes.set_ylabel("$|e|$ (m)")


def _steady_error(axes: Axes, runs: Sequence[Curve]) -> None:
    experiment = runs[0].experiment
    start, end = experiment.steady_window
    rows = [within(run.result["t"], start, end) for run in runs]
    sizes = [largest(run.result["e"][part]) for run, part in zip(runs, rows, strict=True)]
    smallest = min((size for size in sizes if size > 0), default=0.0)
    unit, name = length_unit(max((size for size in sizes if size <= COMPARABLE * smallest), default=np.nan))
    left_out: list[str] = []
    for run, part, size in zip(runs, rows, sizes, strict=True):
        values = run.result["e"][part]
        if size <= COMPARABLE * smallest:
            run.draw(axes, run.result["t"][part], values / unit)
        else:
            scale, its_name = length_unit(size)
            shown = drawable(values) / scale
            span = f"{np.nanmin(shown):.3g} to {np.nanmax(shown):.3g}".replace("-", "−")
            left_out.append(f"{run.label}: {span} {its_name}, off this panel")
    axes.axhline(0, color=GREY, linewidth=0.6, zorder=1)
    axes.set_xlim(start, max(end, start + experiment.simulation.sample_time))
    if left_out:
        bottom, top = axes.get_ylim()
        axes.set_ylim(bottom, top + 0.16 * len(left_out) * (top - bottom))
        axes.text(0.02, 0.97, "\n".join(left_out), transform=axes.transAxes, va="top", fontsize=7.5)
    axes.set_facecolor("#FAFAFA")
    axes.set_title("steady-state window")
    axes.set_xlabel("time (s)")
    axes.set_ylabel(f"error $e$ ({name})")


KILO = 1e3

START_UP = 0.06
"""Seconds of a uniform reference's start that are shown enlarged: the speed step sets the ropes ringing."""

BRAKING = (-0.03, 0.12)
"""Seconds around the start of a profile's braking that are shown enlarged: its acceleration jumps there."""

SMALLEST_SPAN = 0.4
"""Smallest height in kN of an enlarged panel, so that fractions of a newton do not look like an event."""

OVERSHOOT = 1.02
"""A tension this many times its limit is worth a word."""


def commands(results: Runs, *, ax: GivenAxes = None) -> Figure:
    """Tension commands of the coordination, a panel a rope, with their limits (Figures 7, 11, 15, 19).

    Args:
        results: label → result, or results that are labelled by their position laws.
        ax: axes for rope 1 and rope 2, and for their enlarged stretches; default: a figure of its own.

    Raises:
        ConfigurationError: there is nothing to draw.
    """
    words = "force commands of the coordination"
    return _two_ropes(curves(results), "commands", words, "command", ax)


def tensions(results: Runs, *, ax: GivenAxes = None) -> Figure:
    """Rope tensions, a panel a rope, with the limits of the commands, the peak and the slack (Figures 8, 12, 16, 20).

    Args:
        results: label → result, or results that are labelled by their position laws.
        ax: axes for rope 1 and rope 2, and for their enlarged stretches; default: a figure of its own.

    Raises:
        ConfigurationError: there is nothing to draw.
    """
    return _two_ropes(curves(results), "tensions", "rope tensions", "tension", ax)


def enlarged(experiment: Experiment) -> tuple[float, float, float, str]:
    """The stretch of a run that deserves a zoom.

    Returns:
        Its start and end in s, the time in s its axis counts from, and what happens there.
    """
    if experiment.reference.kind == "uniform":
        return 0.0, START_UP, 0.0, "start-up"
    reference = experiment.reference
    joint = reference.cruise_until if reference.kind == "profile" else experiment.steady_window[1]
    return joint + BRAKING[0], joint + BRAKING[1], joint, "braking begins"


def draw_limits(axes: Axes, experiment: Experiment) -> None:
    """Draw the limits of the tension commands on an axis in kN."""
    limits = experiment.controller.limits
    for limit in (limits.tension_min, limits.tension_max):
        axes.axhline(limit / KILO, color=INK, linestyle=(0, (2, 2)), linewidth=0.8, zorder=1.5)


def limit_handle(experiment: Experiment) -> Line2D:
    """Legend entry of the limits."""
    limits = experiment.controller.limits
    words = f"limits {limits.tension_min / KILO:g} and {limits.tension_max / KILO:g} kN"
    return Line2D([], [], color=INK, linestyle=(0, (2, 2)), linewidth=0.8, label=words)


COLUMNS = {"command": ("F1_cmd", "F2_cmd"), "tension": ("F1", "F2")}
"""What is drawn → its columns, rope 1 and rope 2."""


def _two_ropes(runs: Sequence[Curve], content: str, words: str, quantity: str, ax: GivenAxes) -> Figure:
    experiment = runs[0].experiment
    zoomed = enlarged(experiment)[0] < experiment.duration
    draw = [partial(_whole_run, quantity=quantity, rope=rope) for rope in (1, 2)]
    if zoomed:
        draw += [partial(_enlarged_run, quantity=quantity, rope=rope) for rope in (1, 2)]
    with house_style():
        page = Page(ax, 5.2, *headings([run.experiment for run in runs], content, words))
        panels = page.panels(2, 1 + zoomed, sharex="col", width_ratios=(2.3, 1)[: 1 + zoomed])
        for axes, panel in zip(panels, draw, strict=False):
            panel(axes, runs)
        page.time_axes(panels[:2], longest(runs))
        _start, _end, origin, event = enlarged(experiment)
        for axes in panels[2:3]:
            axes.set_title(event + ", enlarged")
        for axes in panels[2:][-1:]:
            axes.set_xlabel(f"time after {origin:g} s (ms)" if origin else "time (ms)")
        page.legend([*(run.handle for run in runs), limit_handle(experiment), steady_handle()])
    return page.figure


def _whole_run(axes: Axes, runs: Sequence[Curve], quantity: str, rope: int) -> None:
    column = COLUMNS[quantity][rope - 1]
    shade(axes, runs[0].experiment)
    for run in runs:
        run.draw(axes, run.result["t"], run.result[column] / KILO)
    draw_limits(axes, runs[0].experiment)
    axes.set_ylabel(f"{quantity} $F_{rope}$ (kN)")
    axes.set_title(f"rope {rope}")
    if quantity == "tension":
        axes.set_title(_extremes(runs, column), loc="right", fontsize=7.5, color=GREY)


def _enlarged_run(axes: Axes, runs: Sequence[Curve], quantity: str, rope: int) -> None:
    """Commands as they are held from sample to sample, tensions as they ring between samples."""
    experiment = runs[0].experiment
    start, end, origin, _event = enlarged(experiment)
    for run in runs:
        rows = within(run.result["t"], start, end)
        if quantity == "tension":
            t, *forces = finely(run.result, rows)
            run.draw(axes, (t - origin) * 1e3, forces[rope - 1] / KILO)
        else:
            command = run.result[COLUMNS[quantity][rope - 1]][rows] / KILO
            run.draw(axes, (run.result["t"][rows] - origin) * 1e3, command, drawstyle="steps-post")
    axes.set_xlim((start - origin) * 1e3, (min(end, experiment.duration) - origin) * 1e3)
    bottom, top = axes.get_ylim()
    spare = max(SMALLEST_SPAN - (top - bottom), 0.0) / 2
    draw_limits(axes, experiment)
    axes.set_ylim(bottom - spare, top + spare)


def _extremes(runs: Sequence[Curve], column: str) -> str:
    """Say in words what a line of a few milliseconds cannot show at this width."""
    limit = runs[0].experiment.controller.limits.tension_max
    drawn = [run for run in runs if np.isfinite(run.result[column]).any()]
    if not drawn:
        return ""
    slack = [(run.label, _slack_time(run.result, column)) for run in drawn]
    if any(time for _, time in slack):
        return "slack: " + ", ".join(f"{label} {_moment(time)}" for label, time in slack if time)
    peaks = [float(np.nanmax(run.result[column])) for run in drawn]
    highest = max(peaks)
    if highest <= OVERSHOOT * limit:
        return ""
    first = drawn[peaks.index(highest)].result
    at = first["t"][np.nanargmax(first[column])]
    reached = [run.label for run, peak in zip(drawn, peaks, strict=True) if f"{peak:.3g}" == f"{highest:.3g}"]
    return f"peak {highest / KILO:.2f} kN at {_moment(at)} ({', '.join(reached)})"


def _slack_time(result: Result, column: str) -> float:
    spacing = result["t"][1] - result["t"][0] if len(result["t"]) > 1 else 0.0
    return float(np.count_nonzero(result[column] <= 0) * spacing)


def _moment(seconds: float) -> str:
    return f"{seconds * 1e3:.3g} ms" if seconds < 1 else f"{seconds:.3g} s"
