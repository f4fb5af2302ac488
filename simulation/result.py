"""The result of a run: named columns with units, figures of merit, an outcome and where it came from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.metrics import Metrics
from dualwinch.simulation.loop.row import COLUMNS

UNITS = {name: quantity.unit for name, quantity in COLUMNS.items()}
"""Column name → unit."""


@dataclass(frozen=True)
class Result:
    """One run.

    Attributes:
        columns: name → (rows,) float64, one row a kept control sample at its beginning; NaN where the controller
            lacks the signal. Names and units: `simulation.loop.closed_loop.COLUMNS`.
        metrics: figures of merit over every sample, kept or not.
        outcome: ``completed``, ``diverged`` or ``left_track``.
        end_time: time in s at which the run ended.
        final_state: name → value of every state after the last sample.
        experiment: what was run.
    """

    columns: dict[str, NDArray[np.float64]]
    metrics: Metrics
    outcome: str
    end_time: float
    final_state: dict[str, float]
    experiment: Experiment

    def __getitem__(self, column: str) -> NDArray[np.float64]:
        """One column by its name."""
        return self.columns[column]
