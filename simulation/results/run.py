"""A run as data: named columns with units, figures of merit, an outcome and where it came from."""

from collections.abc import Iterator, KeysView, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.model.errors import UnknownNameError
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.quantity import Quantity, nearest
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metrics import Metrics
from dualwinch.simulation.results.resampling import interpolation


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A run, as a mapping from names to columns.

    Attributes:
        columns: name → (rows,) float64, one row a kept control sample at its beginning: what every run has
            (`simulation.rows.COLUMNS`), and the signals of the controller's own.
        metrics: figures of merit over every sample, kept or not; NaN where the run was not completed.
        outcome: ``completed``, ``diverged`` or ``left_track``.
        end_time: time in s at which the run ended.
        final_state: name → value of every state after the last sample.
        experiment: what was run.
        quantities: name → unit and meaning of every column.
        nominal: the plant the controller was designed for, where that is not the simulated one.
    """

    columns: dict[str, NDArray[np.float64]]
    metrics: Metrics
    outcome: str
    end_time: float
    final_state: dict[str, float]
    experiment: Experiment
    quantities: Mapping[str, Quantity]
    nominal: Plant | None = None

    @property
    def units(self) -> dict[str, str]:
        """Column name → unit."""
        return {name: quantity.unit for name, quantity in self.quantities.items()}

    @property
    def interpolation(self) -> dict[str, str]:
        """Column name → how `resample` fills it in between two rows: ``linear`` or ``held``."""
        return interpolation(self.columns)

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

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Run):
            return NotImplemented
        plain = ("outcome", "end_time", "experiment", "nominal", "quantities")
        return (
            all(getattr(self, name) == getattr(other, name) for name in plain)
            and _same(self.columns, other.columns)
            and self.metrics.quantities == other.metrics.quantities
            and _same(vars(self.metrics), vars(other.metrics))
            and _same(self.final_state, other.final_state)
        )

    __hash__ = None  # pyright: ignore[reportAssignmentType]  # its columns can be written to


def _same(ours: Mapping[str, ArrayLike], theirs: Mapping[str, ArrayLike]) -> bool:
    """Whether numbers by name are the same, in their order; NaN is NaN."""
    return list(ours) == list(theirs) and all(np.array_equal(ours[name], theirs[name], equal_nan=True) for name in ours)
