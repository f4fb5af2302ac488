"""Comparison of two entries by paired ratios of their errors, with a decision rule fixed before any run.

Errors in the same scenario share its sea, noise and machine, so their ratio compares the controllers. The mean of the
ratios is geometric, with Student's interval of the logarithms. Since some of many pairs would differ by chance, levels
are corrected by Holm's method (Scand. J. Statist. 6, 1979).
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import intervals

Floats = NDArray[np.float64]

LEAST_DIFFERENCE = 0.05
"""Smallest relative difference of errors that counts."""

RULE = (
    "Two entries differ if the geometric mean of the ratios of their mean square errors, scenario by scenario, is more "
    f"than {100 * LEAST_DIFFERENCE:g} % from 1, and a t-test of the ratios' logarithms rejects 1 at "
    f"{100 * (1 - intervals.CONFIDENCE):.0f} % with Holm's correction over all pairs; and, with several searches of "
    "each, if every search of the one is ahead of every search of the other."
)
"""The decision rule in words."""


@dataclass(frozen=True)
class ErrorRatio:
    """Ratio of the errors of two entries, over the scenarios that both completed.

    Attributes:
        scenarios: their number.
        interval: geometric mean of the ratios, with its 95 % interval; NaN without scenarios.
        p: p-value of the t-test, that the mean is at least as far from 1 by chance; 1 for fewer than two scenarios.
    """

    scenarios: int
    interval: intervals.Interval
    p: float

    def to_record(self) -> dict[str, Any]:
        """As plain data; `times_below` is the inverse of the ratio, with its interval."""
        interval = {name: finite_or_none(value) for name, value in asdict(self.interval).items()}
        ends = {"estimate": "estimate", "low": "high", "high": "low"}
        below = {name: 1 / ratio if (ratio := interval[end]) else None for name, end in ends.items()}
        return {**interval, "scenarios": self.scenarios, "p": self.p, "times_below": below}


@dataclass(frozen=True)
class PairComparison:
    """Comparison of two entries.

    Attributes:
        first_key, second_key: of the entries.
        ratio: errors of the first over those of the second.
        corrected: `ErrorRatio.p` with Holm's correction over all pairs.
        separated: whether every search of the one is ahead of every search of the other.
    """

    first_key: str
    second_key: str
    ratio: ErrorRatio
    corrected: float
    separated: bool = True

    @property
    def differ(self) -> bool:
        """Whether the entries differ by `RULE`."""
        sure = self.separated and self.corrected < 1 - intervals.CONFIDENCE
        return sure and abs(math.log(self.ratio.interval.estimate)) > -math.log(1 - LEAST_DIFFERENCE)


def finite_or_none(value: float) -> float | None:
    """A number for JSON: ``None`` if it is not finite."""
    return value if math.isfinite(value) else None


def ratio_of(values: Floats, references: Floats) -> ErrorRatio:
    """Geometric mean of the ratios of paired positive errors (pairs,), values over references.

    With Student's interval and p-value of the logarithms.
    """
    from scipy.stats import t as student

    count = len(values)
    if not count:
        return ErrorRatio(0, intervals.Interval(math.nan, math.nan, math.nan), 1.0)
    logarithms = np.log(values / references)
    mean = float(logarithms.mean())
    if count == 1:
        return ErrorRatio(1, intervals.Interval(math.exp(mean), 0.0, math.inf), 1.0)
    error = float(logarithms.std(ddof=1)) / math.sqrt(count)
    reach = float(student.ppf(0.5 + intervals.CONFIDENCE / 2, count - 1)) * error
    p = 2 * float(student.sf(abs(mean) / error, count - 1)) if error else float(mean == 0)
    return ErrorRatio(count, intervals.Interval(math.exp(mean), math.exp(mean - reach), math.exp(mean + reach)), p)


def holm(levels: Sequence[float]) -> list[float]:
    """p-values of several tests with Holm's correction, which bounds the probability of any false rejection."""
    corrected, floor = [1.0] * len(levels), 0.0
    for rank, index in enumerate(sorted(range(len(levels)), key=lambda index: levels[index])):
        floor = max(floor, min(1.0, (len(levels) - rank) * levels[index]))
        corrected[index] = floor
    return corrected
