"""The coupled plant: vehicle, two ropes, two winches (paper Section 2; signs as in E1–E3)."""

from dataclasses import dataclass, field, replace
from typing import Annotated, Any, NamedTuple

import casadi as ca

from dualwinch.model.arguments import instance
from dualwinch.model.heavy_ropes import (
    MASSLESS,
    RopeEnds,
    RopePull,
    Sag,
    blank_rope,
    end_mass,
    is_heavy,
    resting_rope,
    rope_drag,
    rope_on_drum,
    rope_pull,
)
from dualwinch.model.quantities.part import NO_STATE, PartChoice
from dualwinch.model.quantities.quantity import Mark, Quantity, elements, vector
from dualwinch.model.quantities.tree import alike, leaves, shape_of, symbols
from dualwinch.model.ropes import NEW, ROPES, Creep, Rope, RopeLaw, Track, crept, rope_lengths
from dualwinch.model.scalar import Scalar, present, reciprocals
from dualwinch.model.vehicle import Vehicle, bent_bristles, drag, friction, inertia, rail_friction, slope_force
from dualwinch.model.winch import (
    Rotor,
    Winch,
    angle_of,
    gear_torque,
    shaft_torque,
    specified_winch,
    steady_motor,
    winch_rates,
    winding,
)

ROPE_LAW = Quantity("", "law of the rope's tension", "paper Section 2.2")


@dataclass(frozen=True)
class Plant:
    """Vehicle, track, ropes and winches; the ropes' creep is unknown to all controllers."""

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
    v: Annotated[Scalar, Quantity("m/s", "speed of the vehicle"), Mark.SPEED, Mark.RATE] = 0.0
    theta_1: Annotated[Scalar, Quantity("rad", "angle of drum 1, positive where it has retrieved rope")] = 0.0
    omega_1: Annotated[Scalar, Quantity("rad/s", "speed of drum 1, positive where it retrieves rope"), Mark.RATE] = 0.0
    theta_2: Annotated[Scalar, Quantity("rad", "angle of drum 2, positive where it has retrieved rope")] = 0.0
    omega_2: Annotated[Scalar, Quantity("rad/s", "speed of drum 2, positive where it retrieves rope"), Mark.RATE] = 0.0
    rope_1: Any = MASSLESS
    rope_2: Any = MASSLESS
    motor_1: Any = NO_STATE
    motor_2: Any = NO_STATE
    rail: Any = NO_STATE

    @property
    def ropes(self) -> tuple[Any, Any]:
        """The states of both ropes."""
        return self.rope_1, self.rope_2

    @property
    def motors(self) -> tuple[Any, Any]:
        """The states of both motors' rotors."""
        return self.motor_1, self.motor_2

    @property
    def shafts(self) -> tuple[tuple[Scalar, Scalar], tuple[Scalar, Scalar]]:
        """Angle in rad and speed in rad/s of both motors over their gear ratios: the drums' where gears are rigid."""
        shafts = zip(self.motors, self.drums, strict=True)
        shaft_1, shaft_2 = ((motor.theta, motor.omega) if isinstance(motor, Rotor) else drum for motor, drum in shafts)
        return shaft_1, shaft_2

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
    """Disturbances that act on the vehicle."""

    force: Annotated[Scalar, Quantity("N", "disturbance force along the track")] = 0.0
    current: Annotated[Scalar, Quantity("m/s", "ambient current along the track")] = 0.0
    normal_force_variation: Annotated[Scalar, Quantity("N", "change of the force on the rail")] = 0.0


def is_distributed(plant: Plant) -> bool:
    """Whether ropes have mass or weight, gearboxes compliance or losses, or sheaves friction: not the paper's plant."""
    return any(
        is_heavy(side.rope)
        or present(side.winch.gear_stiffness)
        or present(side.winch.gear_loss)
        or present(side.winch.sheave_friction)
        for side in plant.sides
    )


def remembers_friction(plant: Plant) -> bool:
    """Whether friction has a state, on the rail or in the ropes."""
    return present(plant.vehicle.bristle_stiffness) or any(present(side.rope.hysteresis) for side in plant.sides)


def sags(plant: Plant) -> bool:
    """Whether a rope has weight, so that it sags between rollers."""
    return any(present(side.rope.submerged_weight) for side in plant.sides)


