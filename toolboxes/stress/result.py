"""The result of a stress test: the robustness margin of gains for each imperfection, as data, text and figure."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from dualwinch.toolbox import Controller, drawing, leaves, tables, tuning_constraints
from dualwinch.toolboxes.stress.imperfections import Imperfection, ImperfectionSize, ScaledEnsemble, amount_of
from dualwinch.toolboxes.stress.limits import SHARE, StressLimit, ViolatedLimit, is_no_measure, multiple
from dualwinch.toolboxes.stress.sizes import HIGHEST, LOWEST, STEPS, SizeRange, size

HOLDS = "holds"
"""Text in place of a size if gains break at none."""


PAPER = "paper"
"""Name of the baseline controller: the paper's gains."""


@dataclass(frozen=True)
class RobustnessMargin:
    """Robustness margin of gains for an imperfection.

    Attributes:
        size: the smallest tried size at which they break, 1 being the ensemble's; ``None``: at none.
        held: the largest tried size below it, at which they hold; 0: only without the imperfection.
        violated: limits violated at `size`; the worst first.
        monotone: whether they hold at no larger tried size.
    """

    size: float | None
    held: float
    violated: tuple[ViolatedLimit, ...]
    monotone: bool

    @property
    def order(self) -> float:
        """Sorting key: the least robustness margin first."""
        return math.inf if self.size is None else self.size


@dataclass(frozen=True)
class ImperfectionResult:
    """Result for one imperfection, or for all together.

    Attributes:
        imperfection: that is scaled.
        reach: its range of sizes.
        margins: name of the gains → their robustness margin.
    """

    imperfection: Imperfection
    reach: SizeRange
    margins: dict[str, RobustnessMargin]

    @property
    def switched(self) -> bool:
        """Whether the imperfection is a switch or a part, without intermediate sizes."""
        return self.reach.bottom == self.reach.top

    def cause(self, name: str) -> str:
        """The limit that gains of a name violate at their robustness margin, in words."""
        margin = self.margins[name]
        if margin.size is None:
            return "end of its range" if self.reach.obstacle else ""
        return margin.violated[0].words + ("" if margin.monotone else "; holds at a larger size")


