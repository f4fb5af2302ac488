"""What the peers that run many rollouts in one call are given: candidates for one gain."""

import numpy as np
from numpy.typing import NDArray

from benchmarks.case import Case

ROLLOUTS = 64
"""Rollouts of one timed call."""

GAIN = "controller.observer.l0"
"""The gain that differs."""


def gains(case: Case) -> NDArray[np.float64]:
    """The candidates (ROLLOUTS,), the case's own gain first."""
    return case.named_parameters[GAIN] * np.linspace(1, 2, ROLLOUTS)
