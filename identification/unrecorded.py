"""What acts on a machine or its sensors and is in no log: Gauss–Markov processes, estimated along with the motion."""

from dataclasses import dataclass, fields
from typing import Annotated

from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.scalar import Scalar
from dualwinch.model.vehicle import friction
from dualwinch.simulation.experiment import Experiment


@dataclass(frozen=True)
class Unrecorded:
    """State of all of them."""

    current: Annotated[Scalar, Quantity("m/s", "ambient current along the track")] = 0.0
    normal_force_variation: Annotated[Scalar, Quantity("N", "change of the force on the rail")] = 0.0
    force: Annotated[Scalar, Quantity("N", "further force on the vehicle along the track")] = 0.0
    torque_1: Annotated[Scalar, Quantity("N m", "further torque of motor 1")] = 0.0
    torque_2: Annotated[Scalar, Quantity("N m", "further torque of motor 2")] = 0.0
    position_drift: Annotated[Scalar, Quantity("m", "drift of the position sensor")] = 0.0


NAMES = tuple(field.name for field in fields(Unrecorded))

FORCE_TIME, TORQUE_TIME = 1.0, 0.05
"""Correlation times in s of what nobody has described: forces of the sea, and what motors and gears do."""


@dataclass(frozen=True)
class Scatter:
    """How far something unrecorded strays, and for how long.

    Attributes:
        deviation: standard deviation in the long run, in its unit.
        time: correlation time in s.
    """

    deviation: float
    time: float


def described(experiment: Experiment) -> dict[str, Scatter]:
    """What an experiment says of the unrecorded: name → scatter; what it does not describe is only just not zero.

    Nothing is exactly zero: then no reading could ever move it, nor show that it is there.
    """
    disturbance, vehicle, sensors = experiment.disturbance, experiment.plant.vehicle, experiment.sensors
    return {
        "current": Scatter(disturbance.current_sigma, disturbance.current_time),
        "normal_force_variation": Scatter(
            disturbance.normal_force_sigma * vehicle.normal_force, disturbance.normal_force_time
        ),
        "force": Scatter(1e-4 * max(float(friction(1.0, vehicle)), 1.0), FORCE_TIME),
        "torque_1": Scatter(1e-3, TORQUE_TIME),
        "torque_2": Scatter(1e-3, TORQUE_TIME),
        "position_drift": Scatter(sensors.position_drift, sensors.position_drift_time),
    }
