"""Rows of a result, and the signals of a sample from which figures of merit are computed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from dualwinch.controllers.controller import ControllerOutput, own_signals
from dualwinch.controllers.parts import Measurement
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import (
    DisturbanceInputs,
    InnerSignals,
    Plant,
    PlantState,
    Torques,
    inner_signals,
    rope_pulls,
    towed_vehicle,
)
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar
from dualwinch.model.vehicle import drag, friction, inertia


@dataclass(frozen=True)
class Row:
    """One row of a result: the state at the beginning of a sample, and the signals computed from it."""

    t: Annotated[Scalar, Quantity("s", "time of the sample's beginning")]
    x: Annotated[Scalar, Quantity("m", "position of the vehicle")]
    v: Annotated[Scalar, Quantity("m/s", "speed of the vehicle")]
    theta_1: Annotated[Scalar, Quantity("rad", "angle of drum 1")]
    omega_1: Annotated[Scalar, Quantity("rad/s", "speed of drum 1")]
    theta_2: Annotated[Scalar, Quantity("rad", "angle of drum 2")]
    omega_2: Annotated[Scalar, Quantity("rad/s", "speed of drum 2")]
    x_ref: Annotated[Scalar, Quantity("m", "reference position")]
    v_ref: Annotated[Scalar, Quantity("m/s", "reference speed")]
    a_ref: Annotated[Scalar, Quantity("m/s^2", "reference acceleration"), Mark.HELD]
    e: Annotated[Scalar, Quantity("m", "tracking error x - x_ref, in the frame of the position sensor")]
    F1: Annotated[Scalar, Quantity("N", "tension of rope 1")]
    F2: Annotated[Scalar, Quantity("N", "tension of rope 2")]
    F1_cmd: Annotated[Scalar, Quantity("N", "tension command of rope 1"), Mark.HELD]
    F2_cmd: Annotated[Scalar, Quantity("N", "tension command of rope 2"), Mark.HELD]
    u: Annotated[Scalar, Quantity("N", "force command before saturation"), Mark.HELD]
    u_sat: Annotated[Scalar, Quantity("N", "force command within the limits"), Mark.HELD]
    d_true: Annotated[Scalar, Quantity("m/s^2", "acceleration the nominal model does not explain")]
    tau_1: Annotated[Scalar, Quantity("N m", "motor torque command of winch 1"), Mark.HELD]
    tau_2: Annotated[Scalar, Quantity("N m", "motor torque command of winch 2"), Mark.HELD]


@dataclass(frozen=True)
class ActualTorques:
    """Actual motor torques, where they differ from the commands."""

    torque_1: Annotated[Scalar, Quantity("N m", "torque of motor 1, its mean until the next sample"), Mark.HELD]
    torque_2: Annotated[Scalar, Quantity("N m", "torque of motor 2, its mean until the next sample"), Mark.HELD]


READ = "_read"
"""Suffix of columns that hold sensor readings."""

READINGS = {leaf.key + READ: leaf.quantity for leaf in describe(Measurement).values()}
"""Columns of sensor readings, where they are kept."""

COLUMNS = {leaf.key: leaf.quantity for leaf in describe(Row).values()}
"""Columns of every result: name → quantity, in the order of a result file; those of the controller's parts follow."""

INNER = {leaf.key: leaf.quantity for leaf in describe(InnerSignals).values()}
"""Further columns where ropes have mass or weight, or gearboxes are elastic."""

TORQUES = {leaf.key: leaf.quantity for leaf in describe(ActualTorques).values()}
"""Further columns where the actuator is not ideal."""

CONTINUOUS = frozenset(leaf.key for leaf in describe(Row).values() if Mark.HELD not in leaf.marks) | INNER.keys()
"""Columns that vary between two samples; all others, the controller's included, are held until the next sample."""


def row_of(
    t: Scalar,
    state: PlantState,
    forces: tuple[Scalar, Scalar],
    reference: Setpoint,
    output: ControllerOutput,
    environment: DisturbanceInputs,
    plant: Plant,
    nominal: Plant,
    bias: Scalar = 0.0,
    torques: Torques | None = None,
    measurement: Measurement | None = None,
) -> dict[str, tuple[Scalar, Quantity]]:
    """The row of one sample: column name → value and quantity.

    ``d_true`` is the acceleration that the nominal model leaves unexplained, given the true tensions: the value that
    an observer should estimate. With a perfect nominal model it is the disturbance force divided by the mass.

    Time is in s, tensions in N, and the position sensor's bias in m; the tracking error does not include it. `torques`
    are those of the motors, where they differ from the commands; `measurement` is given if rows include readings.

    Raises:
        ConfigurationError: a part of the controller gives a signal the name of an existing column.
    """
    F1, F2 = forces
    pulls = rope_pulls(state, plant, t)
    inner = inner_signals(state, pulls, plant)
    pull = pulls[0].at_vehicle - pulls[1].at_vehicle if inner else F1 - F2
    acceleration, _ = towed_vehicle(state, pull, environment, plant)
    nominal_resistance = friction(state.v, nominal.vehicle) + drag(state.v, nominal.vehicle)
    nominal_acceleration = (F1 - F2 - nominal_resistance) / inertia(nominal.vehicle)
    row = Row(
        t=t,
        **{key: value for key, value in leaves(state).items() if key in COLUMNS},
        x_ref=reference.x,
        v_ref=reference.v,
        a_ref=reference.a,
        e=state.x - reference.x + bias,
        F1=F1,
        F2=F2,
        F1_cmd=output.winches.F1_cmd,
        F2_cmd=output.winches.F2_cmd,
        u=output.position.u,
        u_sat=output.position.u_sat,
        d_true=acceleration - nominal_acceleration,
        tau_1=output.winches.tau_1,
        tau_2=output.winches.tau_2,
    )
    values, signals_of_law, reserved = leaves(row) | inner, own_signals(output), COLUMNS | INNER | TORQUES | READINGS
    if torques is not None:
        values |= leaves(ActualTorques(torques.tau_1, torques.tau_2))
    if measurement is not None:
        values |= {f"{name}{READ}": value for name, value in leaves(measurement).items()}
    conflicts = sorted(signals_of_law.keys() & reserved.keys())
    if conflicts:
        raise ConfigurationError(f"signal '{conflicts[0]}': the name is taken by a column of every result")
    return {key: (value, reserved[key]) for key, value in values.items()} | signals_of_law


@dataclass(frozen=True)
class Sample(Row):
    """One sample: every column of a result (`simulation.rows.Row`) under its name, and further signals.

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
    """Signals of the controller's parts, by column name."""

    @property
    def error(self) -> Scalar:
        """Tracking error in m, x − x_ref in the frame of the position sensor, so without its bias."""
        return self.e

    @property
    def reference(self) -> Setpoint:
        """Where the vehicle should be: x in m, v in m/s, a in m/s²."""
        return Setpoint(self.x_ref, self.v_ref, self.a_ref)
