"""What is read of a machine at a sample, without noise and steps."""

from dataclasses import dataclass, fields
from typing import Annotated

from dualwinch.model.plant import Plant, PlantState, tensions
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.scalar import Scalar
from dualwinch.simulation.sensors import Sensors


@dataclass(frozen=True)
class Sensed:
    """Readings that a log may hold; those that it lacks are never looked at."""

    x: Annotated[Scalar, Quantity("m", "position of the vehicle")]
    v: Annotated[Scalar, Quantity("m/s", "speed of the vehicle")]
    F1: Annotated[Scalar, Quantity("N", "load cell of rope 1")]
    F2: Annotated[Scalar, Quantity("N", "load cell of rope 2")]
    theta_1: Annotated[Scalar, Quantity("rad", "encoder of drum 1, angle")]
    theta_2: Annotated[Scalar, Quantity("rad", "encoder of drum 2, angle")]
    omega_1: Annotated[Scalar, Quantity("rad/s", "speed of drum 1")]
    omega_2: Annotated[Scalar, Quantity("rad/s", "speed of drum 2")]


READINGS = tuple(field.name for field in fields(Sensed))


def sensed(state: PlantState, t: Scalar, plant: Plant, sensors: Sensors, drift: Scalar = 0.0) -> Sensed:
    """What the sensors would read, were they without noise and steps.

    Args:
        state: the plant's.
        t: time in s.
        plant: gives tensions and drum radii.
        sensors: their zeros and scales.
        drift: of the position sensor in m.
    """
    F1, F2 = tensions(state, plant, t)
    return Sensed(
        x=state.x + sensors.position_bias + drift,
        v=state.v,
        F1=(1 + sensors.load_cell_error_1) * F1 + sensors.load_cell_zero_1,
        F2=(1 + sensors.load_cell_error_2) * F2 + sensors.load_cell_zero_2,
        theta_1=state.theta_1 + sensors.encoder_zero_1 / plant.winch_1.drum_radius,
        theta_2=state.theta_2 + sensors.encoder_zero_2 / plant.winch_2.drum_radius,
        omega_1=state.omega_1,
        omega_2=state.omega_2,
    )
