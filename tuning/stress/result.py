"""What a stress test has found, as a prompt, a notebook and a terminal show it."""

import math
from dataclasses import dataclass
from functools import cached_property

from dualwinch.controllers.controller import Controller
from dualwinch.model.quantities.html import page, table
from dualwinch.tuning.stress.amounts import Amount, amount_of
from dualwinch.tuning.stress.imperfection import Imperfection
from dualwinch.tuning.stress.ladder import LOWEST, size
from dualwinch.tuning.stress.limits import Broken, Limit
from dualwinch.tuning.stress.reach import Reach
from dualwinch.tuning.stress.scaling import Scaling
from dualwinch.tuning.stress.words import multiple

NEVER = "holds"


@dataclass(frozen=True)
class Break:
    """Where gains break under an imperfection.

    Attributes:
        size: the smallest size that was tried and is broken, 1 being the ensemble's; ``None``: none is.
        held: the largest size below that was tried and holds; 0: only without the imperfection.
        broken: what is broken there; the worst first.
        monotone: whether no larger size that was tried holds.
    """

    size: float | None
    held: float
    broken: tuple[Broken, ...]
    monotone: bool

    @property
    def order(self) -> float:
        """Number to sort by: what breaks first comes first, then what holds the least far."""
        return math.inf if self.size is None else self.size


@dataclass(frozen=True)
class Row:
    """One imperfection, or all together.

    Attributes:
        imperfection: what is scaled.
        reach: its smallest and largest size, and what is wrong with larger ones.
        breaks: name of the gains → where they break.
    """

    imperfection: Imperfection
    reach: Reach
    breaks: dict[str, Break]


@dataclass(frozen=True, repr=False)
class Stress:
    """Which imperfections gains break at, and how large those are.

    Attributes:
        scaling: base, ensemble, imperfections, number of scenarios and seed.
        controllers: name → controller: that of the paper's gains first.
        limits: name → what those gains are held to.
        lost: name → how runs in the base ended that were not completed; such gains are not made to bear more.
        rows: imperfections.
    """

    scaling: Scaling
    controllers: dict[str, Controller]
    limits: dict[str, tuple[Limit, ...]]
    lost: dict[str, tuple[Broken, ...]]
    rows: tuple[Row, ...]

    @cached_property
    def ranking(self) -> tuple[Row, ...]:
        """The rows, what breaks the last of the gains first."""
        names = [name for name in reversed(self.controllers) if not self.lost[name]]
        return tuple(sorted(self.rows, key=lambda row: [row.breaks[name].order for name in names]))

    def amount(self, row: Row, size: float) -> Amount | None:
        """How large a row's imperfection of some size is, in its own unit; ``None`` for all together."""
        return amount_of(self.scaling, row.imperfection, size)

    @property
    def heading(self) -> str:
        """What was done, in one line."""
        scaling = self.scaling
        return (
            f"imperfections of '{scaling.ensemble.name}' on top of '{scaling.base.name}', "
            f"{scaling.count} scenarios, seed {scaling.seed}"
        )

    @property
    def table(self) -> tuple[list[str], list[list[str]]]:
        """Headings and rows of words."""
        names = [name for name in self.controllers if not self.lost[name]]
        headings = ["imperfection", f"in {self.scaling.ensemble.name}"]
        headings += [heading for name in names for heading in (f"{name} breaks at", "by")]
        rows = []
        for row in self.ranking:
            cells = [row.imperfection.label, str(self.amount(row, 1.0) or "")]
            for name in names:
                cells += self.cells(row, row.breaks[name])
            rows.append(cells)
        return headings, rows

    def cells(self, row: Row, found: Break) -> tuple[str, str]:
        """Where and by what gains break, in words."""
        if found.size is None:
            beyond = "end of its range" if row.reach.obstacle else ""
            return (f"{NEVER} to {multiple(found.held)}" if found.held else "–"), beyond
        amount = self.amount(row, found.size)
        words = f"{multiple(found.size)} ({amount})" if amount else multiple(found.size)
        lowest = "≤ " if found.size <= size(LOWEST) else ""
        later = "" if found.monotone else "; a larger one holds"
        return lowest + words, found.broken[0].words + later

    @property
    def notes(self) -> list[str]:
        """What a reader has to know of the table: limits, and what gains did without any imperfection."""
        asked = next(iter(self.limits.values()))
        words = ["Broken: a run that is not completed, or not kept: " + "; ".join(limit.asked.label for limit in asked)]
        for name, limits in self.limits.items():
            if self.lost[name]:
                words.append(f"{name}: breaks without any imperfection: {self.lost[name][0].words}")
                continue
            eased = "; ".join(limit.constraint.label for limit in limits if limit.eased)
            if eased:
                words.append(f"{name}: does not keep to all of that in the base; held to {eased}")
        for row in self.rows:
            if row.reach.obstacle:
                words.append(f"{row.imperfection.label} ends at {multiple(size(row.reach.top))}: {row.reach.obstacle}")
        return words

    def to_markdown(self) -> str:
        """The table, with columns of one width."""
        headings, rows = self.table
        cells = [[cell.replace("|", "\\|") for cell in line] for line in [headings, *rows]]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        cells.insert(1, ["-" * width for width in widths])
        lines = [
            "| " + " | ".join(f"{cell:<{width}}" for cell, width in zip(line, widths, strict=True)) + " |"
            for line in cells
        ]
        return "\n".join(lines)

    def __repr__(self) -> str:
        """What was done, the table, and what to know of it."""
        return "\n".join([f"Stress: {self.heading}", "", self.to_markdown(), "", *self.notes])

    def _repr_html_(self) -> str:
        """As a notebook shows it."""
        headings, rows = self.table
        return page("Stress", f"{self.heading}. " + ". ".join(self.notes), table(headings, rows))
