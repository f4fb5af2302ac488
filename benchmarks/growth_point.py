"""One setting of the benchmark of growth, and what it took."""

from collections.abc import Callable
from dataclasses import dataclass, field
from statistics import median


@dataclass
class Point:
    """One setting.

    Attributes:
        series: what grows: ``horizon``, ``hand C, horizon``, ``candidates`` or ``threads``.
        value: how far.
        rollouts: how many one call makes.
        call: runs it once.
        seconds: measured times of a call.
    """

    series: str
    value: float
    rollouts: int
    call: Callable[[], object]
    seconds: list[float] = field(default_factory=list)

    @property
    def middle(self) -> float:
        """Median time of a call in s."""
        return median(self.seconds)
