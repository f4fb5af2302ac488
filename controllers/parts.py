"""Interfaces of the three parts of a controller: base classes, signals between them, and context.

A part may return more than the next one needs: a subclass of its output with further annotated fields. These become
columns of a result, under their own names.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, Any

from dualwinch.controllers.limits import Limits
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.part import Part
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class Measurement:
    """Sampled sensor values."""

    x: Annotated[Scalar, Quantity("m", "measured position")]
    v: Annotated[Scalar, Quantity("m/s", "measured speed")]
    F1: Annotated[Scalar, Quantity("N", "measured tension of rope 1")]
    F2: Annotated[Scalar, Quantity("N", "measured tension of rope 2")]
    omega_1: Annotated[Scalar, Quantity("rad/s", "measured speed of drum 1, positive where it retrieves rope")]
    omega_2: Annotated[Scalar, Quantity("rad/s", "measured speed of drum 2, positive where it retrieves rope")]
    theta_1: Annotated[Scalar, Quantity("rad", "measured angle of drum 1, positive where it has retrieved rope")]
    theta_2: Annotated[Scalar, Quantity("rad", "measured angle of drum 2, positive where it has retrieved rope")]


@dataclass(frozen=True)
class Estimate(Measurement):
    """Output of an estimator: sensor values, with estimated position and speed, and the known disturbance."""

    d: Annotated[Scalar, Quantity("m/s^2", "disturbance acceleration that the estimator knows")] = 0.0


@dataclass(frozen=True)
class PositionOutput:
    """Output of a position law."""

    u: Annotated[Scalar, Quantity("N", "force command of the position law before saturation")]
    u_sat: Annotated[Scalar, Quantity("N", "force command within the limits")]


@dataclass(frozen=True)
class CoordinationOutput:
    """Output of a coordination."""

    F1_cmd: Annotated[Scalar, Quantity("N", "tension command of rope 1")]
    F2_cmd: Annotated[Scalar, Quantity("N", "tension command of rope 2")]
    tau_1: Annotated[Scalar, Quantity("N m", "motor torque command of winch 1")]
    tau_2: Annotated[Scalar, Quantity("N m", "motor torque command of winch 2")]
    torque_saturated: Annotated[Scalar, Quantity("1", "1 where a motor torque is at its limit")]


@dataclass(frozen=True)
class Context:
    """Data available to every part in addition to its gains.

    Attributes:
        nominal: the nominal plant.
        limits: preload and limits of the tensions.
        sample_time: in s.
    """

    nominal: Plant
    limits: Limits
    sample_time: Scalar


class ControllerPart(ABC):
    """Base of all parts of a controller; their steps take floats or CasADi symbols.

    A step's first argument is the state after the last sample, its last two are this sample's `setpoint` (reference
    position, speed and acceleration) and the `context`. It returns the next state and the output.
    """

    @property
    def preview(self) -> tuple[float, ...]:
        """Times in s ahead that the step uses in ``setpoint.ahead``; they may depend on fields that shape code."""
        return ()

    @abstractmethod
    def initial_state(self) -> Any:
        """State before the first sample: a dataclass of floats, vectors and matrices, which may depend on the gains."""


class Estimator(ControllerPart, Part):
    """From sensor values to the motion for the position law: a frozen dataclass of its gains.

    An estimator names the sensors that it can do without in `silent`. Their values may be missing: NaN, or beyond
    `codegen.block.NO_READING` in magnitude, in exported controllers too.
    """

    @property
    def silent(self) -> frozenset[str]:
        """Names of measurements that may be missing."""
        return frozenset()

    @abstractmethod
    def step(self, state: Any, measurement: Measurement, setpoint: Setpoint, context: Context) -> tuple[Any, Estimate]:
        """One sample: the next state, and the estimate from this sample's sensor values."""

    def informed(
        self, state: Any, measurement: Measurement, plant: Plant, speed_error: Scalar, context: Context
    ) -> Any:
        """The state if everything that the estimator learns (`Mark.LEARNT`) were known, for analysis of the loop.

        An estimator that learns constants of the machine overrides this; by default they stay as they are.

        Args:
            state: a state of the estimator.
            measurement: sensor values at the same instant, without noise.
            plant: the machine, with its true constants; those of its data sheet are in ``context.nominal``.
            speed_error: share by which the speed sensor reads too much.
            context: nominal plant, limits and sample time.
        """
        return state


class PositionLaw(ControllerPart, Part):
    """From estimated motion and setpoint to a force on the vehicle: a frozen dataclass of the law's gains."""

    @abstractmethod
    def step(self, state: Any, estimate: Estimate, setpoint: Setpoint, context: Context) -> tuple[Any, PositionOutput]:
        """One sample: the next state, and the force in N before saturation and within ± ``context.limits.force``."""


class Coordination(ControllerPart, Part):
    """From the position law's force to the torques of both winches: a frozen dataclass of its gains."""

    @abstractmethod
    def step(
        self, state: Any, force: Scalar, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[Any, CoordinationOutput]:
        """One sample: the next state, and tension commands in N with motor torques in N m.

        The commanded net force of the ropes in N is within ± ``context.limits.force``. The estimate of this sample has
        the measured tensions.
        """