def blank_state(plant: Plant) -> PlantState:
    """A plant state with placeholder values, for the names of its elements."""
    ropes = (blank_rope(side.rope) for side in plant.sides)
    motors = (steady_motor(0.0, 0.0, 0.0, side.winch) for side in plant.sides)
    return PlantState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, *ropes, *motors, rail=bent_bristles(0.0, plant.vehicle))


def rope_pulls(state: PlantState, plant: Plant, t: Scalar = NEW, step: Scalar = 0.0) -> tuple[RopePull, RopePull]:
    """Tensions and state rates of both ropes at the time t in s (paper Section 2.2, E1, A1, A2; mass and weight A14).

    `step` as in `derivative`.
    """
    lengths, pulls = rope_lengths(state.x, plant.track), []
    inverse_lengths = reciprocals(*lengths)
    ropes = zip(plant.sides, state.drums, state.ropes, lengths, inverse_lengths, strict=True)
    for side, (theta, omega), nodes, length, inverse_length in ropes:
        drum, (longer, creeping) = winding(theta, side.winch), crept(t, side.creep)
        ends = RopeEnds(
            wound=drum.rope,
            wound_rate=drum.radius * omega,
            stretch=drum.rope - side.direction * state.x - longer,
            stretch_rate=drum.radius * omega - side.direction * state.v - creeping,
            length=length,
            inverse_length=inverse_length,
        )
        water = {"density": plant.vehicle.water_density}
        pulls.append(rope_pull(side.rope, nodes, ends, plant.track, **water, slack=plant.rope_slack, step=step))
    return pulls[0], pulls[1]


def tensions(state: PlantState, plant: Plant, t: Scalar = NEW) -> tuple[Scalar, Scalar]:
    """Tensions F_1 and F_2 in N of the two ropes at their drums, or at sheaves with friction (`rope_pulls`).

    At the time t in s.
    """
    pull_1, pull_2 = rope_pulls(state, plant, t)
    return pull_1.at_drum, pull_2.at_drum


def vehicle_acceleration(
    v: Scalar,
    pull: Scalar,
    environment: DisturbanceInputs,
    vehicle: Vehicle,
    ropes: Scalar = 0.0,
    rubbing: Scalar | None = None,
) -> Scalar:
    """Acceleration of the vehicle in m/s² under the net rope force F_1 − F_2 in N (paper Section 2.3).

    At the speed v in m/s, with a mass in kg of `ropes` that move with it. `rubbing` is the rail friction in N; default:
    `friction`.
    """
    resistance = friction(v, vehicle, environment.normal_force_variation) if rubbing is None else rubbing
    resistance += drag(v - environment.current, vehicle)
    return (pull - resistance + environment.force) / (inertia(vehicle) + ropes)


def towed_vehicle(
    state: PlantState, pull: Scalar, environment: DisturbanceInputs, plant: Plant, step: Scalar = 0.0
) -> tuple[Scalar, Any]:
    """Acceleration of the vehicle in m/s² under a net rope force in N, and the rate of the rail's bristles.

    Includes the moving mass of the ropes, the rail's slope and its friction; `step` as in `derivative`.
    """
    vehicle, lengths = plant.vehicle, rope_lengths(state.x, plant.track)
    ropes = sum(end_mass(side.rope, length) for side, length in zip(plant.sides, lengths, strict=True))
    rubbing, rail = rail_friction(state.v, state.rail, vehicle, environment.normal_force_variation, step)
    downhill = pull - slope_force(state.x, vehicle, plant.track)
    return vehicle_acceleration(state.v, downhill, environment, vehicle, ropes, rubbing), rail


@dataclass(frozen=True)
class InnerSignals:
    """Signals inside ropes with mass or weight, and inside compliant gearboxes."""

    F1_vehicle: Annotated[Scalar, Quantity("N", "pull of rope 1 on the vehicle")] = 0.0
    F2_vehicle: Annotated[Scalar, Quantity("N", "pull of rope 2 on the vehicle")] = 0.0
    sag_1: Annotated[Scalar, Quantity("m", "sag of rope 1 at midspan")] = 0.0
    sag_2: Annotated[Scalar, Quantity("m", "sag of rope 2 at midspan")] = 0.0
    gear_1: Annotated[Scalar, Quantity("N m", "torque that gearbox 1 transmits to the drum")] = 0.0
    gear_2: Annotated[Scalar, Quantity("N m", "torque that gearbox 2 transmits to the drum")] = 0.0


