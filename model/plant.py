"""The coupled plant: vehicle, two ropes, two winches (paper Section 2; signs as in E1–E3)."""

from dataclasses import dataclass, field, replace
from typing import Annotated

import casadi as ca

from dualwinch.model.quantities.part import PartChoice
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.quantities.tree import alike, leaves, numbers, with_leaves
from dualwinch.model.ropes import NEW, ROPES, Creep, Rope, RopeLaw, Track, crept, one_sided, rope_lengths
from dualwinch.model.scalar import Scalar, reciprocals
from dualwinch.model.vehicle import Vehicle, drag, friction, inertia
from dualwinch.model.winch import Winch, angle_of, drum_acceleration, shaft_torque, specified_winch, winding

ROPE_LAW = Quantity("", "law of the rope's tension", "paper Section 2.2")


@dataclass(frozen=True)
class Plant:
    """Everything the plant is made of; the ropes' creep is unknown to any controller."""

    rope_slack: Annotated[
        bool, Quantity("", "ropes go slack and never push; false: the paper's two-sided rope", "A2")
    ] = True
    vehicle: Vehicle = field(default_factory=Vehicle)
    track: Track = field(default_factory=Track)
    rope_1: Annotated[RopeLaw, ROPE_LAW, PartChoice("rope_1.kind", ROPES, "rope_1")] = field(default_factory=Rope)
    rope_2: Annotated[RopeLaw, ROPE_LAW, PartChoice("rope_2.kind", ROPES, "rope_2")] = field(default_factory=Rope)
    winch_1: Winch = field(default_factory=Winch)
    winch_2: Winch = field(default_factory=Winch)
    creep_1: Creep = field(default_factory=Creep)
    creep_2: Creep = field(default_factory=Creep)


@dataclass(frozen=True)
class PlantState:
    """State of the plant; angles and speeds are positive when rope is retrieved (E1)."""

    x: Annotated[Scalar, Quantity("m", "position of the vehicle along the track"), Mark.POSITION]
    v: Annotated[Scalar, Quantity("m/s", "speed of the vehicle"), Mark.SPEED]
    theta_1: Annotated[Scalar, Quantity("rad", "angle of drum 1")]
    omega_1: Annotated[Scalar, Quantity("rad/s", "speed of drum 1")]
    theta_2: Annotated[Scalar, Quantity("rad", "angle of drum 2")]
    omega_2: Annotated[Scalar, Quantity("rad/s", "speed of drum 2")]


@dataclass(frozen=True)
class Torques:
    """Motor torques, the plant's inputs."""

    tau_1: Annotated[Scalar, Quantity("N m", "motor torque of winch 1")]
    tau_2: Annotated[Scalar, Quantity("N m", "motor torque of winch 2")]


@dataclass(frozen=True)
class DisturbanceInputs:
    """What acts on the vehicle from outside."""

    force: Annotated[Scalar, Quantity("N", "disturbance force along the track")] = 0.0
    current: Annotated[Scalar, Quantity("m/s", "ambient current along the track")] = 0.0
    normal_force_variation: Annotated[Scalar, Quantity("N", "change of the force on the rail")] = 0.0


def tensions(state: PlantState, plant: Plant, t: Scalar = NEW) -> tuple[Scalar, Scalar]:
    """Tensions F_1 and F_2 in N of the two ropes at the time t in s (paper Section 2.2, E1, A1, A2)."""
    length_1, length_2 = rope_lengths(state.x, plant.track)
    closeness_1, closeness_2 = reciprocals(length_1, length_2)
    drum_1, drum_2 = winding(state.theta_1, plant.winch_1), winding(state.theta_2, plant.winch_2)
    (longer_1, creeping_1), (longer_2, creeping_2) = crept(t, plant.creep_1), crept(t, plant.creep_2)
    stretch_1, rate_1 = drum_1.rope - state.x - longer_1, drum_1.radius * state.omega_1 - state.v - creeping_1
    stretch_2, rate_2 = drum_2.rope + state.x - longer_2, drum_2.radius * state.omega_2 + state.v - creeping_2
    pull_1 = plant.rope_1.pull(stretch_1, rate_1, length_1, closeness_1)
    pull_2 = plant.rope_2.pull(stretch_2, rate_2, length_2, closeness_2)
    if not plant.rope_slack:
        return pull_1, pull_2
    return one_sided(stretch_1, pull_1), one_sided(stretch_2, pull_2)


def vehicle_acceleration(v: Scalar, pull: Scalar, environment: DisturbanceInputs, vehicle: Vehicle) -> Scalar:
    """Acceleration of the vehicle in m/s² under the net rope force F_1 − F_2 in N (paper Section 2.3)."""
    resistance = friction(v, vehicle, environment.normal_force_variation)
    resistance += drag(v - environment.current, vehicle)
    return (pull - resistance + environment.force) / inertia(vehicle)


