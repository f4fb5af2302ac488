"""Distributions a value of an experiment can be drawn from.

A distribution is its quantile function: one uniform draw between 0 and 1 decides the value. Values that share the
draw move together, and another way to spread the draws (a low-discrepancy sequence, say) needs nothing new here.

SciPy's frozen distributions (``scipy.stats.truncnorm(...).ppf``) give the same values to round-off, but take a hundred
times as long for each of them, and a second to import.
"""

from dataclasses import dataclass
from typing import Protocol, TypeAlias

Value: TypeAlias = float | int | bool | str
"""A value of an experiment."""


class Distribution(Protocol):
    """What a value is drawn from."""

    def quantile(self, share: float) -> Value:
        """The value that a `share` (0 to 1) of all draws do not exceed."""
        ...

    @property
    def ends(self) -> tuple[Value, ...]:
        """The values that show whether every draw is allowed: both bounds, or all choices."""
        ...


@dataclass(frozen=True)
class Uniform:
    """Equally likely anywhere from `low` to `high`."""

    low: float
    high: float

    def quantile(self, share: float) -> float:
        """The value that a `share` (0 to 1) of all draws do not exceed."""
        return self.low + share * (self.high - self.low)

    @property
    def ends(self) -> tuple[float, float]:
        """Both bounds."""
        return self.low, self.high


@dataclass(frozen=True)
class Normal:
    """Normal around `mean` with the standard deviation `sigma` before the tails beyond `low` and `high` are cut off."""

    mean: float
    sigma: float
    low: float
    high: float

    def quantile(self, share: float) -> float:
        """The value that a `share` (0 to 1) of all draws do not exceed."""
        from scipy.special import ndtr, ndtri

        below, upto = (float(ndtr((end - self.mean) / self.sigma)) for end in self.ends)
        value = self.mean + self.sigma * float(ndtri(below + share * (upto - below)))
        return min(max(value, self.low), self.high)

    @property
    def ends(self) -> tuple[float, float]:
        """Both bounds."""
        return self.low, self.high


@dataclass(frozen=True)
class Choice:
    """One of some values, each equally likely."""

    values: tuple[Value, ...]

    def quantile(self, share: float) -> Value:
        """The value at a `share` (0 to 1) of the list."""
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]

    @property
    def ends(self) -> tuple[Value, ...]:
        """All of them."""
        return self.values
