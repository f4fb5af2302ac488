"""Whether two that took part differ: paired ratios of their errors, and a rule that is fixed before anybody runs.

Errors of the same scenario share its sea, noise and machine, so that it is their ratio that tells the two apart. Ratios
multiply: their logarithms are averaged. The interval is Student's; with many pairs some would differ by chance, so that
the levels are Holm's (Scand. J. Statist. 6, 1979).
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.ensembles.comparison import CONFIDENCE, Interval

Floats = NDArray[np.float64]

LEAST_DIFFERENCE = 0.05
"""Share by which errors have to differ to count."""

RULE = (
    f"Two differ where the geometric mean of the ratios of their mean square errors, scenario by scenario, is off 1 by "
    f"more than {100 * LEAST_DIFFERENCE:g} %, and a t-test of the ratios' logarithms rejects 1 at "
    f"{100 * (1 - CONFIDENCE):.0f} % with Holm's correction over all pairs; and where they were tuned more than once, "
    "only if every search of the one is ahead of every search of the other."
)
"""When two differ, in words."""


@dataclass(frozen=True)
class ErrorRatio:
    """How the errors of two compare, over the scenarios that both ran to their end.

    Attributes:
        scenarios: number of those.
        interval: geometric mean of the ratios, with its 95 % interval; NaN without scenarios.
        p: probability of a geometric mean at least as far from 1 by chance; 1 with fewer than two scenarios.
    """

    scenarios: int
    interval: Interval
    p: float

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        interval = {name: finite_or_none(value) for name, value in asdict(self.interval).items()}
        return {**interval, "scenarios": self.scenarios, "p": self.p}


@dataclass(frozen=True)
class PairComparison:
    """Two that took part.

    Attributes:
        first, second: their keys.
        ratio: errors of the first over those of the second.
        corrected: `ErrorRatio.p` with Holm's correction over all pairs.
        apart: whether every search of the one is ahead of every search of the other.
    """

    first: str
    second: str
    ratio: ErrorRatio
    corrected: float
    apart: bool = True

    @property
    def differ(self) -> bool:
        """What `RULE` says."""
        sure = self.apart and self.corrected < 1 - CONFIDENCE
        return sure and abs(math.log(self.ratio.interval.estimate)) > -math.log(1 - LEAST_DIFFERENCE)


def finite_or_none(value: float) -> float | None:
    """A number as JSON holds it: none where it is not finite."""
    return value if math.isfinite(value) else None


def ratio_of(values: Floats, references: Floats) -> ErrorRatio:
    """How paired errors compare.

    Args:
        values: (pairs,) positive.
        references: (pairs,) positive, of the same scenarios.
    """
    from scipy.stats import t as student

    count = len(values)
    if not count:
        return ErrorRatio(0, Interval(math.nan, math.nan, math.nan), 1.0)
    logarithms = np.log(values / references)
    mean = float(logarithms.mean())
    if count == 1:
        return ErrorRatio(1, Interval(math.exp(mean), 0.0, math.inf), 1.0)
    error = float(logarithms.std(ddof=1)) / math.sqrt(count)
    reach = float(student.ppf(0.5 + CONFIDENCE / 2, count - 1)) * error
    p = 2 * float(student.sf(abs(mean) / error, count - 1)) if error else float(mean == 0)
    return ErrorRatio(count, Interval(math.exp(mean), math.exp(mean - reach), math.exp(mean + reach)), p)


def holm(levels: Sequence[float]) -> list[float]:
    """Levels of several tests, corrected so that the chance of any false rejection is the one asked for."""
    corrected, least = [1.0] * len(levels), 0.0
    for rank, index in enumerate(sorted(range(len(levels)), key=lambda index: levels[index])):
        least = max(least, min(1.0, (len(levels) - rank) * levels[index]))
        corrected[index] = least
    return corrected
