"""Figures of several runs: the paper's Figures 5 to 20 over time, and Figure 21 of steady-state errors.

They draw one result, several, which are labelled by their position laws, or results by label.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, NullLocator

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metrics import metric_quantities
from dualwinch.simulation.paper import (
    COMPARED_CASE,
    CONTENTS,
    FIGURES,
    REDUCTIONS,
    WITH_OBSERVER,
    WITHOUT_OBSERVER,
    percent,
    steady_change,
)
from dualwinch.simulation.plots.page import GivenAxes, case_number, new_page, scenario, steady_patch
from dualwinch.simulation.plots.style import (
    DASHES,
    GREY,
    INK,
    PALETTE,
    Look,
    aside,
    draw_limits,
    law_label,
    law_look,
    prefixed_unit,
    tension_unit,
    zero_line,
)
from dualwinch.simulation.plots.traces import Floats, drawable, largest, peaks, within
from dualwinch.simulation.results.between_samples import between_samples
from dualwinch.simulation.results.result import REFERENCE, Curve, Result, curve_of

Runs: TypeAlias = Mapping[Any, Result] | Iterable[Result] | Result
"""Label → run, runs labelled by their position laws, or one run."""


def curves(runs: Runs) -> list[Curve]:
    """The curves of all runs, in the given order.

    A run has the colour and line style of its position law unless an earlier run has them. A label that is the `kind`
    of the run's law is replaced by the law's name in figures.

    Raises:
        ConfigurationError: there are no runs, or one kept no rows.
    """
    labelled = _labelled(runs)
    if not labelled:
        raise ConfigurationError("a figure needs at least one result")
    for label, result in labelled:
        if not isinstance(result, Result):
            raise ConfigurationError(f"{label}: a figure draws results of simulate, not {type(result).__name__}")
    looks = _looks([law_look(result.experiment) for _, result in labelled])
    curves_of_runs: list[Curve] = []
    for (label, result), look in zip(labelled, looks, strict=True):
        is_kind = label == result.experiment.controller.law.kind
        curves_of_runs.append(curve_of(result, look, law_label(result.experiment) if is_kind else label))
    return curves_of_runs


def _labelled(runs: Runs) -> list[tuple[str, Result]]:
    if isinstance(runs, Result):
        return [(law_label(runs.experiment), runs)]
    if isinstance(runs, Mapping):
        return [(str(label), result) for label, result in runs.items()]
    label_list = list(runs)
    names = [law_label(result.experiment) if isinstance(result, Result) else "results" for result in label_list]
    count, repeats = Counter(names), Counter[str]()
    labels: list[str] = []
    for name in names:
        repeats[name] += 1
        labels.append(f"{name} ({repeats[name]})" if count[name] > 1 else name)
    return list(zip(labels, label_list, strict=True))


def _looks(own: Sequence[Look]) -> list[Look]:
    """Colour and line style of every run: its law's, or where an earlier run has these, the next that no law has."""
    turns = [DASHES[turn:] + DASHES[:turn] for turn in (*range(1, len(DASHES)), 0)]
    places = range(len(PALETTE))
    every: list[Look] = [(PALETTE[k], dashes[k % len(dashes)]) for dashes in turns for k in places]
    colours = {colour for colour, _ in own}
    spare = sorted((look for look in every if look not in own), key=lambda look: look[0] in colours)
    following, looks = cycle(spare or every), list[Look]()
    for look in own:
        looks.append(next(following) if look in looks else look)
    return looks


COMPARABLE = 10.0
"""Errors up to this multiple of the smallest one share a panel; larger ones are stated in words."""

ZOOM = 0.4
"""Length in s of the enlarged part of a trajectory."""

INTERVALS = 200
"""Number of intervals of a run, each drawn with its largest |e| in the logarithmic panel."""


def longest(runs: Iterable[Curve]) -> Experiment:
    """The experiment with the longest duration, for the time axis."""
    return max((run.experiment for run in runs), key=lambda experiment: experiment.duration)


