"""A search space from names and bounds, written as ``--space`` texts or as a table of a TOML file.

Bounds and scale that are not given are those that stand beside the gain itself (`tuning.own_bounds`).
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from functools import cache
from typing import Any

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe, describe_parts
from dualwinch.model.quantities.quantity import Tunable, behind_number, nearest
from dualwinch.model.quantities.validation import shown
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import closed_loop
from dualwinch.simulation.loop.structure import Structure, structure_of
from dualwinch.tuning.own_bounds import own_bounds
from dualwinch.tuning.space import Dimension, Interval, Pairs, Space


def space_of(entries: Mapping[str, Any], experiment: Experiment, further: Mapping[str, Any] | None = None) -> Space:
    """The space that some entries describe.

    Args:
        entries: name → what to search: ``{}`` for the gain's own bounds, a table with any of ``lower``, ``upper``,
            ``log``, or a list of pairs for ``controller.nftsm.p/q``. A table's name stands for all standard gains
            below it. Without entries: every standard gain that has an effect, both winches tied.
        experiment: its structure says which gains have an effect.
        further: entries beside the standard gains, where there are no others.

    Raises:
        ConfigurationError: an unknown gain, one without effect or without bounds, or bounds that are no range.
    """
    gains = _Gains(experiment)
    standard = gains.standard()
    for name, entry in entries.items():  # what is wrong with the words, before the closed loop is made
        if not any(known.startswith(f"{name}.") for known in standard):
            gains.keys(name)
        _check_entry(name, entry)
    effective = _effective(structure_of(experiment))
    dimensions: dict[str, Dimension] = {}
    for name, entry in (entries or {name: {} for name in gains.standard()} | dict(further or {})).items():
        below = [known for known in gains.standard() if known.startswith(f"{name}.")]
        for gain in below or [name]:
            keys = gains.keys(gain)
            if effective.issuperset(keys):
                ratio = "/" in gain
                dimensions[gain] = _pairs(gain, keys, entry, gains) if ratio else _interval(gain, keys, entry, gains)
            elif entries and not below:
                controller = experiment.controller
                raise ConfigurationError(
                    f"{gain}: has no effect with controller.kind = {controller.law.kind!r}, estimator = "
                    f"{controller.estimator.kind!r}, coordination = {controller.coordination.kind!r}"
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
    if "/" in name:
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


class _Gains:
    """The gains of an experiment and of every registered part, by the names that a search space may use.

    Beside their own keys these are those of tied ones (``controller.winch.kp`` for both winches) and of ratios
    (``controller.nftsm.p/q``).
    """

    def __init__(self, experiment: Experiment) -> None:
        """Collect them."""
        self.experiment = experiment
        self.leaves = {
            key: leaf
            for key, leaf in {**describe(Experiment), **describe_parts(experiment)}.items()
            if key.startswith("controller.")
        }
        self.tied: dict[str, list[str]] = {}
        self.ratios: dict[str, tuple[str, str]] = {}
        for key, leaf in self.leaves.items():
            if leaf.tied:
                self.tied.setdefault(leaf.tied, []).append(key)
            if leaf.ratio:
                denominator = leaf.ratio.denominator
                self.ratios[f"{key}/{denominator}"] = key, f"{key.rpartition('.')[0]}.{denominator}"

    def standard(self) -> list[str]:
        """What is searched where nobody says what to search; gains alike are tied."""
        own = [key for key, leaf in self.leaves.items() if not leaf.tied and leaf.tunable and leaf.tunable.standard]
        alike = {name: self.leaves[keys[0]].tunable for name, keys in self.tied.items()}
        return own + [name for name, tunable in alike.items() if tunable and tunable.standard]

    def keys(self, name: str) -> tuple[str, ...]:
        """Configuration keys that a name stands for.

        Raises:
            ConfigurationError: it names no gain.
        """
        if name in self.ratios:
            return self.ratios[name]
        if name in self.tied:
            return tuple(self.tied[name])
        if name not in self.leaves or not self.leaves[name].is_number:
            known = [*(key for key, leaf in self.leaves.items() if leaf.tunable), *self.tied, *self.ratios]
            raise ConfigurationError(f"space: unknown gain '{name}'; did you mean '{nearest(name, known)}'?")
        return (name,)


@cache
def _effective(structure: Structure) -> frozenset[str]:
    """Parameters that the closed loop of a structure depends on."""
    loop = closed_loop(structure)
    index = loop.step.index_in("parameters")
    used = {column for output in (0, 1) for column in loop.step.jac_sparsity(output, index).get_col()}
    return frozenset(loop.parameters[column] for column in used)


LARGEST = 1e30
"""Bounds are of at most this magnitude, and on a log scale at least its inverse: beyond, searches lose their way."""


def _check_entry(name: str, entry: Any) -> None:
    """Raise `ConfigurationError` where an entry's bounds or pairs are none."""
    if "/" in name:
        if isinstance(entry, Mapping) and not entry:
            return
        if not isinstance(entry, (list, tuple)):
            raise ConfigurationError(f"space: {name}: must be a list of pairs such as 5/3")
        return
    if not isinstance(entry, Mapping) or set(entry) - {"lower", "upper", "log"}:
        raise ConfigurationError(f"space: {name}: must be a table of lower, upper and log")
    if not isinstance(entry.get("log", False), bool):
        raise ConfigurationError(f"space: {name}: log must be true or false")
    bounds = [entry[word] for word in ("lower", "upper") if word in entry]
    for bound in bounds:
        if isinstance(bound, bool) or not isinstance(bound, (int, float)) or not abs(bound) < math.inf:
            raise ConfigurationError(f"space: {name}: bounds must be finite numbers, not {shown(bound)}")
        if abs(bound) > LARGEST:
            raise ConfigurationError(f"space: {name}: bounds must be within ±{LARGEST:g}, not {shown(bound)}")


