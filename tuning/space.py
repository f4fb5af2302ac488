"""The search space: the tuned gains with their bounds, and the map from a candidate to parameters of a rollout."""

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.source.expressions import GRAPHS, elements_read
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Leaf, Mark, Tunable, behind_number, suggestion, unknown
from dualwinch.model.quantities.tree import leaves, shown, with_leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import closed_loop
from dualwinch.simulation.loop.structure import LoopStructure, structure_of
from dualwinch.simulation.settings import known_keys

Value: TypeAlias = float | str
Point: TypeAlias = dict[str, Value]
"""A candidate: name of a dimension → its value (a number, or the text of a pair)."""


EDGE = 0.02
"""A gain lies at a bound within this share of its range; searches begin further inside."""


@dataclass(frozen=True)
class ContinuousDimension:
    """A number between two bounds.

    Attributes:
        name: of the dimension: a configuration key, or the name of tied keys such as ``controller.winch.kp``.
        keys: configuration keys set to its value.
        lower, upper: bounds, in `unit`.
        log: whether the scale is logarithmic.
        unit: of the value.
    """

    name: str
    keys: tuple[str, ...]
    lower: float
    upper: float
    log: bool
    unit: str

    def decoded(self, share: float) -> float:
        """The value at a share (0 to 1) of the range."""
        share = min(max(share, 0.0), 1.0)
        if self.log:
            value = math.exp(math.log(self.lower) + share * math.log(self.upper / self.lower))
        else:
            value = self.lower + share * (self.upper - self.lower)
        return min(max(value, self.lower), self.upper)

    def encoded(self, value: Value) -> float:
        """The share of the range at which a value lies."""
        number = float(value)
        if self.log:
            return math.log(number / self.lower) / math.log(self.upper / self.lower)
        return (number - self.lower) / (self.upper - self.lower)

    def parameters(self, value: Value) -> tuple[float, ...]:
        """The value of each of the `keys`."""
        return (float(value),) * len(self.keys)

    def start(self, values: Mapping[str, Any]) -> float:
        """The value in an experiment, from its values by key; the mean of tied keys."""
        return float(np.mean([values[key] for key in self.keys]))

    def holds(self, value: Value) -> bool:
        """Whether a value lies within the bounds."""
        return self.lower <= float(value) <= self.upper

    def nearest(self, value: Value) -> float:
        """The nearest value within the bounds."""
        return min(max(float(value), self.lower), self.upper)

    @property
    def allowed(self) -> str:
        """The bounds in words."""
        return f"{self.lower:g} to {self.upper:g}{behind_number(self.unit)}{' (log)' if self.log else ''}"


@dataclass(frozen=True)
class RatioDimension:
    """The power p/q of the sliding surface, one of a list of pairs of odd numbers.

    Attributes:
        name: of the dimension.
        keys: configuration keys of numerator and denominator.
        choices: such as ``5/3``, in ascending order of the ratio.
    """

    name: str
    keys: tuple[str, str]
    choices: tuple[str, ...]
    unit: str = "1"

    def decoded(self, share: float) -> str:
        """The pair at a share (0 to 1) of the list."""
        return self.choices[min(max(int(share * len(self.choices)), 0), len(self.choices) - 1)]

    def encoded(self, value: Value) -> float:
        """The share of the list at the middle of a pair's interval."""
        return (self.choices.index(str(value)) + 0.5) / len(self.choices)

    def parameters(self, value: Value) -> tuple[float, float]:
        """Numerator and denominator."""
        p, _, q = str(value).partition("/")
        return float(p), float(q)

    def start(self, values: Mapping[str, Any]) -> str:
        """The pair in an experiment, from its values by key."""
        return "/".join(f"{int(values[key])}" for key in self.keys)

    def holds(self, value: Value) -> bool:
        """Whether a pair is in the list."""
        return value in self.choices

    def nearest(self, value: Value) -> str:
        """The pair in the list with the nearest ratio."""
        return min(self.choices, key=lambda choice: abs(Fraction(choice) - Fraction(str(value))))

    @property
    def allowed(self) -> str:
        """The list in words."""
        return "one of " + ", ".join(self.choices)


Dimension: TypeAlias = ContinuousDimension | RatioDimension