def _headings(runs: Sequence[Curve], content: str) -> tuple[str, str]:
    """Title and subtitle of a figure of one of the `paper.CONTENTS`; with its number if all runs are of one case."""
    words, numbers = CONTENTS[content], {case_number(run.experiment) for run in runs}
    title = words[0].upper() + words[1:]
    for figure in FIGURES:
        if {figure.case} == numbers and figure.content == content:
            title = f"Figure {figure.number} · Case {figure.case}: {words}"
    return title, "; ".join(dict.fromkeys(scenario(run.experiment) for run in runs)).capitalize()


def trajectory(results: Runs, *, ax: GivenAxes = None) -> Figure:
    """Position and speed against the reference, with an enlarged part of the position (Figures 5, 9, 13, 17).

    Panels: position, speed.
    """
    runs = curves(results)
    references = list({(run.experiment.reference, run.experiment.duration): run for run in reversed(runs)}.values())
    lines = [(run, "", {}) for run in runs] + [(run, "_ref", REFERENCE) for run in reversed(references)]
    with new_page(ax, 5.2, *_headings(runs, "trajectory")) as page:
        position, speed = panels = page.panels(2, sharex=True, height_ratios=(1.6, 1))
        for run, kind, style in lines:
            run.draw(position, f"x{kind}", **style)
            run.draw(speed, f"v{kind}", **style)
        position.set_ylabel("position $x$ (m)")
        speed.set_ylabel("speed $v$ (m/s)")
        end = min(runs[0].experiment.steady_window[1], runs[0].experiment.duration)
        _zoom(position, lines, (max(end - ZOOM, 0.0), end))
        page.time_axes(panels, longest(runs))
        page.legend(steady_patch())
    return page.figure


def _zoom(axes: Axes, lines: Iterable[tuple[Curve, str, dict[str, Any]]], window: tuple[float, float]) -> None:
    """Enlarge a part of the position where the steady lags are visible."""
    inset = axes.inset_axes((0.69, 0.13, 0.29, 0.42))
    for run, kind, style in lines:
        run.draw(inset, f"x{kind}", rows=within(run.result["t"], *window), **{"linewidth": 1.0} | style)
    inset.set_xlim(*window)
    inset.tick_params(labelsize=7, length=2)
    inset.set_title(f"{window[0]:g} to {window[1]:g} s, enlarged", fontsize=7.5, color=GREY, pad=3)
    ordinates = np.concatenate([np.asarray(line.get_ydata(), float) for line in inset.lines])
    lowest, highest = np.fmin.reduce(ordinates, initial=np.inf), np.fmax.reduce(ordinates, initial=-np.inf)
    if highest > lowest:
        inset.set_ylim(lowest, highest)
        axes.indicate_inset((window[0], lowest, window[1] - window[0], highest - lowest), edgecolor=INK)


def error(results: Runs, *, ax: GivenAxes = None) -> Figure:
    """Tracking error (Figures 6, 10, 14, 18).

    Panels: whole run, largest magnitude on a logarithmic axis, steady state.
    """
    runs = curves(results)
    experiment = longest(runs)
    with new_page(ax, 5.4, *_headings(runs, "error")) as page:
        overview, decades, steady = page.mosaic([["whole", "whole"], ["decades", "steady"]], height_ratios=(1.05, 1))
        unit, name = prefixed_unit("m", *(largest(run.result["e"]) for run in runs))
        for run in runs:
            run.draw(overview, "e", unit)
            run.line(decades, *peaks(run.result["t"], run.result["e"], experiment.duration / INTERVALS))
        zero_line(overview)
        overview.set(title="whole run", ylabel=rf"error $e = x - x_\mathrm{{ref}}$ ({name})")
        decades.set_yscale("log")
        bottom, top = decades.get_ylim()
        decades.set_ylim(max(bottom, 1e-8), top)
        decades.yaxis.set_major_locator(LogLocator(base=10, numticks=12))
        decades.yaxis.set_minor_locator(NullLocator())
        decades.set(title=f"size of the error (largest in each {experiment.duration / INTERVALS:g} s)")
        decades.set_ylabel("$|e|$ (m)")
        _steady_error(steady, runs)
        page.time_axes([overview], experiment)
        page.time_axes([decades], experiment)
        page.legend(steady_patch())
    return page.figure