def _interval(name: str, keys: Sequence[str], entry: Any, gains: _Gains) -> Interval:
    leaf = gains.leaves[keys[0]]
    _check_entry(name, entry)
    given = _own(keys, leaf.tunable, gains.experiment) | dict(entry)
    if not {"lower", "upper"} <= set(given):
        raise ConfigurationError(f"space: {name}: has no bounds of its own; give them, e.g. {name}=0.1:10:log")
    lower, upper = given["lower"], given["upper"]
    log = bool(given.get("log", False)) and ("log" in entry or lower > 0)
    if not lower < upper:
        raise ConfigurationError(f"space: {name}: lower = {lower:g} must be < upper = {upper:g}")
    if log and lower <= 0:
        raise ConfigurationError(f"space: {name}: lower = {lower:g} must be > 0 on a log scale")
    if log and lower < 1 / LARGEST:
        raise ConfigurationError(f"space: {name}: lower = {lower:g} must be >= {1 / LARGEST:g} on a log scale")
    for bound in (lower, upper):
        if not leaf.admits(bound):
            allowed = leaf.allowed + behind_number(leaf.quantity.unit)
            raise ConfigurationError(f"space: {name}: bound {bound:g} must be {allowed}")
    return Interval(name, tuple(keys), float(lower), float(upper), log, leaf.quantity.unit)


def _own(keys: Sequence[str], tunable: Tunable | None, experiment: Experiment) -> dict[str, Any]:
    """The bounds that stand beside a gain, as an entry."""
    if tunable is None:
        return {}
    lower, upper = own_bounds(keys, tunable, experiment)
    return {"lower": lower, "upper": upper, "log": tunable.log}


MOST_DIGITS = 9
"""Digits of the numbers of a pair."""


def _pairs(name: str, keys: Sequence[str], entry: Any, gains: _Gains) -> Pairs:
    leaf = gains.leaves[keys[0]]
    choices = entry or (leaf.ratio.choices if leaf.ratio else ())
    for choice in choices:
        if not _is_ratio(str(choice)):
            raise ConfigurationError(f"space: {name}: '{str(choice)[:40]}' must be two odd numbers p/q with p > q >= 1")
    return Pairs(name, (keys[0], keys[1]), tuple(sorted({str(choice) for choice in choices}, key=Fraction)))


def _is_ratio(choice: str) -> bool:
    words = choice.split("/")
    if len(words) != 2 or not all(word.isascii() and word.isdecimal() and len(word) <= MOST_DIGITS for word in words):
        return False
    p, q = map(int, words)
    return p % 2 == q % 2 == 1 <= q < p


def _check_overlap(dimensions: Iterable[Dimension]) -> None:
    seen: dict[str, str] = {}
    for dimension in dimensions:
        for key in dimension.keys:
            if key in seen:
                raise ConfigurationError(f"space: {key} is in both {seen[key]} and {dimension.name}; keep one")
            seen[key] = dimension.name
