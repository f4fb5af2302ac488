"""What a view of a run needs to know of it."""

from collections.abc import Iterator, Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.quantities.quantity import Quantity
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metrics import Metrics


class RunLike(Protocol):
    """A run as `simulation.results.result.Result` holds it; see there."""

    @property
    def columns(self) -> Mapping[str, NDArray[np.float64]]: ...  # noqa: D102
    @property
    def quantities(self) -> Mapping[str, Quantity]: ...  # noqa: D102
    @property
    def units(self) -> Mapping[str, str]: ...  # noqa: D102
    @property
    def interpolation(self) -> Mapping[str, str]: ...  # noqa: D102
    @property
    def metrics(self) -> Metrics: ...  # noqa: D102
    @property
    def outcome(self) -> str: ...  # noqa: D102
    @property
    def end_time(self) -> float: ...  # noqa: D102
    @property
    def experiment(self) -> Experiment: ...  # noqa: D102
    def __getitem__(self, column: str) -> NDArray[np.float64]: ...
    def __iter__(self) -> Iterator[str]: ...