def _steady_error(axes: Axes, runs: Sequence[Curve]) -> None:
    experiment = runs[0].experiment
    start, end = experiment.steady_window
    windows = [within(run.result["t"], start, end) for run in runs]
    sizes = [largest(run.result["e"][rows]) for run, rows in zip(runs, windows, strict=True)]
    smallest = min((size for size in sizes if size > 0), default=0.0)
    unit, name = prefixed_unit("m", *(size for size in sizes if size <= COMPARABLE * smallest))
    left_out: list[str] = []
    for run, rows, size in zip(runs, windows, sizes, strict=True):
        if size <= COMPARABLE * smallest:
            run.draw(axes, "e", unit, rows)
        else:
            scale, its_name = prefixed_unit("m", size)
            errors = drawable(run.result["e"][rows]) / scale
            span = f"{np.nanmin(errors):.3g} to {np.nanmax(errors):.3g}".replace("-", "−")
            left_out.append(f"{run.label}: {span} {its_name}, off this panel")
    zero_line(axes)
    axes.set_xlim(start, max(end, start + experiment.simulation.sample_time))
    if left_out:
        bottom, top = axes.get_ylim()
        axes.set_ylim(bottom, top + 0.16 * len(left_out) * (top - bottom))
        axes.text(0.02, 0.97, "\n".join(left_out), transform=axes.transAxes, va="top", fontsize=7.5)
    axes.set_facecolor("#FAFAFA")
    axes.set(title="steady-state window", xlabel="time (s)", ylabel=f"error $e$ ({name})")


EVENT = 0.12
"""Enlarged time in s after a profile's acceleration jumps; a quarter before, and half after a step of the speed."""

SMALLEST_SPAN = 1 / 15
"""Smallest height of an enlarged panel over the largest tension command, so that no trifle looks significant."""


def commands(results: Runs, *, ax: GivenAxes = None) -> Figure:
    """Tension commands of the coordination with their limits (Figures 7, 11, 15, 19).

    Panels: rope 1 and rope 2, then their enlarged parts.
    """
    return _two_ropes(curves(results), "commands", ax)


def tensions(results: Runs, *, ax: GivenAxes = None) -> Figure:
    """Rope tensions with command limits, peak and slack (Figures 8, 12, 16, 20).

    Panels: rope 1 and rope 2, then their enlarged parts.
    """
    return _two_ropes(curves(results), "tensions", ax)


def enlarged(experiment: Experiment) -> tuple[float, float, float, str]:
    """The part of a run to enlarge.

    Returns:
        Its start and end in s, the origin of its time axis in s, and the event in it.
    """
    if experiment.reference.kind == "uniform":
        return 0.0, EVENT / 2, 0.0, "start-up"
    reference = experiment.reference
    joint = reference.cruise_until if reference.kind == "profile" else experiment.steady_window[1]
    return joint - EVENT / 4, joint + EVENT, joint, "braking begins"