@dataclass(frozen=True)
class Space:
    """The dimensions of a search."""

    dimensions: tuple[Dimension, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the dimensions."""
        return tuple(dimension.name for dimension in self.dimensions)

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """Configuration keys that vary, in the order of `parameters`."""
        return tuple(key for dimension in self.dimensions for key in dimension.keys)

    def parameters(self, point: Mapping[str, Value]) -> list[float]:
        """The value of each of the `keys`."""
        return [value for dimension in self.dimensions for value in dimension.parameters(point[dimension.name])]

    def settings(self, point: Mapping[str, Value]) -> dict[str, Any]:
        """Configuration key → value, of the key's own type."""
        integers = {
            key for dimension in self.dimensions if isinstance(dimension, RatioDimension) for key in dimension.keys
        }
        values = zip(self.keys, self.parameters(point), strict=True)
        return {key: int(value) if key in integers else value for key, value in values}

    def start(self, values: Mapping[str, Any]) -> Point:
        """The point of an experiment, from its values by key; it may lie outside the bounds."""
        return {dimension.name: dimension.start(values) for dimension in self.dimensions}

    def nearest(self, point: Mapping[str, Value]) -> Point:
        """The nearest point within the bounds."""
        return {dimension.name: dimension.nearest(point[dimension.name]) for dimension in self.dimensions}

    def encoded(self, point: Mapping[str, Value]) -> NDArray[np.float64]:
        """(dimensions,) the point's coordinates in the unit cube."""
        return np.array([dimension.encoded(point[dimension.name]) for dimension in self.dimensions])

    def decoded(self, shares: Sequence[float] | NDArray[np.float64]) -> Point:
        """The point at given coordinates (dimensions,) in the unit cube."""
        return {d.name: d.decoded(float(share)) for d, share in zip(self.dimensions, shares, strict=True)}

    def without(self, keys: Collection[str]) -> "Space":
        """The space without the dimensions of some configuration keys."""
        return Space(tuple(dimension for dimension in self.dimensions if not set(dimension.keys) & set(keys)))

    def around(self, values: Mapping[str, float], factor: float) -> "Space":
        """The space with bounds that are a factor above and below designed values of gains on a logarithmic scale.

        Bounds stay within those of the gain.

        Args:
            values: configuration key → designed value.
            factor: of both bounds.
        """
        return Space(tuple(_around(dimension, values, factor) for dimension in self.dimensions))

    def difference(self, other: "Space") -> str:
        """Differences from another space, in words; empty if there are none."""
        here, theirs = ({d.name: d.allowed for d in space.dimensions} for space in (self, other))
        words = [f"{name} only here" for name in here if name not in theirs]
        words += [f"{name} only there" for name in theirs if name not in here]
        words += [
            f"{name} is {here[name]} here and {theirs[name]} there"
            for name in here
            if name in theirs and here[name] != theirs[name]
        ]
        return "; ".join(words)


def _around(dimension: Dimension, values: Mapping[str, float], factor: float) -> Dimension:
    """`Space.around` of a dimension."""
    if not (isinstance(dimension, ContinuousDimension) and dimension.log and values.keys() >= set(dimension.keys)):
        return dimension
    value = dimension.start(values)
    return replace(dimension, lower=value / factor, upper=value * factor)


def own_bounds(keys: Sequence[str], tunable: Tunable, experiment: Experiment) -> tuple[float, float]:
    """Lower and upper bound of a gain: proportional to the values they follow, widened to the gain's own value.

    A tied gain has several keys. `tunable` has the bounds at the defaults of the values they follow.

    Raises:
        ConfigurationError: the bounds follow a key that is no number of the experiment, or has no default.
    """
    values, descriptions = leaves(experiment), describe_parts(experiment)
    lower, upper = (
        bound * _scale(keys[0], followed, values, descriptions)
        for bound, followed in zip((tunable.lower, tunable.upper), tunable.followed, strict=True)
    )
    lowest, highest = descriptions[keys[0]].bounds
    mean = math.fsum(values[key] for key in keys) / len(keys)
    holding = min(lower, mean) if mean > 0 or not tunable.log else lower
    return max(holding, lowest), min(max(upper, mean), highest)


def _scale(gain: str, followed: str, values: Mapping[str, float], known: Mapping[str, Leaf]) -> float:
    """Ratio of a product of values to its default."""
    table = gain.rpartition(".")[0]
    scale = 1.0
    for sign, name in re.findall(r"([*/]?)([^*/]+)", followed.format(table=table.rpartition(".")[2])):
        if name == "1":
            continue
        key = name if "." in name else f"{table}.{name}"
        default = known[key].default if key in known and known[key].is_number else None
        if not default:
            numbers = [key for key, leaf in known.items() if leaf.is_number and leaf.default]
            raise ConfigurationError(
                f"space: {gain}: its bounds follow '{key}', which is no number with a default; "
                f"{suggestion(key, numbers)}"
            )
        share = values[key] / default
        scale = scale / share if sign == "/" else scale * share
    return scale


def space_of(entries: Mapping[str, Any], experiment: Experiment, further: Mapping[str, Any] | None = None) -> Space:
    """Make a space from its entries.

    Args:
        entries: name → range of the gain: ``{}`` for its own bounds, a table with any of ``lower``, ``upper``, ``log``,
            or a list of pairs for ``controller.nftsm.p/q``. A table's name stands for all standard gains below it.
            Without entries: every standard gain that has an effect, both winches tied.
        experiment: its structure determines which gains have an effect.
        further: entries added to the standard gains if `entries` is empty.

    Raises:
        ConfigurationError: an unknown gain, one without effect or without bounds, or an invalid range.
    """
    gains = _Gains(experiment)
    standard = gains.standard()
    for name, entry in entries.items():  # wrong texts fail before the closed loop is built
        if not any(gain_name.startswith(f"{name}.") for gain_name in standard):
            gains.keys(name)
        _check_entry(name, entry)
    effective = _effective(structure_of(experiment))
    dimensions: dict[str, Dimension] = {}
    for name, entry in (entries or {name: {} for name in gains.standard()} | dict(further or {})).items():
        below = [gain_name for gain_name in gains.standard() if gain_name.startswith(f"{name}.")]
        for gain in below or [name]:
            keys = gains.keys(gain)
            if effective.issuperset(keys):
                ratio = "/" in gain
                dimensions[gain] = _pairs(gain, keys, entry, gains) if ratio else _interval(gain, keys, entry, gains)
            elif entries and not below:
                _check_zero(gain, keys, entry, gains)
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
    """Parse ``NAME``, ``NAME=LOWER:UPPER``, ``NAME=LOWER:UPPER:log`` (or ``:linear``), ``p/q=5/3,7/5``: name and entry.

    Raises:
        ConfigurationError: it is none of these.
    """
    name, equals, range_text = text.partition("=")
    name, range_text = name.strip(), range_text.strip()
    if not equals:
        return name, {}
    if "/" in name:
        return name, [pair.strip() for pair in range_text.split(",")]
    lower, _, range_text = range_text.partition(":")
    upper, _, scale = range_text.partition(":")
    try:
        entry: dict[str, Any] = {"lower": float(lower), "upper": float(upper)}
    except ValueError:
        raise ConfigurationError(f"--space {text}: must be NAME=LOWER:UPPER or NAME=LOWER:UPPER:log") from None
    if scale not in {"", "log", "linear"}:
        raise ConfigurationError(f"--space {text}: the scale must be log or linear")
    return name, entry | ({"log": scale == "log"} if scale else {})


class _Gains:
    """The gains of an experiment and of every registered part, by their names in a search space.

    Names are keys, tied names (``controller.winch.kp`` for both winches) and ratios (``controller.nftsm.p/q``).
    """

    def __init__(self, experiment: Experiment) -> None:
        self.experiment = experiment
        self.leaves = {
            key: leaf
            for key, leaf in {**known_keys(), **describe_parts(experiment)}.items()
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
        """Names of the gains that are searched by default; equal gains of both winches are tied."""
        untied = [key for key, leaf in self.leaves.items() if not leaf.tied and leaf.tunable and leaf.tunable.standard]
        tied_gains = {name: self.leaves[keys[0]].tunable for name, keys in self.tied.items()}
        return untied + [name for name, tunable in tied_gains.items() if tunable and tunable.standard]

    def keys(self, name: str) -> tuple[str, ...]:
        """Configuration keys of a name.

        Raises:
            ConfigurationError: it names no gain.
        """
        if name in self.ratios:
            return self.ratios[name]
        if name in self.tied:
            return tuple(self.tied[name])
        if name not in self.leaves or not self.leaves[name].is_number:
            names = [*(key for key, leaf in self.leaves.items() if leaf.tunable), *self.tied, *self.ratios]
            raise ConfigurationError(f"space: {unknown('gain', name, names)}")
        return (name,)


def _check_zero(name: str, keys: Sequence[str], entry: Any, gains: _Gains) -> None:
    """Raise `ConfigurationError` if a gain has no effect only because it is zero at the start."""
    values = leaves(gains.experiment)
    zeros = [key for key in keys if values.get(key) == 0 and Mark.SHAPES_CODE_AT_ZERO in gains.leaves[key].marks]
    if not zeros:
        return
    interval = {"lower": 0.0, "upper": 1.0} | _own(keys, gains.leaves[keys[0]].tunable, gains.experiment) | dict(entry)
    lower, upper = interval["lower"], interval["upper"]
    inside = math.sqrt(lower * upper) if lower > 0 else upper / 2
    if not all(gains.leaves[key].admits(inside) for key in zeros) or inside <= 0:
        return
    try:
        experiment_inside = with_leaves(gains.experiment, dict.fromkeys(zeros, inside))
    except ConfigurationError:
        return
    if _effective(structure_of(experiment_inside)).issuperset(keys):
        settings = " ".join(f"--set {key}={inside:.3g}" for key in zeros)
        raise ConfigurationError(
            f"space: {name}: is 0 at the start, where the loop leaves it out; set it above 0 first, e.g. {settings}"
        )


@GRAPHS.cached
def _effective(structure: LoopStructure) -> frozenset[str]:
    """Parameters on which the closed loop of a structure depends."""
    loop = closed_loop(structure)
    read = set().union(*(elements_read(function, "parameters") for function in loop.functions))
    return frozenset(loop.parameters[element] for element in read)


LARGEST_BOUND = 1e30
"""Largest magnitude of a bound; its inverse is the least on a log scale. Beyond, searches fail numerically."""


def _check_entry(name: str, entry: Any) -> None:
    """Raise `ConfigurationError` for an entry with invalid bounds or pairs."""
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
        if abs(bound) > LARGEST_BOUND:
            raise ConfigurationError(f"space: {name}: bounds must be within ±{LARGEST_BOUND:g}, not {shown(bound)}")


def _interval(name: str, keys: Sequence[str], entry: Any, gains: _Gains) -> ContinuousDimension:
    leaf = gains.leaves[keys[0]]
    _check_entry(name, entry)
    interval = _own(keys, leaf.tunable, gains.experiment) | dict(entry)
    if not {"lower", "upper"} <= set(interval):
        raise ConfigurationError(f"space: {name}: has no bounds of its own; give them, e.g. {name}=0.1:10:log")
    lower, upper = interval["lower"], interval["upper"]
    log = bool(interval.get("log", False)) and ("log" in entry or lower > 0)
    if not lower < upper:
        raise ConfigurationError(f"space: {name}: lower = {lower:g} must be < upper = {upper:g}")
    if log and lower <= 0:
        raise ConfigurationError(f"space: {name}: lower = {lower:g} must be > 0 on a log scale")
    if log and lower < 1 / LARGEST_BOUND:
        raise ConfigurationError(f"space: {name}: lower = {lower:g} must be >= {1 / LARGEST_BOUND:g} on a log scale")
    for bound in (lower, upper):
        if not leaf.admits(bound):
            allowed = leaf.allowed + behind_number(leaf.quantity.unit)
            raise ConfigurationError(f"space: {name}: bound {bound:g} must be {allowed}")
    return ContinuousDimension(name, tuple(keys), float(lower), float(upper), log, leaf.quantity.unit)


def _own(keys: Sequence[str], tunable: Tunable | None, experiment: Experiment) -> dict[str, Any]:
    """A gain's own bounds, as an entry."""
    if tunable is None:
        return {}
    lower, upper = own_bounds(keys, tunable, experiment)
    return {"lower": lower, "upper": upper, "log": tunable.log}


MOST_DIGITS = 9
"""Largest number of digits of p and q."""


def _pairs(name: str, keys: Sequence[str], entry: Any, gains: _Gains) -> RatioDimension:
    leaf = gains.leaves[keys[0]]
    choices = entry or (leaf.ratio.choices if leaf.ratio else ())
    for choice in choices:
        if not _is_ratio(str(choice)):
            raise ConfigurationError(f"space: {name}: '{str(choice)[:40]}' must be two odd numbers p/q with p > q >= 1")
    return RatioDimension(name, (keys[0], keys[1]), tuple(sorted({str(choice) for choice in choices}, key=Fraction)))


def _is_ratio(choice: str) -> bool:
    words = choice.split("/")
    if len(words) != 2 or not all(word.isascii() and word.isdecimal() and len(word) <= MOST_DIGITS for word in words):
        return False
    p, q = map(int, words)
    return p % 2 == q % 2 == 1 <= q < p


def _check_overlap(dimensions: Iterable[Dimension]) -> None:
    owners: dict[str, str] = {}
    for dimension in dimensions:
        for key in dimension.keys:
            if key in owners:
                raise ConfigurationError(f"space: {key} is in both {owners[key]} and {dimension.name}; keep one")
            owners[key] = dimension.name


def space_to_record(space: Space) -> list[dict[str, Any]]:
    """The dimensions of a space: name, keys, unit, and bounds with scale or choices."""
    return [
        {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(dimension).items()}
        for dimension in space.dimensions
    ]


def space_from(records: Sequence[dict[str, Any]]) -> Space:
    """The space of a record from `space_to_record`."""
    dimensions = list[Dimension]()
    for record in records:
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in record.items()
        }
        dimensions.append(RatioDimension(**values) if "choices" in record else ContinuousDimension(**values))
    return Space(tuple(dimensions))
