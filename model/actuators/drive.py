"""Both motors over one sample, each with an actuator of its own state."""

from typing import Any

from dualwinch.model.actuators.actuator import Actuator, Demand
from dualwinch.model.plant import Plant, PlantState, Torques
from dualwinch.model.quantities.steps import stepped_to_number
from dualwinch.model.scalar import Scalar


def drive(
    states: tuple[Any, Any], asked: Torques, motion: PlantState, plant: Plant, actuator: Actuator, sample_time: Scalar
) -> tuple[tuple[Any, Any], Torques]:
    """Next states of both actuators, and the motor torques until then.

    Args:
        states: as the last sample left them.
        asked: torque commands.
        motion: of the drums at the sample.
        plant: its gears lie between drum and motor.
        actuator: of both motors.
        sample_time: in s.

    Raises:
        ConfigurationError: the actuator's step is none (`model.quantities.steps`).
    """
    ratio_1, ratio_2 = plant.winch_1.gear_ratio, plant.winch_2.gear_ratio
    demand_1 = Demand(asked.tau_1, ratio_1 * motion.theta_1, ratio_1 * motion.omega_1)
    demand_2 = Demand(asked.tau_2, ratio_2 * motion.theta_2, ratio_2 * motion.omega_2)
    state_1, torque_1 = stepped_to_number(actuator, states[0], "torque", demand_1, sample_time)
    state_2, torque_2 = stepped_to_number(actuator, states[1], "torque", demand_2, sample_time)
    return (state_1, state_2), Torques(torque_1, torque_2)
