"""A distribution as a user writes it."""

import math
from dataclasses import dataclass
from typing import ClassVar

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.ensembles.ensemble import Distribution


@dataclass(frozen=True)
class Triangular(Distribution):
    """Between `low` and `high`, most likely near `mode`."""

    low: float
    mode: float
    high: float

    kind: ClassVar = "triangular"

    def __post_init__(self) -> None:
        if not self.low < self.mode < self.high:
            raise ConfigurationError(f"mode = {self.mode:g}: must be between low and high")

    def quantile(self, share: float) -> float:
        rising, falling, width = self.mode - self.low, self.high - self.mode, self.high - self.low
        if share < rising / width:
            return self.low + math.sqrt(share * rising * width)
        return self.high - math.sqrt((1 - share) * falling * width)

    @property
    def ends(self) -> tuple[float, float]:
        return self.low, self.high
