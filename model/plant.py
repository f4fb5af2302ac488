"""The coupled plant: vehicle, two ropes, two winches (paper Section 2; signs as in E1–E3)."""

from dataclasses import dataclass, field, replace
from typing import Annotated, NamedTuple

import casadi as ca

from dualwinch.model.quantities.part import PartChoice
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.quantities.tree import alike, leaves, symbols
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

    @property
    def sides(self) -> "tuple[Side, Side]":
        """Both winches with their ropes."""
        return (
            Side(1, 1.0, self.winch_1, self.rope_1, self.creep_1),
            Side(2, -1.0, self.winch_2, self.rope_2, self.creep_2),
        )


class Side(NamedTuple):
    """A winch with its rope, and the direction of the rope's pull on the vehicle: 1 along the track, -1 back."""

    number: int
    direction: float
    winch: Winch
    rope: RopeLaw
    creep: Creep


@dataclass(frozen=True)
class PlantState:
    """State of the plant; angles and speeds are positive when rope is retrieved (E1)."""

    x: Annotated[Scalar, Quantity("m", "position of the vehicle along the track"), Mark.POSITION] = 0.0
    v: Annotated[Scalar, Quantity("m/s", "speed of the vehicle"), Mark.SPEED] = 0.0
    theta_1: Annotated[Scalar, Quantity("rad", "angle of drum 1")] = 0.0
    omega_1: Annotated[Scalar, Quantity("rad/s", "speed of drum 1")] = 0.0
    theta_2: Annotated[Scalar, Quantity("rad", "angle of drum 2")] = 0.0
    omega_2: Annotated[Scalar, Quantity("rad/s", "speed of drum 2")] = 0.0

    @property
    def drums(self) -> tuple[tuple[Scalar, Scalar], tuple[Scalar, Scalar]]:
        """Angle in rad and speed in rad/s of both drums."""
        return (self.theta_1, self.omega_1), (self.theta_2, self.omega_2)


@dataclass(frozen=True)
class Torques:
    """Motor torques, the plant's inputs."""

    tau_1: Annotated[Scalar, Quantity("N m", "motor torque of winch 1")] = 0.0
    tau_2: Annotated[Scalar, Quantity("N m", "motor torque of winch 2")] = 0.0


@dataclass(frozen=True)
class DisturbanceInputs:
    """What acts on the vehicle from outside."""

    force: Annotated[Scalar, Quantity("N", "disturbance force along the track")] = 0.0
    current: Annotated[Scalar, Quantity("m/s", "ambient current along the track")] = 0.0
    normal_force_variation: Annotated[Scalar, Quantity("N", "change of the force on the rail")] = 0.0


def tensions(state: PlantState, plant: Plant, t: Scalar = NEW) -> tuple[Scalar, Scalar]:
    """Tensions F_1 and F_2 in N of the two ropes at the time t in s (paper Section 2.2, E1, A1, A2)."""
    lengths, found = rope_lengths(state.x, plant.track), []
    closenesses = reciprocals(*lengths)
    for side, (theta, omega), length, closeness in zip(plant.sides, state.drums, lengths, closenesses, strict=True):
        drum, (longer, creeping) = winding(theta, side.winch), crept(t, side.creep)
        stretch = drum.rope - side.direction * state.x - longer
        rate = drum.radius * omega - side.direction * state.v - creeping
        pull = side.rope.pull(stretch, rate, length, closeness)
        found.append(one_sided(stretch, pull) if plant.rope_slack else pull)
    return found[0], found[1]


def vehicle_acceleration(v: Scalar, pull: Scalar, environment: DisturbanceInputs, vehicle: Vehicle) -> Scalar:
    """Acceleration of the vehicle in m/s² under the net rope force F_1 − F_2 in N (paper Section 2.3)."""
    resistance = friction(v, vehicle, environment.normal_force_variation)
    resistance += drag(v - environment.current, vehicle)
    return (pull - resistance + environment.force) / inertia(vehicle)


def derivative(
    state: PlantState, torques: Torques, environment: DisturbanceInputs, plant: Plant, t: Scalar = NEW
) -> PlantState:
    """Time derivative of the state at a time in s, under the `shaft_torques` (paper Section 2.5 with E1–E3)."""
    forces, given = tensions(state, plant, t), (torques.tau_1, torques.tau_2)
    accelerations = [
        drum_acceleration(omega, force, torque, side.winch, winding(theta, side.winch).radius)
        for side, (theta, omega), force, torque in zip(plant.sides, state.drums, forces, given, strict=True)
    ]
    return PlantState(
        x=state.v,
        v=vehicle_acceleration(state.v, forces[0] - forces[1], environment, plant.vehicle),
        theta_1=state.omega_1,
        omega_1=accelerations[0],
        theta_2=state.omega_2,
        omega_2=accelerations[1],
    )


def shaft_torques(torques: Torques, theta_1: Scalar, theta_2: Scalar, plant: Plant) -> Torques:
    """Torques that the motors give instead of these, at the drum angles theta_1 and theta_2 in rad."""
    return Torques(
        tau_1=shaft_torque(torques.tau_1, theta_1, plant.winch_1),
        tau_2=shaft_torque(torques.tau_2, theta_2, plant.winch_2),
    )


def torques_amid(torques: Torques, state: PlantState, duration: Scalar, plant: Plant) -> Torques:
    """`shaft_torques` at the drum angles amid a stretch of time of a duration in s that begins with a state."""
    middle_1, middle_2 = (theta + duration / 2 * omega for theta, omega in state.drums)
    return shaft_torques(torques, middle_1, middle_2, plant)


def resting_state(preload: Scalar, plant: Plant, x: Scalar = 0.0) -> PlantState:
    """At rest at x in m with both ropes at tension preload/2 in N: the initial state of every run."""
    angles = (
        angle_of(side.rope.resting_stretch(preload / 2, length) + side.direction * x, side.winch)
        for side, length in zip(plant.sides, rope_lengths(x, plant.track), strict=True)
    )
    return PlantState(x, 0.0, next(angles), 0.0, next(angles), 0.0)


def holding_torques(preload: Scalar, plant: Plant) -> Torques:
    """Motor torques that hold both ropes at tension preload/2 in N on the drums' radius of the data sheet."""
    return Torques(*(side.winch.drum_radius / side.winch.gear_ratio * preload / 2 for side in plant.sides))


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
    symbolic, p = symbols(structure, "p")
    parameters = structure if values else symbolic
    state, x = symbols(PlantState(), "x")
    torques, u = symbols(Torques(), "u")
    environment, w = symbols(DisturbanceInputs(), "w")
    dx = derivative(state, shaft_torques(torques, state.theta_1, state.theta_2, parameters), environment, parameters)
    inputs = {"x": x, "u": u, "w": w} | ({} if values else {"p": p})
    outputs = [ca.vertcat(*leaves(dx).values()), ca.vertcat(*tensions(state, parameters))]
    return ca.Function("plant", list(inputs.values()), outputs, list(inputs), ["dx", "F"])