def _two_ropes(runs: Sequence[Curve], content: str, ax: GivenAxes) -> Figure:
    """Tensions or their commands, over the whole run and enlarged."""
    experiment, kind = runs[0].experiment, "_cmd" if content == "commands" else ""
    start, _, origin, event = enlarged(experiment)
    zoomed = start < experiment.duration
    columns = [f"F{rope}{kind}" for rope in (1, 2)]
    unit = tension_unit(experiment, *(largest(run.result[name]) for run in runs for name in columns))
    with new_page(ax, 5.2, *_headings(runs, content)) as page:
        panels = page.panels(2, 1 + zoomed, sharex="col", width_ratios=(2.3, 1)[: 1 + zoomed])
        for rope, axes in enumerate(panels[:2], start=1):
            for run in runs:
                run.draw(axes, f"F{rope}{kind}", unit[0])
            draw_limits(axes, experiment, unit)
            axes.set(ylabel=f"{content[:-1]} $F_{rope}$ ({unit[1]})", title=f"rope {rope}")
            if not kind:
                aside(axes, _extremes(runs, f"F{rope}", unit))
        for rope, axes in enumerate(panels[2:], start=1):
            _enlarged_run(axes, runs, f"F{rope}{kind}", unit)
        page.time_axes(panels[:2], longest(runs))
        if zoomed:
            panels[2].set_title(event + ", enlarged")
            page.name_x(panels[2:], f"time after {origin:g} s (ms)" if origin else "time (ms)")
        page.legend(steady_patch())
    return page.figure


def _enlarged_run(axes: Axes, runs: Sequence[Curve], column: str, unit: tuple[float, str]) -> None:
    """Draw commands held from sample to sample, and tensions with their ringing between samples."""
    experiment = runs[0].experiment
    start, end, origin, _event = enlarged(experiment)
    for run in runs:
        rows = within(run.result["t"], start, end)
        t, values, style = run.result["t"][rows], run.result[column][rows], {"drawstyle": "steps-post"}
        if column in {"F1", "F2"}:
            t, forces = between_samples(run.result, rows)
            values, style = forces[column], {}
        run.line(axes, (t - origin) * 1e3, values / unit[0], **style)
    axes.set_xlim((start - origin) * 1e3, (min(end, experiment.duration) - origin) * 1e3)
    bottom, top = axes.get_ylim()
    span = SMALLEST_SPAN * experiment.controller.limits.tension_max / unit[0]
    spare = max(span - (top - bottom), 0.0) / 2
    draw_limits(axes, experiment, unit)
    axes.set_ylim(bottom - spare, top + spare)


def _extremes(runs: Sequence[Curve], column: str, unit: tuple[float, str]) -> str:
    """Peaks or slack in words, as events of a few milliseconds are invisible at this width."""
    finite_runs = [run for run in runs if np.isfinite(run.result[column]).any()]
    slack = {run.label: _slack_time(run.result["t"], run.result[column]) for run in finite_runs}
    if any(slack.values()):
        return "slack: " + ", ".join(f"{label} {_moment(time)}" for label, time in slack.items() if time)
    peaks = [float(np.nanmax(run.result[column])) for run in finite_runs]
    highest = max(peaks, default=0.0)
    if highest <= runs[0].experiment.controller.limits.tension_max:
        return ""
    highest_run = finite_runs[peaks.index(highest)].result
    at = highest_run["t"][np.nanargmax(highest_run[column])]
    reached = [run.label for run, peak in zip(finite_runs, peaks, strict=True) if f"{peak:.3g}" == f"{highest:.3g}"]
    return f"peak {highest / unit[0]:.2f} {unit[1]} at {_moment(at)} ({', '.join(reached)})"


def _slack_time(t: Floats, tension: Floats) -> float:
    return float(np.count_nonzero(tension <= 0) * (t[1] - t[0])) if len(t) > 1 else 0.0


def _moment(seconds: float) -> str:
    return f"{seconds * 1e3:.3g} ms" if seconds < 1 else f"{seconds:.3g} s"


PAPER_COLOUR = "#BDBDBD"

BAR_ROOM = 0.2
"""Smallest change whose number fits inside its bar."""


