"""The figure of `benchmarks.growth`."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from benchmarks.growth_point import Point
from dualwinch.codegen.drivers.batch import LANES
from dualwinch.simulation.plots.page import new_page
from dualwinch.simulation.plots.style import BLUE, GREY, VERMILION

MILLI = 1e3


def growth_figure(found: Sequence[Point]) -> Figure:
    """Time of a run over its length, of a rollout over their number in a call, and rollouts a second over threads."""
    series: dict[str, list[Point]] = {}
    for point in found:
        series.setdefault(point.series, []).append(point)
    words = "Case 4, FANDO-NFTSM at 1 kHz, adaptive integrator"
    with new_page(None, 3.0, "How time grows", words) as page:
        horizon, candidates, threads = page.panels(1, 3)
        _line(horizon, series["horizon"], BLUE, "dualwinch", MILLI)
        _line(horizon, series.get("hand C, horizon", []), VERMILION, "hand-written C", MILLI)
        horizon.set_title("one rollout")
        horizon.set_xlabel("simulated time (s)")
        horizon.set_ylabel("time of the C call (ms)")
        horizon.legend()
        shares = [(point.value, MILLI * point.middle / point.rollouts) for point in series["candidates"]]
        candidates.plot(*zip(*shares, strict=True), "o-", color=BLUE, markersize=3)
        candidates.axvline(LANES, color=GREY, linewidth=0.8, linestyle=":")
        candidates.text(
            1.1 * LANES, 0.96, f"{LANES} lanes", transform=candidates.get_xaxis_transform(), color=GREY, va="top"
        )
        candidates.set_title("many in a call, one thread")
        candidates.set_xlabel("rollouts in the call")
        candidates.set_ylabel("a rollout's share (ms)")
        for axes in (horizon, candidates):
            _logarithmic(axes)
        candidates.xaxis.set_major_locator(LogLocator(base=4))
        rates = [(point.value, point.rollouts / point.middle) for point in series["threads"]]
        threads.plot(*zip(*rates, strict=True), "o-", color=BLUE, markersize=3)
        count, single = len(rates), rates[0][1]
        threads.plot((0, count), (0, count * single), color=GREY, linewidth=0.8, linestyle=":")
        threads.set_xlim(0, count + 0.3)
        threads.set_ylim(0, None)
        threads.set_xticks(range(count + 1))
        threads.set_title("dotted: in proportion")
        threads.set_xlabel("threads")
        threads.set_ylabel("rollouts a second")
    return page.figure


def _line(axes: Axes, points: Sequence[Point], colour: str, label: str, factor: float) -> None:
    values = [(point.value, factor * point.middle) for point in points]
    if values:
        axes.plot(*zip(*values, strict=True), "o-", color=colour, markersize=3, label=label)


def _logarithmic(axes: Axes) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
