"""Steady cruise: the motion in which speed, tensions and drum speeds stay constant; at rest, equilibrium.

The length of rope between winch and vehicle changes as the vehicle moves, and with it the spring rate E A / length. A
tension stays constant if the *strain* does: with the stretch ``s = strain * length`` and ``F = E A / length * s + c
ds/dt``, the strain is ``F / (E A + c dlength/dt)``. So a drum turns a little slower than the vehicle moves, by the
share ``strain`` of the speed. (Were drum and vehicle equally fast, the tension would rise by ``F v / length`` newtons
a second.) This is an exact solution of the plant, not an approximation; only position and drum angles change along it.
What ropes of other laws do in a cruise, `RopeLaw.steady_stretch` says.
"""

from typing import NamedTuple

from dualwinch.model.plant import Environment, Plant, PlantState, Torques
from dualwinch.model.ropes.track import rope_lengths
from dualwinch.model.scalar import Scalar, absolute, maximum, minimum
from dualwinch.model.vehicle import drag, friction
from dualwinch.model.winch import friction_torque, shaft_torque
from dualwinch.model.winding import angle_of, winding

PRELOAD = 2000.0
"""Sum of both tensions in N (paper Section 4.1)."""

TENSION_MIN, TENSION_MAX = 200.0, 6000.0
"""Limits of a tension in N (Table 1)."""


class SteadyCruise(NamedTuple):
    """State and input at one instant of a steady cruise, with the tensions in N."""

    state: PlantState
    torques: Torques
    F1: Scalar
    F2: Scalar


def resistance(v: Scalar, environment: Environment, plant: Plant) -> Scalar:
    """Net rope force F1 − F2 in N that keeps the speed v in m/s: friction, drag and disturbance (paper Section 2.3)."""
    opposing = friction(v, plant.vehicle, environment.normal_force_variation)
    return opposing + drag(v - environment.current, plant.vehicle) - environment.force


def shared_tensions(net: Scalar, preload: Scalar, tension_min: Scalar, tension_max: Scalar) -> tuple[Scalar, Scalar]:
    """Tensions F1 and F2 in N with the difference `net` (paper Section 3.2).

    Their sum is the preload. Where that takes a tension across a limit, the other rope takes over: the sum is as near
    to the preload as the limits allow. A net force beyond ``tension_max - tension_min`` leaves one tension at
    tension_min and the other above tension_max.
    """
    total = maximum(minimum(preload, 2 * tension_max - absolute(net)), 2 * tension_min + absolute(net))
    return (total + net) / 2, (total - net) / 2


def steady_cruise(x: Scalar, v: Scalar, tensions: tuple[Scalar, Scalar], plant: Plant) -> SteadyCruise:
    """State and torques of the steady cruise that passes x in m at v in m/s, with the tensions F1 and F2 in N.

    The environment is held constant; its forces enter through the tensions. On a drum whose radius changes with its
    angle the motion is steady for that instant.
    """
    length_1, length_2 = rope_lengths(x, plant.track)
    stretch_1, slope_1 = plant.rope_1.steady_stretch(tensions[0], length_1, -v)
    stretch_2, slope_2 = plant.rope_2.steady_stretch(tensions[1], length_2, v)
    theta_1, theta_2 = angle_of(stretch_1 + x, plant.winch_1), angle_of(stretch_2 - x, plant.winch_2)
    radius_1, radius_2 = winding(theta_1, plant.winch_1).radius, winding(theta_2, plant.winch_2).radius
    omega_1 = v * (1 - slope_1) / radius_1
    omega_2 = -v * (1 - slope_2) / radius_2
    state = PlantState(
        x=x,
        v=v,
        theta_1=theta_1,
        omega_1=omega_1,
        theta_2=theta_2,
        omega_2=omega_2,
    )
    torque_1 = (radius_1 * tensions[0] + friction_torque(omega_1, plant.winch_1)) / plant.winch_1.gear_ratio
    torque_2 = (radius_2 * tensions[1] + friction_torque(omega_2, plant.winch_2)) / plant.winch_2.gear_ratio
    torques = Torques(
        tau_1=torque_1 / shaft_torque(1.0, theta_1, plant.winch_1),
        tau_2=torque_2 / shaft_torque(1.0, theta_2, plant.winch_2),
    )
    return SteadyCruise(state, torques, *tensions)
