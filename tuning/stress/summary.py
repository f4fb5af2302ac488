"""A stress test in words, the same at a prompt, in a notebook, on the terminal and in the report."""

from dualwinch.tuning.stress.found import Break, Found, Row
from dualwinch.tuning.stress.ladder import LOWEST, size
from dualwinch.tuning.stress.limits import Limit
from dualwinch.tuning.stress.words import multiple

HOLDS = "holds"
"""Stands where gains break at no size that was tried."""


def heading(found: Found) -> str:
    """What was done, in one line."""
    scaling = found.scaling
    return (
        f"imperfections of '{scaling.ensemble.name}' on top of '{scaling.base.name}', "
        f"{scaling.count} scenario{'s' * (scaling.count != 1)}, seed {scaling.seed}"
    )


def stress_table(found: Found) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: every imperfection, how large it is in the ensemble, at which size gains break and by what."""
    headings = ["imperfection", f"in {found.scaling.ensemble.name}"]
    headings += [words for name in found.names for words in (f"{name} breaks at", "by")]
    rows = []
    for row in found.ranking:
        cells = [row.imperfection.label, str(found.amount(row, 1.0) or "")]
        for name in found.names:
            cells += [where(found, row, row.breaks[name]), by_what(row, row.breaks[name])]
        rows.append(cells)
    return headings, rows


def where(found: Found, row: Row, broken: Break) -> str:
    """At which size gains break, as a multiple of the ensemble's and in its own unit."""
    if broken.size is None:
        far = HOLDS if row.switched else f"{HOLDS} to {multiple(broken.held)}"
        return far if broken.held else "–"
    amount = found.amount(row, broken.size)
    if row.switched:
        return str(amount)
    below = "≤ " if broken.size <= size(LOWEST) else ""
    return f"{below}{multiple(broken.size)}" + (f" ({amount})" if amount else "")


def by_what(row: Row, broken: Break) -> str:
    """What is broken there."""
    if broken.size is None:
        return "end of its range" if row.reach.obstacle else ""
    return broken.broken[0].words + ("" if broken.monotone else "; holds at a larger one")


def notes(found: Found) -> list[str]:
    """What a reader has to know of the table: what is held to, by whom not even in the base, and where ranges end."""
    asked = next(iter(found.limits.values()))
    words = ["Must hold: " + "; ".join(["every run completed", *map(_asked, asked)])]
    for name, limits in found.limits.items():
        if found.lost[name]:
            words.append(f"{name}: breaks without any imperfection, {found.lost[name][0].words}")
            continue
        eased = "; ".join(limit.constraint.label for limit in limits if limit.eased)
        if eased:
            words.append(f"{name}: does not keep to all of that even in the base; held to {eased}")
    words += [
        f"{row.imperfection.label} ends at {multiple(size(row.reach.top))}: {row.reach.obstacle}"
        if row.reach.rungs
        else f"{row.imperfection.label} cannot be scaled: {row.reach.obstacle}"
        for row in found.ranking
        if row.reach.obstacle
    ]
    return words


def _asked(limit: Limit) -> str:
    """A constraint as a number, and as the factor on what the paper's gains reach that it was asked for with."""
    factor = limit.asked.text.partition("=")[2].strip()
    return limit.asked.label + (f" ({factor})" if factor.endswith("paper") else "")
