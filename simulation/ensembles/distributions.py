"""Distributions a value of an experiment can be drawn from.

A distribution is its quantile function: one uniform draw between 0 and 1 decides the value. Values that share the
draw move together, and another way to spread the draws (a low-discrepancy sequence, say) needs nothing new here.

SciPy's frozen distributions (``scipy.stats.truncnorm(...).ppf``) give the same values to round-off, but take a hundred
times as long for each of them, and a second to import.
"""

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, ClassVar

from dualwinch.model.quantities.part import Part, Registry
from dualwinch.model.quantities.quantity import Positive, Quantity, Rule
from dualwinch.simulation.scenario import Value


class Distribution(Part):
    """The distribution of a value: a frozen dataclass of its numbers, in the unit of the value.

    Where a draw is a factor on the nominal value they are factors.
    """

    @abstractmethod
    def quantile(self, share: float) -> Value:
        """The value that a `share` (0 to 1) of all draws do not exceed."""

    @property
    @abstractmethod
    def ends(self) -> tuple[Value, ...]:
        """The values that show whether every draw is allowed: both bounds, or all choices."""


class Bounded(Distribution):
    """A distribution with a least value `low` and a largest value `high`."""

    low: float
    high: float

    rules: ClassVar[tuple[Rule, ...]] = (
        Rule(
            ("low", "high"),
            lambda drawn: drawn.low < drawn.high,
            lambda drawn, _: f"must be < high = {drawn.high:g}",
        ),
    )

    @property
    def ends(self) -> tuple[float, float]:
        """Both bounds."""
        return self.low, self.high


@dataclass(frozen=True)
class Uniform(Bounded):
    """Equally likely anywhere from `low` to `high`."""

    low: Annotated[float, Quantity("", "least value")]
    high: Annotated[float, Quantity("", "largest value")]

    kind: ClassVar = "uniform"

    def quantile(self, share: float) -> float:
        """The value that a `share` (0 to 1) of all draws do not exceed."""
        return self.low + share * (self.high - self.low)


@dataclass(frozen=True)
class LogUniform(Bounded):
    """From `low` to `high`, each octave as likely as any other: for values known by their order of magnitude only."""

    low: Annotated[Positive, Quantity("", "least value")]
    high: Annotated[Positive, Quantity("", "largest value")]

    kind: ClassVar = "log-uniform"

    def quantile(self, share: float) -> float:
        """The value that a `share` (0 to 1) of all draws do not exceed."""
        value = self.low * math.exp(share * math.log(self.high / self.low))
        return min(max(value, self.low), self.high)


@dataclass(frozen=True)
class Normal(Bounded):
    """Normal around `mean` with the standard deviation `sigma` before the tails beyond `low` and `high` are cut off."""

    mean: Annotated[float, Quantity("", "mean before the tails are cut off")]
    sigma: Annotated[Positive, Quantity("", "standard deviation before the tails are cut off")]
    low: Annotated[float, Quantity("", "least value")]
    high: Annotated[float, Quantity("", "largest value")]

    kind: ClassVar = "normal"
    rules: ClassVar = (
        *Bounded.rules,
        Rule(
            ("mean", "low", "high"),
            lambda drawn: drawn.low <= drawn.mean <= drawn.high,
            lambda drawn, _: f"must be {drawn.low:g} to {drawn.high:g} (low to high)",
        ),
    )

    def quantile(self, share: float) -> float:
        """The value that a `share` (0 to 1) of all draws do not exceed."""
        from scipy.special import ndtr, ndtri

        below, upto = (float(ndtr((end - self.mean) / self.sigma)) for end in self.ends)
        value = self.mean + self.sigma * float(ndtri(below + share * (upto - below)))
        return min(max(value, self.low), self.high)


@dataclass(frozen=True)
class Choice(Distribution):
    """One of some values, each equally likely."""

    values: Annotated[tuple[Value, ...], Quantity("", "the values")]

    kind: ClassVar = "choice"

    def quantile(self, share: float) -> Value:
        """The value at a `share` (0 to 1) of the list."""
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]

    @property
    def ends(self) -> tuple[Value, ...]:
        """All of them."""
        return self.values


DISTRIBUTIONS: Registry[Distribution] = Registry("distribution", Uniform, LogUniform, Normal, Choice)
"""Every distribution by its kind."""
