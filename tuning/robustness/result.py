"""The result of a stress test: at which size of each imperfection gains break, as data, words and figure."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from dualwinch.controllers.controller import Controller
from dualwinch.model.quantities.tables import markdown, page, table
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.plots.page import GivenAxes, new_page
from dualwinch.simulation.plots.style import BLUE, GREY, INK, VERMILION, plain
from dualwinch.tuning.robustness.imperfections import Imperfection, ImperfectionSize, ScaledEnsemble, amount_of
from dualwinch.tuning.robustness.limits import SHARE, BrokenLimit, RobustnessLimit, is_no_measure, multiple
from dualwinch.tuning.robustness.sizes import HIGHEST, LOWEST, STEPS, SizeRange, size

HOLDS = "holds"
"""Stands where gains break at no size that was tried."""


PAPER = "paper"
"""Name of the baseline controller: the paper's gains."""


@dataclass(frozen=True)
class Breakdown:
    """Where gains break under an imperfection.

    Attributes:
        size: the smallest size that was tried and is broken, 1 being the ensemble's; ``None``: none is.
        held: the largest size below that was tried and holds; 0: only without the imperfection.
        broken: what is broken there; the worst first.
        monotone: whether no larger size that was tried holds.
    """

    size: float | None
    held: float
    broken: tuple[BrokenLimit, ...]
    monotone: bool

    @property
    def order(self) -> float:
        """Number to sort by: the least robustness margin first."""
        return math.inf if self.size is None else self.size


@dataclass(frozen=True)
class ImperfectionResult:
    """One imperfection, or all together.

    Attributes:
        imperfection: what is scaled.
        reach: its smallest and largest size, and what is wrong with larger ones.
        breaks: name of the gains → where they break.
    """

    imperfection: Imperfection
    reach: SizeRange
    breaks: dict[str, Breakdown]

    @property
    def switched(self) -> bool:
        """Whether the imperfection is there or not, with nothing in between."""
        return self.reach.bottom == self.reach.top

    def by_what(self, name: str) -> str:
        """What gains of a name break by."""
        broken = self.breaks[name]
        if broken.size is None:
            return "end of its range" if self.reach.obstacle else ""
        return broken.broken[0].words + ("" if broken.monotone else "; holds at a larger one")