def steady_state_bars(results: Runs, *, ax: GivenAxes = None) -> Figure:
    """Steady-state errors with and without the observer, and their change compared with the paper's (Figure 21).

    The runs are of one case (in the paper Case 4); the first of `fando-nftsm` and the first of `nftsm` are compared.
    Panels: the three errors, and their changes.

    Raises:
        ConfigurationError: one of the two is missing.
    """
    by_law = {run.experiment.controller.law.kind: run for run in reversed(curves(results))}
    change = steady_change({kind: run.result.metrics for kind, run in by_law.items()})
    if change is None:
        raise ConfigurationError(f"Figure 21 compares {WITH_OBSERVER} with {WITHOUT_OBSERVER}: both are needed")
    pair = [by_law[kind] for kind in (WITHOUT_OBSERVER, WITH_OBSERVER)]
    experiment = pair[1].experiment
    start, end = experiment.steady_window
    number = case_number(experiment)
    title = "effect of the observer in the steady state"
    title = f"Figure 21 · Case {number}: {title}" if number == COMPARED_CASE else title[0].upper() + title[1:]
    subtitle = f"{scenario(experiment).capitalize()}; steady state from {start:g} to {end:g} s"
    with new_page(ax, 5.0, title, subtitle, gap=0.07) as page:
        *errors, changes = page.mosaic([[*REDUCTIONS], ["change"] * len(REDUCTIONS)], height_ratios=(1.25, 1))
        for axes, metric in zip(errors, REDUCTIONS, strict=True):
            _steady_errors(axes, pair, metric)
        _observer_changes(changes, change, pair[1].colour)
        handles = [Patch(facecolor=run.colour, label=run.title) for run in pair]
        page.legend(*handles, Patch(facecolor=PAPER_COLOUR, label="the paper's reduction"))
    return page.figure


def _steady_errors(axes: Axes, pair: Sequence[Curve], metric: str) -> None:
    quantity, values = metric_quantities()[metric], [run.result.metrics[f"steady_{metric}"] for run in pair]
    power = 2 if quantity.unit == "m^2" else 1
    unit, name = prefixed_unit("m", max(values) ** (1 / power))
    heights = [value / unit**power for value in values]
    bars = axes.bar(range(len(pair)), heights, width=0.62, color=[run.colour for run in pair])
    axes.bar_label(bars, [f"{height:#.3g}".removesuffix(".") for height in heights], padding=2, fontsize=8.5)
    axes.margins(y=0.14)
    axes.grid(visible=False)
    axes.set(xticks=[], xlim=(-0.6, len(pair) - 0.4), title=f"{quantity.label} ({name}{'²' if power == 2 else ''})")
    axes.tick_params(left=False, labelleft=False)
    axes.spines["left"].set_visible(False)


def _observer_changes(axes: Axes, change: Mapping[str, float], colour: str) -> None:
    for row, (metric, paper) in enumerate(REDUCTIONS.items()):
        for offset, value, its_colour in ((-0.19, change[metric], colour), (0.19, paper, PAPER_COLOUR)):
            measured = offset < 0
            axes.barh(row + offset, 100 * value, height=0.34, color=its_colour)
            room = value < -BAR_ROOM
            axes.annotate(
                percent(value) if measured else percent(value, "+g"),
                (100 * value if room else min(100 * value, 0.0), row + offset),
                xytext=(6 if room else -4, -0.5),
                textcoords="offset points",
                ha="left" if room else "right",
                va="center",
                fontweight="bold" if measured else "normal",
                color="white" if measured and room else INK,
            )
    axes.axvline(0, color=GREY, linewidth=0.8)
    axes.set_yticks(range(len(REDUCTIONS)), [metric_quantities()[metric].label for metric in REDUCTIONS])
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    axes.set_xlim(-100, max(0.0, axes.get_xlim()[1]) if max(change.values()) > 0 else 0)
    axes.set_xticks(range(-100, 1, 25), [percent(tick / 100, "g") for tick in range(-100, 1, 25)])
    axes.set_title("change by the observer: measured, and in the paper")