def inner_signals(state: PlantState, pulls: tuple[RopePull, RopePull], plant: Plant) -> dict[str, Scalar]:
    """The `InnerSignals` of a plant: name → value."""
    signals: dict[str, Scalar] = {}
    of_sides = zip(plant.sides, pulls, state.ropes, state.motors, state.drums, strict=True)
    for side, pull, rope, motor, drum in of_sides:
        if is_heavy(side.rope):
            signals[f"F{side.number}_vehicle"] = pull.at_vehicle
        if isinstance(rope.sag, Sag):
            signals[f"sag_{side.number}"] = rope.sag.depth
        if isinstance(motor, Rotor):
            signals[f"gear_{side.number}"] = gear_torque(*drum, motor, side.winch)
    return signals


def inner_forces(state: PlantState, plant: Plant) -> dict[str, Scalar]:
    """Forces in N that are constant in steady motion, while positions change: tensions along the ropes, gear torques.

    The keys are those of positions in the plant's state: of a drum for the tension of the segment next to it, of a node
    for that of the segment beyond it, of a rotor for the torque its gearbox transmits, divided by the drum radius.
    """
    forces: dict[str, Scalar] = {}
    of_sides = zip(plant.sides, rope_pulls(state, plant), state.motors, state.drums, strict=True)
    for (number, _, winch, *_), pull, motor, drum in of_sides:
        end_segment, *segments = pull.segments
        forces[f"theta_{number}"] = end_segment
        if segments:
            ends = elements(vector(segments))
            forces |= {f"rope_{number}.waves.position{end}": tension for end, tension in ends.items()}
        if isinstance(motor, Rotor):
            forces[f"motor_{number}.theta"] = gear_torque(*drum, motor, winch) / winch.drum_radius
    return forces


def rope_resistance(x: Scalar, v: Scalar, plant: Plant) -> Scalar:
    """Net rope force F1 − F2 in N at the drums that overcomes the ropes' drag and roller friction at v in m/s."""
    density, lengths = plant.vehicle.water_density, rope_lengths(x, plant.track)
    return sum(
        side.direction * rope_drag(side.rope, side.direction * v, length, plant.track, density)
        for side, length in zip(plant.sides, lengths, strict=True)
    )


def derivative(
    state: PlantState,
    torques: Torques,
    environment: DisturbanceInputs,
    plant: Plant,
    t: Scalar = NEW,
    step: Scalar = 0.0,
) -> PlantState:
    """Time derivative of the state at a time in s, under the `shaft_torques` (paper Section 2.5 with E1–E3).

    Friction states (`Mark.SETTLES`) may settle within an integration step: their rates are means over `step` s, and
    forces are those at its end. A step of 0 gives the derivative itself.
    """
    pulls, lengths = rope_pulls(state, plant, t, step), rope_lengths(state.x, plant.track)
    motor_torques = torques.tau_1, torques.tau_2
    of_sides = zip(plant.sides, state.drums, state.motors, pulls, motor_torques, lengths, strict=True)
    (alpha_1, motor_1), (alpha_2, motor_2) = (
        winch_rates(theta, omega, motor, pull.at_drum, torque, side.winch, rope_on_drum(side.rope, length, plant.track))
        for side, (theta, omega), motor, pull, torque, length in of_sides
    )
    acceleration, rail = towed_vehicle(state, pulls[0].at_vehicle - pulls[1].at_vehicle, environment, plant, step)
    return PlantState(
        x=state.v,
        v=acceleration,
        theta_1=state.omega_1,
        omega_1=alpha_1,
        theta_2=state.omega_2,
        omega_2=alpha_2,
        rope_1=pulls[0].rate,
        rope_2=pulls[1].rate,
        motor_1=motor_1,
        motor_2=motor_2,
        rail=rail,
    )


def shaft_torques(torques: Torques, state: PlantState, plant: Plant, after: Scalar = 0.0) -> Torques:
    """Motor torques with torque error and ripple, at the angles of the shafts a time in s after a state."""
    angle_1, angle_2 = (theta + after * omega for theta, omega in state.shafts)
    return Torques(
        tau_1=shaft_torque(torques.tau_1, angle_1, plant.winch_1),
        tau_2=shaft_torque(torques.tau_2, angle_2, plant.winch_2),
    )


