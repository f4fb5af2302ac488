"""A search space from names and bounds, written as ``--space`` texts or as a table of a TOML file.

Bounds and scale that are not given are those that stand beside the gain itself (`model.quantity.Tunable`).
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from functools import cache
from typing import Any

import annotated_types as at

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantity import Leaf, Tunable, behind_number, describe, nearest
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import closed_loop
from dualwinch.simulation.loop.structure import Structure, structure_of
from dualwinch.tuning.space import Dimension, Interval, Pairs, Space

POWER, POWER_KEYS = "controller.nftsm.p/q", ("controller.nftsm.p", "controller.nftsm.q")
ODD_PAIRS = ("11/9", "9/7", "7/5", "5/3", "9/5")
"""Powers of the surface to choose from where nothing else is asked for, all between 1 and 2."""

TIED, WINCHES = "controller.winch.", ("controller.winch_1.", "controller.winch_2.")
"""A name below ``controller.winch.`` means both winches."""


def space_of(entries: Mapping[str, Any], experiment: Experiment) -> Space:
    """The space that some entries describe.

    Args:
        entries: name → what to search: ``{}`` for the gain's own bounds, a table with any of ``lower``, ``upper``,
            ``log``, or a list of pairs for ``controller.nftsm.p/q``. A table's name stands for all standard gains
            below it. Without entries: every standard gain that has an effect, both winches tied.
        experiment: its structure says which gains have an effect.

    Raises:
        ConfigurationError: an unknown gain, one without effect or without bounds, or bounds that are no range.
    """
    tunables = _tunables()
    effective = _effective(structure_of(experiment))
    names = entries or {name: {} for name, leaf in tunables.items() if leaf.standard and not name.startswith(WINCHES)}
    dimensions: dict[str, Dimension] = {}
    for name, entry in names.items():
        below = [known for known, leaf in tunables.items() if known.startswith(f"{name}.") and leaf.standard]
        for one in below or [name]:
            keys = _keys(one, tunables)
            if effective.issuperset(keys):
                dimensions[one] = _pairs(entry) if one == POWER else _interval(one, keys, entry)
            elif entries and not below:
                raise ConfigurationError(
                    f"{one}: has no effect with controller.kind = {experiment.controller.kind!r}, estimator = "
                    f"{experiment.controller.estimator!r}, coordination = {experiment.controller.coordination.kind!r}"
                )
    if not dimensions:
        raise ConfigurationError("space: is empty; name at least one gain, e.g. --space controller.nftsm.beta")
    _check_overlap(dimensions.values())
    return Space(tuple(dimensions.values()))


def entry_from(text: str) -> tuple[str, Any]:
    """Name and entry of ``NAME``, ``NAME=LOWER:UPPER``, ``NAME=LOWER:UPPER:log`` (or ``:linear``), ``p/q=5/3,7/5``.

    Raises:
        ConfigurationError: it is none of these.
    """
    name, given, rest = text.partition("=")
    name, rest = name.strip(), rest.strip()
    if not given:
        return name, {}
    if name == POWER:
        return name, [pair.strip() for pair in rest.split(",")]
    lower, _, rest = rest.partition(":")
    upper, _, scale = rest.partition(":")
    try:
        entry: dict[str, Any] = {"lower": float(lower), "upper": float(upper)}
    except ValueError:
        raise ConfigurationError(f"--space {text}: must be NAME=LOWER:UPPER or NAME=LOWER:UPPER:log") from None
    if scale not in {"", "log", "linear"}:
        raise ConfigurationError(f"--space {text}: the scale must be log or linear")
    return name, entry | ({"log": scale == "log"} if scale else {})


@cache
def _leaves() -> dict[str, Leaf]:
    return describe(Experiment)


@cache
def _tunables() -> dict[str, Tunable]:
    """Name → search range of every gain, tied winches and the pair of powers included."""
    found = {key: leaf.tunable for key, leaf in _leaves().items() if leaf.tunable}
    tied = {key.replace(WINCHES[0], TIED): tunable for key, tunable in found.items() if key.startswith(WINCHES[0])}
    return found | tied | {POWER: Tunable(0, 1, standard=False)}


def _keys(name: str, tunables: Mapping[str, Tunable]) -> tuple[str, ...]:
    if name == POWER:
        return POWER_KEYS
    if name.startswith(TIED) and name in tunables:
        return tuple(winch + name.removeprefix(TIED) for winch in WINCHES)
    leaf = _leaves().get(name)
    if leaf is None or not leaf.is_number or not name.startswith("controller."):
        raise ConfigurationError(f"space: unknown gain '{name}'; did you mean '{nearest(name, tunables)}'?")
    return (name,)


@cache
def _effective(structure: Structure) -> frozenset[str]:
    """Parameters that the closed loop of a structure depends on."""
    loop = closed_loop(structure)
    place = loop.step.index_in("parameters")
    used = {column for output in (0, 1) for column in loop.step.jac_sparsity(output, place).get_col()}
    return frozenset(loop.parameters[column] for column in used)


def _interval(name: str, keys: Sequence[str], entry: Any) -> Interval:
    known = _tunables().get(name)
    if not isinstance(entry, Mapping) or set(entry) - {"lower", "upper", "log"}:
        raise ConfigurationError(f"space: {name}: must be a table of lower, upper and log")
    given = {} if known is None else {"lower": known.lower, "upper": known.upper, "log": known.log}
    given |= dict(entry)
    if not {"lower", "upper"} <= set(given):
        raise ConfigurationError(f"space: {name}: has no bounds of its own; give them, e.g. {name}=0.1:10:log")
    lower, upper = given["lower"], given["upper"]
    for bound in (lower, upper):
        if isinstance(bound, bool) or not isinstance(bound, (int, float)) or not math.isfinite(bound):
            raise ConfigurationError(f"space: {name}: bounds must be finite numbers, not {bound!r}")
    if "log" in entry and not isinstance(entry["log"], bool):
        raise ConfigurationError(f"space: {name}: log must be true or false")
    log = bool(given.get("log", False)) and ("log" in entry or lower > 0)
    if not lower < upper:
        raise ConfigurationError(f"space: {name}: lower = {lower:g} must be < upper = {upper:g}")
    if log and lower <= 0:
        raise ConfigurationError(f"space: {name}: lower = {lower:g} must be > 0 on a log scale")
    leaf = _leaves()[keys[0]]
    for bound in (lower, upper):
        if not all(_allows(constraint, bound) for constraint in leaf.constraints):
            allowed = leaf.allowed + behind_number(leaf.quantity.unit)
            raise ConfigurationError(f"space: {name}: bound {bound:g} must be {allowed}")
    return Interval(name, tuple(keys), float(lower), float(upper), log, leaf.quantity.unit)


def _allows(constraint: at.BaseMetadata, value: float) -> bool:
    match constraint:
        case at.Gt(gt=bound):
            return value > bound  # pyright: ignore[reportOperatorIssue]
        case at.Ge(ge=bound):
            return value >= bound  # pyright: ignore[reportOperatorIssue]
        case at.Lt(lt=bound):
            return value < bound  # pyright: ignore[reportOperatorIssue]
        case at.Le(le=bound):
            return value <= bound  # pyright: ignore[reportOperatorIssue]
        case _:
            return True


def _pairs(entry: Any) -> Pairs:
    choices = entry or ODD_PAIRS
    if isinstance(choices, (Mapping, str)):
        raise ConfigurationError(f"space: {POWER}: must be a list of pairs such as 5/3")
    for choice in choices:
        p, _, q = str(choice).partition("/")
        if not (p.isdecimal() and q.isdecimal()) or int(p) % 2 == 0 or int(q) % 2 == 0 or not 1 <= int(q) < int(p):
            raise ConfigurationError(f"space: {POWER}: '{choice}' must be two odd numbers p/q with p > q >= 1")
    return Pairs(POWER, POWER_KEYS, tuple(sorted({str(choice) for choice in choices}, key=Fraction)))


def _check_overlap(dimensions: Iterable[Dimension]) -> None:
    seen: dict[str, str] = {}
    for dimension in dimensions:
        for key in dimension.keys:
            if key in seen:
                raise ConfigurationError(f"space: {key} is in both {seen[key]} and {dimension.name}; keep one")
            seen[key] = dimension.name
