"""One row of a result: everything a user may want to see of one sample."""

from dataclasses import dataclass
from typing import Annotated

from dualwinch.controllers.signals import ControllerOutput
from dualwinch.model.plant import Environment, Plant, PlantState, vehicle_acceleration
from dualwinch.model.quantity import Quantity, describe, leaves
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar
from dualwinch.model.vehicle import drag, friction, inertia


@dataclass(frozen=True)
class Row:
    """One row of a result: the state at the beginning of a sample and what was computed from it."""

    t: Annotated[Scalar, Quantity("s", "time of the sample's beginning")]
    x: Annotated[Scalar, Quantity("m", "position of the vehicle")]
    v: Annotated[Scalar, Quantity("m/s", "speed of the vehicle")]
    theta_1: Annotated[Scalar, Quantity("rad", "angle of drum 1")]
    omega_1: Annotated[Scalar, Quantity("rad/s", "speed of drum 1")]
    theta_2: Annotated[Scalar, Quantity("rad", "angle of drum 2")]
    omega_2: Annotated[Scalar, Quantity("rad/s", "speed of drum 2")]
    x_ref: Annotated[Scalar, Quantity("m", "reference position")]
    v_ref: Annotated[Scalar, Quantity("m/s", "reference speed")]
    a_ref: Annotated[Scalar, Quantity("m/s^2", "reference acceleration")]
    e: Annotated[Scalar, Quantity("m", "tracking error x - x_ref")]
    F1: Annotated[Scalar, Quantity("N", "tension of rope 1")]
    F2: Annotated[Scalar, Quantity("N", "tension of rope 2")]
    F1_cmd: Annotated[Scalar, Quantity("N", "tension command of rope 1")]
    F2_cmd: Annotated[Scalar, Quantity("N", "tension command of rope 2")]
    u: Annotated[Scalar, Quantity("N", "force command before saturation")]
    u_sat: Annotated[Scalar, Quantity("N", "force command within the limits")]
    d_hat: Annotated[Scalar, Quantity("m/s^2", "estimated disturbance acceleration")]
    d_true: Annotated[Scalar, Quantity("m/s^2", "acceleration the nominal model does not explain")]
    L1: Annotated[Scalar, Quantity("1/s", "observer gain")]
    Z_a: Annotated[Scalar, Quantity("N s", "state of the anti-saturation system")]
    s: Annotated[Scalar, Quantity("m", "sliding variable")]
    tau1: Annotated[Scalar, Quantity("N m", "motor torque command of winch 1")]
    tau2: Annotated[Scalar, Quantity("N m", "motor torque command of winch 2")]


COLUMNS = {leaf.key: leaf.quantity for leaf in describe(Row).values()}
"""Column name → quantity, in the order of a result file."""


def row_of(
    t: Scalar,
    state: PlantState,
    forces: tuple[Scalar, Scalar],
    reference: Setpoint,
    said: ControllerOutput,
    environment: Environment,
    plant: Plant,
    nominal: Plant,
) -> dict[str, Scalar]:
    """The row of one sample by column name, without what the controller lacks.

    ``d_true`` is the acceleration the nominal model leaves unexplained, given the true tensions: what the observer
    should find. With a perfect nominal model it is the disturbance force over the mass.

    Args:
        t: time in s.
        state: the plant's state.
        forces: tensions in N.
        reference: where the vehicle should be.
        said: what the controller said.
        environment: what acts on the vehicle from outside.
        plant: the plant.
        nominal: the plant as the controller believes it to be.
    """
    F1, F2 = forces
    acceleration = vehicle_acceleration(state.v, F1 - F2, environment, plant.vehicle)
    believed_resistance = friction(state.v, nominal.vehicle) + drag(state.v, nominal.vehicle)
    believed = (F1 - F2 - believed_resistance) / inertia(nominal.vehicle)
    row = Row(
        t=t,
        **leaves(state),
        x_ref=reference.x,
        v_ref=reference.v,
        a_ref=reference.a,
        e=state.x - reference.x,
        F1=F1,
        F2=F2,
        F1_cmd=said.F1_cmd,
        F2_cmd=said.F2_cmd,
        **leaves(said.position),
        d_true=acceleration - believed,
        tau1=said.tau1,
        tau2=said.tau2,
    )
    return {key: value for key, value in leaves(row).items() if value is not None}