@dataclass(frozen=True, repr=False)
class StressResult:
    """Robustness margins of one or more controllers; shown at a prompt and in a notebook as a table.

    Attributes:
        scaling: base, ensemble, imperfections, number of scenarios and seed.
        controllers: name → controller, the one with the paper's gains first.
        limits: name → constraints for that controller; the same for all that do not fail in the base, unless these are
            judged by multiples of their own values.
        lost: name → limits violated already in the base (`limits.failures`); such controllers are not tested further.
        rows: one per imperfection.
        left_out: factors on the paper's values below the gains' own, where the paper's gains are no measure.
    """

    scaling: ScaledEnsemble
    controllers: dict[str, Controller]
    limits: dict[str, tuple[StressLimit, ...]]
    lost: dict[str, tuple[ViolatedLimit, ...]]
    rows: tuple[ImperfectionResult, ...]
    left_out: tuple[tuning_constraints.Constraint, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the controllers that do not fail in the base."""
        return tuple(name for name in self.controllers if not self.lost[name])

    @cached_property
    def ranking(self) -> tuple[ImperfectionResult, ...]:
        """The rows in ascending order of the last controller's robustness margin."""
        names = self.names[::-1]
        return tuple(sorted(self.rows, key=lambda row: [row.margins[name].order for name in names]))

    def amount(self, row: ImperfectionResult, size: float) -> ImperfectionSize | None:
        """Physical size of a row's imperfection; ``None`` for all together."""
        return amount_of(self.scaling, row.imperfection, size)

    def where(self, row: ImperfectionResult, name: str) -> str:
        """Robustness margin of gains of a name, as a multiple of the ensemble's size and in physical units."""
        margin = row.margins[name]
        if margin.size is None:
            text = HOLDS if row.switched else f"{HOLDS} to {multiple(margin.held)}"
            return text if margin.held else "–"
        amount = self.amount(row, margin.size)
        if row.switched:
            return str(amount)
        below = "≤ " if margin.size <= size(LOWEST) else ""
        return f"{below}{multiple(margin.size)}" + (f" ({amount})" if amount else "")

    @property
    def heading(self) -> str:
        """The terms in one line."""
        scaling = self.scaling
        return (
            f"imperfections of '{scaling.ensemble.name}' on top of '{scaling.base.name}', "
            f"{scaling.count} scenario{'s' * (scaling.count != 1)}, seed {scaling.seed}"
        )

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Headings and rows: imperfection, size in the ensemble, and each controller's margin and what limits it."""
        headings = ["imperfection", f"in {self.scaling.ensemble.name}"]
        headings += [words for name in self.names for words in (f"{name} breaks at", "by")]
        rows = [
            [row.imperfection.label, str(self.amount(row, 1.0) or "")]
            + [words for name in self.names for words in (self.where(row, name), row.cause(name))]
            for row in self.ranking
        ]
        return headings, rows

    def notes(self) -> list[str]:
        """Explanations of the table: limits, controllers that violate them in the base, and ends of ranges."""
        limits = self.limits[next(iter(self.names), PAPER)]
        words = ["Must hold: " + "; ".join(["every run completed", *(limit.words for limit in limits)])]
        if is_no_measure(self.lost[PAPER]):
            words = [words[0].replace("*paper)", "*its own)")]
        for name in self.limits:
            if self.lost[name]:
                why = ", ".join(limit.words for limit in self.lost[name])
                judgement = (
                    "; others are judged by multiples of their own values in the base"
                    if name == PAPER
                    and is_no_measure(self.lost[name])
                    and len(self.limits) > 1
                    and any(limit.of_paper for limit in self.limits[name])
                    else ""
                )
                words.append(f"{name}: fails already in the base, {why}{judgement}")
        words += [
            f"{constraint.text} is left out: the paper's gains are no measure here, and no gains can be better than "
            "themselves"
            for constraint in self.left_out
        ]
        words += self._easings()
        words += [
            f"{row.imperfection.label} ends at {multiple(size(row.reach.top))}: {row.reach.obstacle}"
            if row.reach.steps
            else f"{row.imperfection.label} cannot be scaled: {row.reach.obstacle}"
            for row in self.ranking
            if row.reach.obstacle
        ]
        return words

    def _easings(self) -> list[str]:
        """Which bounds are eased, to what, and because of which gains."""
        names = self.names
        limits = dict.fromkeys(limit for name in names for limit in self.limits[name] if limit.eased)
        common = {limit: len(names) > 1 and all(limit in self.limits[name] for name in names) for limit in limits}
        return [limit.easing("for all gains" if common[limit] else "") for limit in limits]

    def __repr__(self) -> str:
        return "\n".join([f"Stress: {self.heading}", "", tables.markdown(*self.table()), "", *self.notes()])

    def _repr_html_(self) -> str:
        """HTML for a notebook."""
        return tables.page("StressResult", ". ".join([self.heading, *self.notes()]), tables.table(*self.table()))

    def plot(self, *, ax: drawing.GivenAxes = None) -> Figure:
        """Draw the robustness margins, one row per imperfection.

        Args:
            ax: axes to draw into; default: a new figure.
        """
        return _figure(self, ax)

    def to_record(self) -> dict[str, Any]:
        """The complete result as a dictionary for JSON; `docs/stress.md` explains the names."""
        scaling = self.scaling
        return {
            "ensemble": scaling.ensemble.name,
            "base": scaling.base.name,
            "scenarios": scaling.count,
            "seed": scaling.seed,
            "left_out": [constraint.text for constraint in self.left_out],
            "sizes": {"lowest": size(LOWEST), "highest": size(HIGHEST), "factor": size(1), "steps_per_decade": STEPS},
            "gains": [
                {
                    "name": name,
                    "failures_in_base": _violated(self.lost[name]),
                    "limits": [limit.to_record() for limit in self.limits[name]],
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
                    "obstacle": row.reach.obstacle or None,
                    "margins": {
                        name: {
                            "size": margin.size,
                            "held_at": margin.held,
                            "amount": None if margin.size is None else _amount(self.amount(row, margin.size)),
                            "violated": _violated(margin.violated),
                            "monotone": margin.monotone,
                        }
                        for name, margin in row.margins.items()
                    },
                }
                for row in self.ranking
            ],
        }


def _amount(amount: ImperfectionSize | None) -> dict[str, Any] | None:
    return None if amount is None else {**asdict(amount), "unit": _unit(amount.unit), "text": str(amount)}


def _violated(limits: Sequence[ViolatedLimit]) -> list[dict[str, Any]]:
    return [{**asdict(limit), "unit": _unit(limit.unit), "text": limit.words} for limit in limits]


def _unit(unit: str) -> str:
    return "1" if unit == SHARE else unit


GAINS_COLOURS = (drawing.VERMILION, drawing.BLUE)
"""Colours of the paper's gains and of the others."""

LABEL_ROOM = 15.0
"""Factor by which the axis is extended beyond the largest size, for text."""

APART = 0.2
"""Half the distance between two controllers in a row."""

HEADING, A_ROW = 1.35, 0.34
"""Heights in inches."""


def _figure(result: StressResult, ax: drawing.GivenAxes) -> Figure:
    looks = dict(
        zip(result.controllers, GAINS_COLOURS if len(result.controllers) > 1 else GAINS_COLOURS[1:], strict=False)
    )
    scaling = result.scaling
    title = "Robustness margins"
    words = (
        f"Imperfections of “{drawing.plain(scaling.ensemble.name)}” on top of “{drawing.plain(scaling.base.name)}”, "
        f"{scaling.count} scenarios, seed {scaling.seed}; the worst scenario counts"
    )
    with drawing.new_page(ax, HEADING + A_ROW * max(len(result.rows), 3), title, words) as page:
        (axes,) = page.panels()
        for height, row in enumerate(result.ranking):
            for index, name in enumerate(result.names):
                offset = APART * (2 * index / (len(result.names) - 1) - 1) if len(result.names) > 1 else 0.0
                _draw(axes, result, row, row.margins[name], height + offset, looks[name])
        _scales(axes, result)
        handles = [
            Line2D([], [], color=colour, marker="o", markersize=5, linestyle="none", label=_legend(result, name))
            for name, colour in looks.items()
        ]
        page.legend(
            *handles, Line2D([], [], color=drawing.GREY, marker=">", markersize=5, label="holds", linestyle="none")
        )
    return page.figure


def _draw(
    axes: Axes, result: StressResult, row: ImperfectionResult, margin: RobustnessMargin, height: float, colour: str
) -> None:
    """Draw the range of sizes at which gains hold, and the size at which they break with its cause, or an arrow."""
    lowest = size(LOWEST)
    end = margin.held if margin.size is None else margin.size
    axes.plot((lowest / 1.3, max(end, lowest)), (height, height), color=colour, linewidth=1.6, alpha=0.45)
    if margin.size is None:
        if margin.held:
            axes.plot(end, height, ">", color=colour, markersize=5)
        return
    axes.plot(end, height, "o", color=colour, markersize=5, zorder=3)
    amount = result.amount(row, margin.size)
    words = ", ".join(filter(None, (str(amount) if amount and not row.switched else "", margin.violated[0].label)))
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


def _scales(axes: Axes, result: StressResult) -> None:
    name = drawing.plain(result.scaling.ensemble.name)
    axes.set_xscale("log")
    axes.set_xlim(size(LOWEST) / 1.3, size(HIGHEST) * LABEL_ROOM)
    axes.xaxis.set_major_locator(FixedLocator([size(step) for step in range(LOWEST, HIGHEST + 1, STEPS)]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel(f"size of the imperfection over its size in “{name}”")
    axes.axvline(1, color=drawing.INK, linewidth=0.9, zorder=1)
    labels = []
    for row in result.ranking:
        amount = result.amount(row, 1.0)
        labels.append(f"{row.imperfection.label}  {amount}" if amount else row.imperfection.label)
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)


def _legend(result: StressResult, name: str) -> str:
    """Legend of gains: their name, and whether they break without any imperfection."""
    words = "the paper's gains" if name == PAPER else drawing.plain(name)
    return f"{words}: break without any" if result.lost[name] else f"{words} break"
