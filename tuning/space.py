"""The search space: which gains vary, between which bounds, and how a candidate becomes parameters of a rollout."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.quantities.quantity import behind_number

Value: TypeAlias = float | str
Point: TypeAlias = dict[str, Value]
"""A candidate: name of a dimension → its value (a number, or a word for a pair)."""


@dataclass(frozen=True)
class Interval:
    """A number between two bounds.

    Attributes:
        name: of the dimension: a configuration key, or the name of tied ones such as ``controller.winch.kp``.
        keys: configuration keys that get its value.
        lower, upper: bounds, in `unit`.
        log: whether factors count, not differences.
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
        """The value that an experiment's values amount to; the mean of tied ones."""
        return float(np.mean([values[key] for key in self.keys]))

    def holds(self, value: Value) -> bool:
        """Whether a value lies within the bounds."""
        return self.lower <= float(value) <= self.upper

    def nearest(self, value: Value) -> float:
        """The value within the bounds that is nearest."""
        return min(max(float(value), self.lower), self.upper)

    @property
    def allowed(self) -> str:
        """The bounds in words."""
        return f"{self.lower:g} to {self.upper:g}{behind_number(self.unit)}{' (log)' if self.log else ''}"


@dataclass(frozen=True)
class Pairs:
    """The power p/q of the sliding surface, one of some pairs of odd numbers.

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
        """The share of the list in whose middle a pair lies."""
        return (self.choices.index(str(value)) + 0.5) / len(self.choices)

    def parameters(self, value: Value) -> tuple[float, float]:
        """Numerator and denominator."""
        p, _, q = str(value).partition("/")
        return float(p), float(q)

    def start(self, values: Mapping[str, Any]) -> str:
        """The pair of an experiment's values."""
        return "/".join(f"{int(values[key])}" for key in self.keys)

    def holds(self, value: Value) -> bool:
        """Whether a pair is in the list."""
        return value in self.choices

    def nearest(self, value: Value) -> str:
        """The pair in the list whose ratio is nearest."""
        return min(self.choices, key=lambda choice: abs(Fraction(choice) - Fraction(str(value))))

    @property
    def allowed(self) -> str:
        """The list in words."""
        return "one of " + ", ".join(self.choices)


Dimension: TypeAlias = Interval | Pairs


@dataclass(frozen=True)
class Space:
    """The dimensions that are searched."""

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
        whole = {key for dimension in self.dimensions if isinstance(dimension, Pairs) for key in dimension.keys}
        values = zip(self.keys, self.parameters(point), strict=True)
        return {key: int(value) if key in whole else value for key, value in values}

    def start(self, values: Mapping[str, Any]) -> Point:
        """The point of an experiment's own values, by their keys; it may lie outside of the bounds."""
        return {dimension.name: dimension.start(values) for dimension in self.dimensions}

    def nearest(self, point: Mapping[str, Value]) -> Point:
        """The point within the bounds that is nearest."""
        return {dimension.name: dimension.nearest(point[dimension.name]) for dimension in self.dimensions}

    def encoded(self, point: Mapping[str, Value]) -> NDArray[np.float64]:
        """(dimensions,) the point in the unit cube."""
        return np.array([dimension.encoded(point[dimension.name]) for dimension in self.dimensions])

    def decoded(self, shares: Sequence[float] | NDArray[np.float64]) -> Point:
        """The point of the unit cube whose shares these are, in the order of the dimensions."""
        return {d.name: d.decoded(float(share)) for d, share in zip(self.dimensions, shares, strict=True)}

    def without(self, keys: Collection[str]) -> "Space":
        """The space without the dimensions of some configuration keys."""
        return Space(tuple(dimension for dimension in self.dimensions if not set(dimension.keys) & set(keys)))

    def difference(self, other: "Space") -> str:
        """How another space differs, in words; empty where it does not."""
        ours, theirs = ({d.name: d.allowed for d in space.dimensions} for space in (self, other))
        words = [f"{name} only here" for name in ours if name not in theirs]
        words += [f"{name} only there" for name in theirs if name not in ours]
        words += [
            f"{name} is {ours[name]} here and {theirs[name]} there"
            for name in ours
            if name in theirs and ours[name] != theirs[name]
        ]
        return "; ".join(words)
