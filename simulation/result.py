"""The result of a run: named columns with units, figures of merit, an outcome and where it came from."""

from collections.abc import Iterator, KeysView, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import UnknownNameError
from dualwinch.model.quantity import Quantity, nearest
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.metrics import Metrics


@dataclass(frozen=True)
class Result:
    """One run. By name it gives its columns, as a mapping does: ``result["F1"]``, ``"F1" in result``, ``dict(result)``.

    Attributes:
        columns: name → (rows,) float64, one row a kept control sample at its beginning: what every run has
            (`simulation.loop.row.COLUMNS`), and the signals of the controller's own.
        metrics: figures of merit over every sample, kept or not; NaN where the run was not completed.
        outcome: ``completed``, ``diverged`` or ``left_track``.
        end_time: time in s at which the run ended.
        final_state: name → value of every state after the last sample.
        experiment: what was run.
        quantities: name → unit and meaning of every column.
    """

    columns: dict[str, NDArray[np.float64]]
    metrics: Metrics
    outcome: str
    end_time: float
    final_state: dict[str, float]
    experiment: Experiment
    quantities: Mapping[str, Quantity]

    @property
    def units(self) -> dict[str, str]:
        """Column name → unit."""
        return {name: quantity.unit for name, quantity in self.quantities.items()}

    def __getitem__(self, column: str) -> NDArray[np.float64]:
        """One column by its name.

        Raises:
            UnknownNameError: there is no such column; the message names the nearest.
        """
        try:
            return self.columns[column]
        except (KeyError, TypeError):
            raise UnknownNameError(
                f"unknown column {column!r}; did you mean '{nearest(str(column), self.columns)}'?"
            ) from None

    def __contains__(self, column: object) -> bool:
        """Whether there is a column of this name."""
        return column in self.columns

    def __iter__(self) -> Iterator[str]:
        """Names of the columns."""
        return iter(self.columns)

    def keys(self) -> KeysView[str]:
        """Names of the columns."""
        return self.columns.keys()
