"""What one sample of the closed loop offers to figures of merit."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar
from dualwinch.simulation.loop.row import Row


@dataclass(frozen=True)
class Sample(Row):
    """One sample: every column of a result (`simulation.loop.row.Row`) under its name, and what is no column.

    Everything is a scalar: a symbol where the loop is built.
    """

    number: Annotated[Scalar, Quantity("1", "number of the sample, from 0")]
    torque_1: Annotated[Scalar, Quantity("N m", "torque of motor 1, late by the delay, as its actuator gives it")]
    torque_2: Annotated[Scalar, Quantity("N m", "torque of motor 2, late by the delay, as its actuator gives it")]
    power: Annotated[Scalar, Quantity("W", "power of both motors, braking counted like driving")]
    saturated: Annotated[Scalar, Quantity("1", "1 where the force command is beyond its limit")]
    torque_saturated: Annotated[Scalar, Quantity("1", "1 where a motor torque is at its limit")]
    steady: Annotated[Scalar, Quantity("1", "1 in the steady-state window")]
    signals: Annotated[Mapping[str, Scalar], Mark.CONTENT]
    """Signals of the controller's own parts, by the names of their columns."""

    @property
    def error(self) -> Scalar:
        """Tracking error in m, x − x_ref in the frame of the position sensor: its bias does not count."""
        return self.e

    @property
    def reference(self) -> Setpoint:
        """Where the vehicle should be: x in m, v in m/s, a in m/s²."""
        return Setpoint(self.x_ref, self.v_ref, self.a_ref)
