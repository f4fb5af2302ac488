"""What the parts of a controller pass on to each other.

A part may say more than the next one needs: a subclass of its output with further annotated fields. They become
columns of a result, under their own names.
"""

from dataclasses import dataclass
from typing import Annotated

from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class Measurement:
    """Sampled sensor values."""

    x: Annotated[Scalar, Quantity("m", "measured position")]
    v: Annotated[Scalar, Quantity("m/s", "measured speed")]
    F1: Annotated[Scalar, Quantity("N", "measured tension of rope 1")]
    F2: Annotated[Scalar, Quantity("N", "measured tension of rope 2")]
    omega_1: Annotated[Scalar, Quantity("rad/s", "measured speed of drum 1")]
    omega_2: Annotated[Scalar, Quantity("rad/s", "measured speed of drum 2")]
    theta_1: Annotated[Scalar, Quantity("rad", "measured angle of drum 1")]
    theta_2: Annotated[Scalar, Quantity("rad", "measured angle of drum 2")]


@dataclass(frozen=True)
class Estimate(Measurement):
    """What an estimator gives: sensor values, position and speed maybe better ones, and a known disturbance."""

    d: Annotated[Scalar, Quantity("m/s^2", "disturbance acceleration that the estimator knows")] = 0.0


@dataclass(frozen=True)
class PositionOutput:
    """What a position law gives."""

    u: Annotated[Scalar, Quantity("N", "force command of the position law before saturation")]
    u_sat: Annotated[Scalar, Quantity("N", "force command within the limits")]


@dataclass(frozen=True)
class CoordinationOutput:
    """What a coordination gives."""

    F1_cmd: Annotated[Scalar, Quantity("N", "tension command of rope 1")]
    F2_cmd: Annotated[Scalar, Quantity("N", "tension command of rope 2")]
    tau_1: Annotated[Scalar, Quantity("N m", "motor torque command of winch 1")]
    tau_2: Annotated[Scalar, Quantity("N m", "motor torque command of winch 2")]
    torque_saturated: Annotated[Scalar, Quantity("1", "1 where a motor torque is at its limit")]


@dataclass(frozen=True)
class ControllerOutput:
    """What the whole controller gives in one sample."""

    estimate: Estimate
    position: PositionOutput
    winches: CoordinationOutput

    @property
    def saturated(self) -> Scalar:
        """1 where the force command is beyond its limit."""
        return self.position.u_sat != self.position.u
