"""A stress test as data that JSON holds."""

from dataclasses import asdict
from typing import Any

from dualwinch.model.quantities.tree import leaves
from dualwinch.tuning.stress.found import Break, Found, Row
from dualwinch.tuning.stress.ladder import HIGHEST, LOWEST, STEPS, size
from dualwinch.tuning.stress.limits import Broken, Limit
from dualwinch.tuning.stress.words import SHARE


def to_record(found: Found) -> dict[str, Any]:
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


def _gains(found: Found, name: str) -> dict[str, Any]:
    controller = found.controllers[name]
    return {
        "name": name,
        "lost_in_base": [_broken(broken) for broken in found.lost[name]],
        "limits": [_limit(limit) for limit in found.limits[name]],
        "controller": {key: value for key, value in leaves(controller).items() if value is not None},
    }


def _limit(limit: Limit) -> dict[str, Any]:
    constraint = limit.constraint
    return {
        "asked": limit.asked.text,
        "statistic": constraint.statistic.name,
        "at_least": constraint.at_least,
        "bound": constraint.bound,
        "unit": constraint.statistic.unit,
        "eased": limit.eased,
    }


def _row(found: Found, row: Row) -> dict[str, Any]:
    return {
        "name": row.imperfection.name,
        "label": row.imperfection.label,
        "keys": list(row.imperfection.keys),
        "in_ensemble": _amount(found, row, 1.0),
        "largest_size": size(row.reach.top) if row.reach.rungs else None,
        "ends_by": row.reach.obstacle or None,
        "breaks": {name: _break(found, row, broken) for name, broken in row.breaks.items()},
    }


def _break(found: Found, row: Row, broken: Break) -> dict[str, Any]:
    return {
        "size": broken.size,
        "held_at": broken.held,
        "amount": None if broken.size is None else _amount(found, row, broken.size),
        "broken": [_broken(each) for each in broken.broken],
        "monotone": broken.monotone,
    }


def _amount(found: Found, row: Row, multiple: float) -> dict[str, Any] | None:
    amount = found.amount(row, multiple)
    return None if amount is None else {**asdict(amount), "unit": _unit(amount.unit), "text": str(amount)}


def _broken(broken: Broken) -> dict[str, Any]:
    return {**asdict(broken), "unit": _unit(broken.unit), "text": broken.words}


def _unit(unit: str) -> str:
    return "1" if unit == SHARE else unit
