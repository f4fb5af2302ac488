"""Statistics as every storage and every comparison wants them: finite, also where nothing was measured."""

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.ensembles.result import Statistic

UNMEASURED = 1e9
"""What stands for a statistic of no completed scenario, and the largest magnitude of any other."""


def measured(statistic: Statistic, values: NDArray[np.float64]) -> float:
    """A statistic over the figure of merit of completed scenarios (n,); `UNMEASURED`, at its bad end, without any."""
    found = statistic.over(values)
    if np.isnan(found):
        return -UNMEASURED if statistic.small_is_bad else UNMEASURED
    return float(np.clip(found, -UNMEASURED, UNMEASURED))
