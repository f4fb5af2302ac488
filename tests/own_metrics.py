"""Figures of merit as a user writes them."""

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import annotated_types as at
import casadi as ca
import numpy as np

from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.scalar import Scalar, absolute, maximum, where
from dualwinch.simulation.metrics.metric import Metric
from dualwinch.simulation.rows import Sample


@dataclass(frozen=True)
class LastBeyond(Metric):
    """When the error was last beyond a band: one number, which is the figure of merit itself."""

    band: Annotated[float, at.Gt(0), Quantity("m", "half width of the band")] = 1e-3

    kind: ClassVar = "last-beyond"
    quantity: ClassVar = Quantity("s", "time at which the error was last beyond the band")

    def initial_state(self) -> float:
        return 0.0

    def step(self, state: Scalar, sample: Sample, sample_time: Scalar) -> Scalar:  # noqa: ARG002
        return where(absolute(sample.error) > self.band, sample.t, state)


@dataclass(frozen=True)
class Sums:
    pull: Annotated[Scalar, Quantity("N s", "integral of the pull")] = 0.0
    moments: Any = field(default_factory=lambda: np.zeros(2))


@dataclass(frozen=True)
class PullSpread(Metric):
    """Standard deviation of the net rope force, with a vector among its states and NumPy in its value."""

    kind: ClassVar = "pull-spread"
    quantity: ClassVar = Quantity("N", "standard deviation of F1 - F2")

    def initial_state(self) -> Sums:
        return Sums()

    def step(self, state: Sums, sample: Sample, sample_time: Scalar) -> Sums:
        pull = sample.F1 - sample.F2
        return Sums(state.pull + sample_time * pull, state.moments + ca.vertcat(pull, pull**2))

    def value(self, state: Sums, samples: Any) -> Any:
        first, second = state.moments / samples
        return np.sqrt(np.maximum(second - first**2, 0.0))


@dataclass(frozen=True)
class Room(Metric):
    """The least distance of both torques from a limit: small is bad."""

    limit: Annotated[float, at.Gt(0), Quantity("N m", "limit of a motor torque")] = 133.0
    weight: Annotated[float, at.Ge(0), Quantity("1", "factor in the value")] = 1.0

    kind: ClassVar = "room"
    quantity: ClassVar = Quantity("N m", "least distance of the motor torques from their limit")
    small_is_bad: ClassVar = True

    def initial_state(self) -> float:
        return 0.0

    def step(self, state: Scalar, sample: Sample, sample_time: Scalar) -> Scalar:  # noqa: ARG002
        return maximum(state, maximum(sample.torque_1, sample.torque_2))

    def value(self, state: Any, samples: Any) -> Any:  # noqa: ARG002
        return self.weight * (self.limit - np.abs(state))
