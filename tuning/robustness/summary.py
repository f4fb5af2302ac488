"""A stress test in words, the same at a prompt, in a notebook, on the terminal and in the report."""

from dataclasses import asdict
from typing import Any

from dualwinch.model.quantities.tree import leaves
from dualwinch.tuning.robustness.found import Breakdown, ImperfectionResult, RobustnessFindings
from dualwinch.tuning.robustness.limits import SHARE, BrokenLimit, RobustnessLimit, multiple
from dualwinch.tuning.robustness.sizes import HIGHEST, LOWEST, STEPS, size

HOLDS = "holds"
"""Stands where gains break at no size that was tried."""


def heading(found: RobustnessFindings) -> str:
    """What was done, in one line."""
    scaling = found.scaling
    return (
        f"imperfections of '{scaling.ensemble.name}' on top of '{scaling.base.name}', "
        f"{scaling.count} scenario{'s' * (scaling.count != 1)}, seed {scaling.seed}"
    )


def stress_table(found: RobustnessFindings) -> tuple[list[str], list[list[str]]]:
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


def where(found: RobustnessFindings, row: ImperfectionResult, broken: Breakdown) -> str:
    """At which size gains break, as a multiple of the ensemble's and in its own unit."""
    if broken.size is None:
        far = HOLDS if row.switched else f"{HOLDS} to {multiple(broken.held)}"
        return far if broken.held else "–"
    amount = found.amount(row, broken.size)
    if row.switched:
        return str(amount)
    below = "≤ " if broken.size <= size(LOWEST) else ""
    return f"{below}{multiple(broken.size)}" + (f" ({amount})" if amount else "")


def by_what(row: ImperfectionResult, broken: Breakdown) -> str:
    """What is broken there."""
    if broken.size is None:
        return "end of its range" if row.reach.obstacle else ""
    return broken.broken[0].words + ("" if broken.monotone else "; holds at a larger one")


def notes(found: RobustnessFindings) -> list[str]:
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


def _asked(limit: RobustnessLimit) -> str:
    """A constraint as a number, and as the factor on what the paper's gains reach that it was asked for with."""
    factor = limit.asked.text.partition("=")[2].strip()
    return limit.asked.label + (f" ({factor})" if factor.endswith("paper") else "")


def to_record(found: RobustnessFindings) -> dict[str, Any]:
    """Everything that was found; `docs/stress.md` says what the names mean."""
    scaling = found.scaling
    return {
        "ensemble": scaling.ensemble.name,
        "base": scaling.base.name,
        "scenarios": scaling.count,
        "seed": scaling.seed,
        "sizes": {"lowest": size(LOWEST), "highest": size(HIGHEST), "factor": size(1), "steps_a_decade": STEPS},
        "gains": [_gains(found, name) for name in found.controllers],
        "imperfections": [_row(found, row) for row in found.ranking],
    }


def _gains(found: RobustnessFindings, name: str) -> dict[str, Any]:
    controller = found.controllers[name]
    return {
        "name": name,
        "lost_in_base": [_broken(broken) for broken in found.lost[name]],
        "limits": [_limit(limit) for limit in found.limits[name]],
        "controller": {key: value for key, value in leaves(controller).items() if value is not None},
    }


def _limit(limit: RobustnessLimit) -> dict[str, Any]:
    constraint = limit.constraint
    return {
        "asked": limit.asked.text,
        "statistic": constraint.statistic.name,
        "at_least": constraint.at_least,
        "bound": constraint.bound,
        "unit": constraint.statistic.unit,
        "eased": limit.eased,
    }


def _row(found: RobustnessFindings, row: ImperfectionResult) -> dict[str, Any]:
    return {
        "name": row.imperfection.name,
        "label": row.imperfection.label,
        "keys": list(row.imperfection.keys),
        "in_ensemble": _amount(found, row, 1.0),
        "largest_size": size(row.reach.top) if row.reach.rungs else None,
        "ends_by": row.reach.obstacle or None,
        "breaks": {name: _break(found, row, broken) for name, broken in row.breaks.items()},
    }


def _break(found: RobustnessFindings, row: ImperfectionResult, broken: Breakdown) -> dict[str, Any]:
    return {
        "size": broken.size,
        "held_at": broken.held,
        "amount": None if broken.size is None else _amount(found, row, broken.size),
        "broken": [_broken(each) for each in broken.broken],
        "monotone": broken.monotone,
    }


def _amount(found: RobustnessFindings, row: ImperfectionResult, multiple: float) -> dict[str, Any] | None:
    amount = found.amount(row, multiple)
    return None if amount is None else {**asdict(amount), "unit": _unit(amount.unit), "text": str(amount)}


def _broken(broken: BrokenLimit) -> dict[str, Any]:
    return {**asdict(broken), "unit": _unit(broken.unit), "text": broken.words}


def _unit(unit: str) -> str:
    return "1" if unit == SHARE else unit