def resting_state(preload: Scalar, plant: Plant, x: Scalar = 0.0) -> PlantState:
    """At rest at x in m with both ropes at tension preload/2 in N: the initial state of every run."""
    angles, ropes, motors = [], [], []
    for side, length in zip(plant.sides, rope_lengths(x, plant.track), strict=True):
        way = side.direction * x
        rope, stretch = resting_rope(side.rope, preload / 2, length, plant.track, way)
        angles.append(angle_of(stretch + way, side.winch))
        ropes.append(rope)
        load = winding(angles[-1], side.winch).radius * (preload / 2)
        motors.append(steady_motor(load, angles[-1], 0.0, side.winch))
    rail = bent_bristles(-slope_force(x, plant.vehicle, plant.track), plant.vehicle)  # between equal tensions
    return PlantState(x, 0.0, angles[0], 0.0, angles[1], 0.0, *ropes, *motors, rail=rail)


def holding_torques(preload: Scalar, plant: Plant) -> Torques:
    """Motor torques that hold both ropes at tension preload/2 in N, with the drum radii of the data sheet."""
    return Torques(*(side.winch.drum_radius / side.winch.gear_ratio * preload / 2 for side in plant.sides))


def rigid_plant(plant: Plant) -> Plant:
    """The same machine with massless Kelvin–Voigt ropes, rigid gears without losses, and friction without states."""
    rigid = {"gear_stiffness": 0.0, "gear_loss": 0.0, "sheave_friction": 0.0}
    return replace(
        plant,
        vehicle=replace(plant.vehicle, bristle_stiffness=0.0),
        rope_1=Rope(),
        rope_2=Rope(),
        track=replace(plant.track, roller_spacing=0.0),
        winch_1=replace(plant.winch_1, **rigid),
        winch_2=replace(plant.winch_2, **rigid),
    )


def specified_plant(plant: Plant) -> Plant:
    """The plant of the data sheets, without its unknown errors."""
    return replace(
        plant,
        vehicle=replace(plant.vehicle, stiction=0.0, bristle_stiffness=0.0, bristle_damping=0.0),
        track=replace(plant.track, tilt=0.0, waviness=0.0),
        winch_1=specified_winch(plant.winch_1),
        winch_2=specified_winch(plant.winch_2),
        creep_1=Creep(),
        creep_2=Creep(),
    )


def plant_structure(plant: Plant) -> Plant:
    """A plant with the same rope laws, slack behaviour and optional effects, and placeholder values."""
    return Plant(
        rope_slack=plant.rope_slack,
        vehicle=shape_of(plant.vehicle),
        track=shape_of(plant.track),
        rope_1=alike(plant.rope_1),
        rope_2=alike(plant.rope_2),
        winch_1=shape_of(plant.winch_1),
        winch_2=shape_of(plant.winch_2),
    )


def plant(values: Plant | None = None) -> ca.Function:
    """The plant as a named CasADi function to call, print, differentiate or generate code from.

    Args:
        values: the structure (``rope_slack``, the ropes' laws) and the values of the parameters. Default: the paper's
            structure, with the parameters as an input.

    Returns:
        ``plant(x, u, w, p) -> (dx, F)`` with the state x (6 fields of `PlantState`, more where ropes have mass or
        gears are compliant), the torques u (2), the disturbances w (3, fields of `DisturbanceInputs`) and the
        parameters p (in the order of ``numbers(Plant())``); dx is the time derivative and F (2) are the tensions in N.
        With `values` there is no p.

    Example:
        >>> import dualwinch as dw
        >>> dw.plant(dw.Plant())
        Function(plant:(x[6],u[2],w[3])->(dx[6],F[2]) SXFunction)
    """
    instance("values", values, Plant, optional=True)
    structure = values or Plant()
    symbolic, p = symbols(structure, "p")
    parameters = structure if values else symbolic
    state, x = symbols(blank_state(structure), "x")
    torques, u = symbols(Torques(), "u")
    environment, w = symbols(DisturbanceInputs(), "w")
    dx = derivative(state, shaft_torques(torques, state, parameters), environment, parameters)
    inputs = {"x": x, "u": u, "w": w} | ({} if values else {"p": p})
    outputs = [ca.vertcat(*leaves(dx).values()), ca.vertcat(*tensions(state, parameters))]
    return ca.Function("plant", list(inputs.values()), outputs, list(inputs), ["dx", "F"])