def derivative(
    state: PlantState, torques: Torques, environment: DisturbanceInputs, plant: Plant, t: Scalar = NEW
) -> PlantState:
    """Time derivative of the state (paper Section 2.5 with E1–E3).

    Args:
        state: the plant's state.
        torques: what the motors give (`shaft_torques`).
        environment: what acts on the vehicle from outside.
        plant: its parameters.
        t: time in s.
    """
    force_1, force_2 = tensions(state, plant, t)
    radius_1, radius_2 = winding(state.theta_1, plant.winch_1).radius, winding(state.theta_2, plant.winch_2).radius
    return PlantState(
        x=state.v,
        v=vehicle_acceleration(state.v, force_1 - force_2, environment, plant.vehicle),
        theta_1=state.omega_1,
        omega_1=drum_acceleration(state.omega_1, force_1, torques.tau_1, plant.winch_1, radius_1),
        theta_2=state.omega_2,
        omega_2=drum_acceleration(state.omega_2, force_2, torques.tau_2, plant.winch_2, radius_2),
    )


def shaft_torques(torques: Torques, theta_1: Scalar, theta_2: Scalar, plant: Plant) -> Torques:
    """Torques that the motors give instead of these, at the drum angles theta_1 and theta_2 in rad."""
    return Torques(
        tau_1=shaft_torque(torques.tau_1, theta_1, plant.winch_1),
        tau_2=shaft_torque(torques.tau_2, theta_2, plant.winch_2),
    )


def torques_amid(torques: Torques, state: PlantState, duration: Scalar, plant: Plant) -> Torques:
    """`shaft_torques` at the drum angles amid a stretch of time of a duration in s that begins with a state."""
    middle_1 = state.theta_1 + duration / 2 * state.omega_1
    middle_2 = state.theta_2 + duration / 2 * state.omega_2
    return shaft_torques(torques, middle_1, middle_2, plant)


def resting_state(preload: Scalar, plant: Plant, x: Scalar = 0.0) -> PlantState:
    """At rest at x in m with both ropes at tension preload/2 in N: the initial state of every run."""
    length_1, length_2 = rope_lengths(x, plant.track)
    stretch_1 = plant.rope_1.resting_stretch(preload / 2, length_1)
    stretch_2 = plant.rope_2.resting_stretch(preload / 2, length_2)
    return PlantState(
        x=x,
        v=0.0,
        theta_1=angle_of(stretch_1 + x, plant.winch_1),
        omega_1=0.0,
        theta_2=angle_of(stretch_2 - x, plant.winch_2),
        omega_2=0.0,
    )


def holding_torques(preload: Scalar, plant: Plant) -> Torques:
    """Motor torques that hold both ropes at tension preload/2 in N on the drums' radius of the data sheet."""
    winch_1, winch_2 = plant.winch_1, plant.winch_2
    return Torques(
        tau_1=winch_1.drum_radius / winch_1.gear_ratio * preload / 2,
        tau_2=winch_2.drum_radius / winch_2.gear_ratio * preload / 2,
    )


def specified_plant(plant: Plant) -> Plant:
    """The plant of the data sheets, without what is unknown of it."""
    return replace(
        plant,
        winch_1=specified_winch(plant.winch_1),
        winch_2=specified_winch(plant.winch_2),
        creep_1=Creep(),
        creep_2=Creep(),
    )


def plant_structure(plant: Plant) -> Plant:
    """The laws of a plant's ropes and whether they go slack, with numbers of no plant in particular."""
    return Plant(rope_slack=plant.rope_slack, rope_1=alike(plant.rope_1), rope_2=alike(plant.rope_2))


def symbolic_plant(structure: Plant) -> tuple[Plant, ca.SX]:
    """A plant of a structure whose numbers are symbols, and their vector in the order of ``numbers(structure)``."""
    names = list(numbers(structure))
    p = ca.SX.sym("p", len(names))
    return with_leaves(structure, dict(zip(names, ca.vertsplit(p), strict=True))), p


def plant(values: Plant | None = None) -> ca.Function:
    """The plant as a named CasADi function to call, print, differentiate or generate code from.

    Args:
        values: the structure (``rope_slack``, the ropes' laws) and, if given, the values of the parameters. Without
            it the parameters are an input, those of the paper's ropes.

    Returns:
        ``plant(x, u, w, p) -> (dx, F)`` with the state x (6, fields of `PlantState`), the torques u (2), the
        environment w (3, fields of `DisturbanceInputs`) and the parameters p (in the order of
        ``numbers(Plant())``); dx (6) is the time derivative and F (2) are the tensions in N. With `values`
        there is no p.
    """
    structure = values or Plant()
    symbolic, p = symbolic_plant(structure)
    parameters = structure if values else symbolic
    x, u, w = ca.SX.sym("x", 6), ca.SX.sym("u", 2), ca.SX.sym("w", 3)
    state = PlantState(*ca.vertsplit(x))
    torques = Torques(*ca.vertsplit(u))
    environment = DisturbanceInputs(*ca.vertsplit(w))
    dx = derivative(state, shaft_torques(torques, state.theta_1, state.theta_2, parameters), environment, parameters)
    inputs = {"x": x, "u": u, "w": w} | ({} if values else {"p": p})
    outputs = [ca.vertcat(*leaves(dx).values()), ca.vertcat(*tensions(state, parameters))]
    return ca.Function("plant", list(inputs.values()), outputs, list(inputs), ["dx", "F"])