@dataclass(frozen=True, repr=False)
class RobustnessResult:
    """Which imperfections gains break at, and how large those are; shown at a prompt and in a notebook as a table.

    Attributes:
        scaling: base, ensemble, imperfections, number of scenarios and seed.
        controllers: name → controller, that with the paper's gains first.
        limits: name → what those gains are held to.
        lost: name → why gains fail already in the base (`limits.failures`); such gains are not made to bear more.
        rows: imperfections.
    """

    scaling: ScaledEnsemble
    controllers: dict[str, Controller]
    limits: dict[str, tuple[RobustnessLimit, ...]]
    lost: dict[str, tuple[BrokenLimit, ...]]
    rows: tuple[ImperfectionResult, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the gains that do not fail without any imperfection."""
        return tuple(name for name in self.controllers if not self.lost[name])

    @cached_property
    def ranking(self) -> tuple[ImperfectionResult, ...]:
        """The rows, what breaks the last of the gains first."""
        names = self.names[::-1]
        return tuple(sorted(self.rows, key=lambda row: [row.breaks[name].order for name in names]))

    def amount(self, row: ImperfectionResult, size: float) -> ImperfectionSize | None:
        """How large a row's imperfection of some size is, in its own unit; ``None`` for all together."""
        return amount_of(self.scaling, row.imperfection, size)

    def where(self, row: ImperfectionResult, name: str) -> str:
        """At which size gains of a name break, as a multiple of the ensemble's and in its own unit."""
        broken = row.breaks[name]
        if broken.size is None:
            far = HOLDS if row.switched else f"{HOLDS} to {multiple(broken.held)}"
            return far if broken.held else "–"
        amount = self.amount(row, broken.size)
        if row.switched:
            return str(amount)
        below = "≤ " if broken.size <= size(LOWEST) else ""
        return f"{below}{multiple(broken.size)}" + (f" ({amount})" if amount else "")

    @property
    def heading(self) -> str:
        """What was done, in one line."""
        scaling = self.scaling
        return (
            f"imperfections of '{scaling.ensemble.name}' on top of '{scaling.base.name}', "
            f"{scaling.count} scenario{'s' * (scaling.count != 1)}, seed {scaling.seed}"
        )

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Headings and rows: each imperfection, how large it is in the ensemble, at which size gains break, by what."""
        headings = ["imperfection", f"in {self.scaling.ensemble.name}"]
        headings += [words for name in self.names for words in (f"{name} breaks at", "by")]
        rows = [
            [row.imperfection.label, str(self.amount(row, 1.0) or "")]
            + [words for name in self.names for words in (self.where(row, name), row.by_what(name))]
            for row in self.ranking
        ]
        return headings, rows

    def notes(self) -> list[str]:
        """What a reader has to know of the table: the limits, gains that break them in the base, and ends of ranges."""
        asked = self.limits[next(iter(self.names), PAPER)]
        words = ["Must hold: " + "; ".join(["every run completed", *(limit.words for limit in asked)])]
        if is_no_measure(self.lost[PAPER]):
            words = [words[0].replace("*paper)", "*its own)")]
        for name, limits in self.limits.items():
            if self.lost[name]:
                why = ", ".join(broken.words for broken in self.lost[name])
                own = (
                    "; others are held to multiples of what they reach in the base themselves"
                    if name == PAPER
                    and is_no_measure(self.lost[name])
                    and len(self.limits) > 1
                    and any(limit.of_paper for limit in self.limits[name])
                    else ""
                )
                words.append(f"{name}: fails already in the base, {why}{own}")
                continue
            eased = "; ".join(limit.constraint.label for limit in limits if limit.eased)
            if eased:
                words.append(f"{name}: violates some of these even in the base; judged by {eased}")
        words += [
            f"{row.imperfection.label} ends at {multiple(size(row.reach.top))}: {row.reach.obstacle}"
            if row.reach.steps
            else f"{row.imperfection.label} cannot be scaled: {row.reach.obstacle}"
            for row in self.ranking
            if row.reach.obstacle
        ]
        return words

    def __repr__(self) -> str:
        return "\n".join([f"Stress: {self.heading}", "", markdown(*self.table()), "", *self.notes()])

    def _repr_html_(self) -> str:
        """As a notebook shows it."""
        return page("RobustnessResult", ". ".join([self.heading, *self.notes()]), table(*self.table()))

    def plot(self, *, ax: GivenAxes = None) -> Figure:
        """Draw the sizes at which gains break, a row an imperfection.

        Args:
            ax: axes to draw into; default: a figure of its own.
        """
        return _figure(self, ax)

    def to_dict(self) -> dict[str, Any]:
        """Everything that was found, JSON-ready; `docs/stress.md` says what the names mean."""
        scaling = self.scaling
        return {
            "ensemble": scaling.ensemble.name,
            "base": scaling.base.name,
            "scenarios": scaling.count,
            "seed": scaling.seed,
            "sizes": {"lowest": size(LOWEST), "highest": size(HIGHEST), "factor": size(1), "steps_a_decade": STEPS},
            "gains": [
                {
                    "name": name,
                    "lost_in_base": _broken(self.lost[name]),
                    "limits": [limit.to_dict() for limit in self.limits[name]],
                    "controller": {key: value for key, value in leaves(controller).items() if value is not None},
                }
                for name, controller in self.controllers.items()
            ],
            "imperfections": [
                {
                    "name": row.imperfection.name,
                    "label": row.imperfection.label,
                    "keys": list(row.imperfection.keys),
                    "in_ensemble": _amount(self.amount(row, 1.0)),
                    "largest_size": size(row.reach.top) if row.reach.steps else None,
                    "ends_by": row.reach.obstacle or None,
                    "breaks": {
                        name: {
                            "size": broken.size,
                            "held_at": broken.held,
                            "amount": None if broken.size is None else _amount(self.amount(row, broken.size)),
                            "broken": _broken(broken.broken),
                            "monotone": broken.monotone,
                        }
                        for name, broken in row.breaks.items()
                    },
                }
                for row in self.ranking
            ],
        }


def _amount(amount: ImperfectionSize | None) -> dict[str, Any] | None:
    return None if amount is None else {**asdict(amount), "unit": _unit(amount.unit), "text": str(amount)}


def _broken(limits: Sequence[BrokenLimit]) -> list[dict[str, Any]]:
    return [{**asdict(broken), "unit": _unit(broken.unit), "text": broken.words} for broken in limits]


def _unit(unit: str) -> str:
    return "1" if unit == SHARE else unit


GAINS_COLOURS = (VERMILION, BLUE)
"""Of the paper's gains, and of those beside them."""

LABEL_ROOM = 15.0
"""Factor by which the axis goes on behind the largest size, for words."""

APART = 0.2
"""Half the distance of two gains in a row."""

HEADING, A_ROW = 1.35, 0.34
"""Heights in inches."""


def _figure(found: RobustnessResult, ax: GivenAxes) -> Figure:
    looks = dict(
        zip(found.controllers, GAINS_COLOURS if len(found.controllers) > 1 else GAINS_COLOURS[1:], strict=False)
    )
    scaling = found.scaling
    title = "Robustness margins"
    words = (
        f"Imperfections of “{plain(scaling.ensemble.name)}” on top of “{plain(scaling.base.name)}”, "
        f"{scaling.count} scenarios, seed {scaling.seed}; the worst scenario counts"
    )
    with new_page(ax, HEADING + A_ROW * max(len(found.rows), 3), title, words) as page:
        (axes,) = page.panels()
        for height, row in enumerate(found.ranking):
            for index, name in enumerate(found.names):
                offset = APART * (2 * index / (len(found.names) - 1) - 1) if len(found.names) > 1 else 0.0
                _draw(axes, found, row, row.breaks[name], height + offset, looks[name])
        _scales(axes, found)
        handles = [
            Line2D([], [], color=colour, marker="o", markersize=5, linestyle="none", label=_legend(found, name))
            for name, colour in looks.items()
        ]
        page.legend(*handles, Line2D([], [], color=GREY, marker=">", markersize=5, label="holds", linestyle="none"))
    return page.figure


def _draw(
    axes: Axes, found: RobustnessResult, row: ImperfectionResult, broken: Breakdown, height: float, colour: str
) -> None:
    """The sizes up to which gains hold, and the one at which they break with what broke, or an arrow."""
    lowest = size(LOWEST)
    end = broken.held if broken.size is None else broken.size
    axes.plot((lowest / 1.3, max(end, lowest)), (height, height), color=colour, linewidth=1.6, alpha=0.45)
    if broken.size is None:
        if broken.held:
            axes.plot(end, height, ">", color=colour, markersize=5)
        return
    axes.plot(end, height, "o", color=colour, markersize=5, zorder=3)
    amount = found.amount(row, broken.size)
    words = ", ".join(filter(None, (str(amount) if amount and not row.switched else "", broken.broken[0].label)))
    axes.annotate(
        words,
        (end, height),
        xytext=(6, 0),
        textcoords="offset points",
        va="center_baseline",
        fontsize=7,
        color=colour,
        annotation_clip=False,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.85},
    )


def _scales(axes: Axes, found: RobustnessResult) -> None:
    name = plain(found.scaling.ensemble.name)
    axes.set_xscale("log")
    axes.set_xlim(size(LOWEST) / 1.3, size(HIGHEST) * LABEL_ROOM)
    axes.xaxis.set_major_locator(FixedLocator([size(step) for step in range(LOWEST, HIGHEST + 1, STEPS)]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel(f"size of the imperfection over its size in “{name}”")
    axes.axvline(1, color=INK, linewidth=0.9, zorder=1)
    labels = []
    for row in found.ranking:
        amount = found.amount(row, 1.0)
        labels.append(f"{row.imperfection.label}  {amount}" if amount else row.imperfection.label)
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)


def _legend(found: RobustnessResult, name: str) -> str:
    """Name of gains, and whether they hold without any imperfection."""
    words = "the paper's gains" if name == PAPER else plain(name)
    return f"{words}: break without any" if found.lost[name] else f"{words} break"
