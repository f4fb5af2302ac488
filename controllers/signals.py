"""What a control law sees and what it says."""

from dataclasses import dataclass
from typing import Annotated

from dualwinch.model.quantity import Quantity
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
class Seen(Measurement):
    """What a position law sees: sensor values, position and speed maybe estimated, and a known disturbance."""

    d: Annotated[Scalar, Quantity("m/s^2", "disturbance acceleration that the estimator knows")] = 0.0


@dataclass(frozen=True)
class PositionOutput:
    """What a position law says; ``None`` for what it does not have."""

    u: Annotated[Scalar, Quantity("N", "force command of the position law before saturation")]
    u_sat: Annotated[Scalar, Quantity("N", "force command within the limits")]
    d_hat: Annotated[Scalar, Quantity("m/s^2", "estimated disturbance acceleration")] = None
    L1: Annotated[Scalar, Quantity("1/s", "observer gain")] = None
    Z_a: Annotated[Scalar, Quantity("N s", "state of the anti-saturation system")] = None
    s: Annotated[Scalar, Quantity("m", "sliding variable")] = None


@dataclass(frozen=True)
class ControllerOutput:
    """What the whole controller says in one sample."""

    position: PositionOutput
    F1_cmd: Annotated[Scalar, Quantity("N", "tension command of rope 1")]
    F2_cmd: Annotated[Scalar, Quantity("N", "tension command of rope 2")]
    tau1: Annotated[Scalar, Quantity("N m", "motor torque of winch 1")]
    tau2: Annotated[Scalar, Quantity("N m", "motor torque of winch 2")]
    saturated: Annotated[Scalar, Quantity("1", "1 where the force command is beyond its limit")]
    torque_saturated: Annotated[Scalar, Quantity("1", "1 where a motor torque is at its limit")]
