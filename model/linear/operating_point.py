"""Operating points of the linearisation: an equilibrium at rest, or an instant of steady motion.

In steady motion speed, tensions and drum speeds are constant. The length of rope between winch and vehicle changes as
the vehicle moves, and with it the spring rate E A / length. A tension is constant if the *strain* is: with the stretch
``s = strain * length`` and ``F = E A / length * s + c ds/dt``, the strain is ``F / (E A + c dlength/dt)``. A drum
therefore turns slower than the vehicle moves, by the share ``strain`` of the speed. (At equal speeds the tension would
rise by ``F v / length`` newtons per second.) This is an exact solution of the plant, along which only position and drum
angles change. `RopeLaw.steady_stretch` gives the strain of other ropes.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.codegen.source.expressions import built_once
from dualwinch.model.arguments import number_array, one_number
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.heavy_ropes import MASSLESS, steady_rope
from dualwinch.model.plant import (
    DisturbanceInputs,
    Plant,
    PlantState,
    Torques,
    blank_state,
    derivative,
    inner_forces,
    plant_structure,
    rope_resistance,
    shaft_torques,
)
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.part import NO_STATE
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.quantities.tree import leaves, numbers, symbols, with_leaves
from dualwinch.model.ropes import SHORTEST_ROPE, Track, rope_lengths
from dualwinch.model.scalar import Scalar, absolute, maximum, minimum
from dualwinch.model.vehicle import bent_bristles, drag, friction, slope_force
from dualwinch.model.winch import (
    Rotor,
    angle_of,
    friction_torque,
    gear_torque,
    over_sheaves,
    shaft_torque,
    steady_motor,
    winding,
    with_gear_loss,
)

PRELOAD = 2000.0
"""Sum of both tensions in N (paper Section 4.1)."""

TENSION_MIN, TENSION_MAX = 200.0, 6000.0
"""Limits of a tension in N (Table 1)."""


class SteadyMotion(NamedTuple):
    """State, motor torques and tensions in N at one instant of steady motion."""

    state: PlantState
    torques: Torques
    F1: Scalar
    F2: Scalar


def resistance(v: Scalar, environment: DisturbanceInputs, plant: Plant, x: Scalar = 0.0) -> Scalar:
    """Net rope force F1 − F2 in N at the drums that keeps the speed v in m/s (paper Section 2.3).

    The sum of friction, slope, drag and disturbance of the vehicle at x in m, and of the ropes' resistance.
    """
    opposing = friction(v, plant.vehicle, environment.normal_force_variation) + rope_resistance(x, v, plant)
    opposing += slope_force(x, plant.vehicle, plant.track)
    return opposing + drag(v - environment.current, plant.vehicle) - environment.force


def shared_tensions(net: Scalar, preload: Scalar, tension_min: Scalar, tension_max: Scalar) -> tuple[Scalar, Scalar]:
    """Tensions F1 and F2 in N with the difference `net` (paper Section 3.2).

    Their sum is the preload, or as near to it as the limits allow. A net force beyond ``tension_max - tension_min``
    leaves one tension at tension_min and the other above tension_max.
    """
    total = maximum(minimum(preload, 2 * tension_max - absolute(net)), 2 * tension_min + absolute(net))
    return (total + net) / 2, (total - net) / 2


def steady_motion(
    x: Scalar, v: Scalar, tensions: tuple[Scalar, Scalar], plant: Plant, creep: tuple[Scalar, Scalar] = (0.0, 0.0)
) -> SteadyMotion:
    """State and torques of the steady motion through x in m at v in m/s, with the tensions F1 and F2 in N.

    `creep` is the permanent elongation of the ropes in m. The disturbances are constant; their forces enter through the
    tensions. If the drum radius depends on its angle, or the ropes' friction on their length, the motion is steady only
    at this instant.
    """
    drums, ropes, motors, torques, density = [], [], [], [], plant.vehicle.water_density
    lengths = rope_lengths(x, plant.track)
    for side, tension, length, longer in zip(plant.sides, tensions, lengths, creep, strict=True):
        way, speed = side.direction * x + longer, side.direction * v
        rope, wound, rate = steady_rope(side.rope, tension, length, plant.track, way, speed, density=density)
        theta = angle_of(wound, side.winch)
        radius = winding(theta, side.winch).radius
        omega = rate / radius
        at_drum = over_sheaves(tension, omega, side.winch)
        load = radius * with_gear_loss(at_drum, omega, side.winch) + friction_torque(omega, side.winch)
        motor = steady_motor(load, theta, omega, side.winch)
        drums += [theta, omega]
        ropes.append(rope)
        motors.append(motor)
        shaft = motor.theta if isinstance(motor, Rotor) else theta
        torques.append(load / side.winch.gear_ratio / shaft_torque(1.0, shaft, side.winch))
    rail = bent_bristles(friction(v, plant.vehicle), plant.vehicle)
    return SteadyMotion(PlantState(x, v, *drums, *ropes, *motors, rail=rail), Torques(*torques), *tensions)


FASTEST = 10.0
"""Bound in m/s on the speed of an operating point, far beyond any possible speed."""

TOLERANCE = 1e-9
"""Relative tolerance of limits, for round-off."""


def check_range(key: str, value: float, lower: float, upper: float, unit: str, *, strictly: bool = False) -> None:
    """Raise `ConfigurationError` for a number that is not finite or out of range."""
    if math.isfinite(value) and (lower < value < upper if strictly else lower <= value <= upper):
        return
    ends = [
        f"{sign}{'' if strictly else '='} {bound:g}"
        for sign, bound in ((">", lower), ("<", upper))
        if math.isfinite(bound)
    ]
    raise ConfigurationError(
        f"{key} = {value:g}: must be a finite number {' and '.join(ends)} {unit}".replace("  ", " ")
    )


def check_position(x: float, track: Track) -> None:
    """Raise `ConfigurationError` for a position off the track, or one that leaves a rope at its shortest length."""
    overrun = track.rope_offset / 2
    check_range("x", x, -overrun, track.length + overrun, "m (the track of plant.track.length, and half a rope_offset)")
    for rope, length in enumerate((track.length - x + track.rope_offset, x + track.rope_offset), start=1):
        if length <= SHORTEST_ROPE:
            raise ConfigurationError(
                f"x = {x:g}: leaves {length:g} m of rope {rope}, must be > {SHORTEST_ROPE:g} m "
                f"(plant.track.rope_offset = {track.rope_offset:g} m)"
            )


def violations(
    v: float, forces: Sequence[float], torques: Sequence[float], plant: Plant, limits: tuple[float, float]
) -> tuple[str, ...]:
    """Violations of tension_min and tension_max by tensions in N and torques in N m at a speed in m/s, in words."""
    words, (lower, upper) = [], limits
    motion = f"cruise at {v:g} m/s" if v else "rest"
    for (number, _, winch, *_), force, torque in zip(plant.sides, forces, torques, strict=True):
        if force > upper * (1 + TOLERANCE):
            words.append(f"{motion} needs {_newtons(force)} in rope {number} > tension_max = {_newtons(upper)}")
            continue
        ratio = winch.drum_radius / winch.gear_ratio
        for sign, limit, name in ((-1, lower, "tension_min"), (1, upper, "tension_max")):
            if sign * (torque - ratio * limit) > TOLERANCE * ratio * upper:
                words.append(
                    f"{motion} needs tau_{number} = {torque:.4g} N m {'<>'[sign > 0]} {ratio * limit:.4g} N m, "
                    f"the torque of {name}"
                )
    return tuple(words)


def remarks(preload: float, forces: Sequence[float]) -> tuple[str, ...]:
    """Remark in words where the sum of the tensions in N differs from the preload in N."""
    total = sum(forces)
    if abs(total - preload) <= TOLERANCE * preload:
        return ()
    return (f"a rope is at its limit: the tensions' sum is {_newtons(total)}, not the preload's {_newtons(preload)}",)


def gear_torques(state: PlantState, plant: Plant) -> dict[str, float]:
    """Torques in N m that compliant gearboxes transmit to their drums: ``gear_1``, ``gear_2``."""
    of_sides = zip(plant.sides, state.motors, state.drums, strict=True)
    return {
        f"gear_{side.number}": float(gear_torque(*drum, motor, side.winch))
        for side, motor, drum in of_sides
        if isinstance(motor, Rotor)
    }


def contact(torques: Mapping[str, float], plant: Plant) -> tuple[str, ...]:
    """Remark in words on the tooth contact that a linearisation assumes; empty without backlash.

    The transmitted torques in N m are those named ``gear_1`` and ``gear_2``.
    """
    sides = {f"gear_{side.number}": side for side in plant.sides if side.winch.backlash > 0}
    touching = [(side.number, torques[name]) for name, side in sides.items() if name in torques]
    if not touching:
        return ()
    words = " and ".join(f"{torque:.4g} N m in gearbox {number}" for number, torque in touching)
    return (f"linear while the ropes stay taut and the teeth, which transmit {words}, stay in contact",)


def _newtons(force: float) -> str:
    return f"{force:,.0f} N".replace(",", " ")


@dataclass(frozen=True)
class OperatingPoint:
    """One instant of steady motion (see `model.linear.operating_point`), or an equilibrium where v is zero."""

    x: Annotated[float, Quantity("m", "position of the vehicle along the track")]
    v: Annotated[float, Quantity("m/s", "speed of the vehicle")]
    theta_1: Annotated[float, Quantity("rad", "angle of drum 1, positive where it has retrieved rope")]
    omega_1: Annotated[float, Quantity("rad/s", "speed of drum 1, positive where it retrieves rope")]
    theta_2: Annotated[float, Quantity("rad", "angle of drum 2, positive where it has retrieved rope")]
    omega_2: Annotated[float, Quantity("rad/s", "speed of drum 2, positive where it retrieves rope")]
    tau_1: Annotated[float, Quantity("N m", "motor torque of winch 1")]
    tau_2: Annotated[float, Quantity("N m", "motor torque of winch 2")]
    F1: Annotated[float, Quantity("N", "tension of rope 1")]
    F2: Annotated[float, Quantity("N", "tension of rope 2")]
    preload: Annotated[float, Quantity("N", "requested sum of both tensions")]
    force: Annotated[float, Quantity("N", "disturbance force along the track")]
    current: Annotated[float, Quantity("m/s", "ambient current along the track")]
    residual: Annotated[float, Quantity("m/s^2", "largest remaining acceleration (round-off)")]
    tension_rate: Annotated[float, Quantity("N/s", "largest remaining rate of a tension (round-off)")]
    slack_1: Annotated[bool, Quantity("", "rope 1 is slack")]
    slack_2: Annotated[bool, Quantity("", "rope 2 is slack")]
    violations: Annotated[tuple[str, ...], Quantity("", "violated limits, in words")]
    remarks: Annotated[tuple[str, ...], Quantity("", "further remarks, in words")]
    rope_1: Any = MASSLESS
    rope_2: Any = MASSLESS
    motor_1: Any = NO_STATE
    motor_2: Any = NO_STATE
    rail: Any = NO_STATE

    @property
    def state(self) -> PlantState:
        """The plant's state."""
        return PlantState(**{name: getattr(self, name) for name in PlantState.__dataclass_fields__})

    @property
    def torques(self) -> Torques:
        """The plant's input."""
        return Torques(self.tau_1, self.tau_2)

    @property
    def environment(self) -> DisturbanceInputs:
        """The disturbances."""
        return DisturbanceInputs(self.force, self.current)


def operating_points(
    x: ArrayLike | None,
    v: ArrayLike,
    preload: ArrayLike,
    plant: Plant,
    *,
    current: float = 0.0,
    force: float = 0.0,
    tension_min: float = TENSION_MIN,
    tension_max: float = TENSION_MAX,
) -> list[OperatingPoint]:
    """State, torques and tensions of the steady motion through each x at the constant speed v.

    The difference of the tensions balances friction, drag and disturbance. Their sum is the preload, or as near to it
    as the limits allow, as the controller shares them (paper Section 3.2). An operating point that needs more than
    tension_max, or torques beyond the winches' limits, is returned with its violations in words.

    Args:
        x: positions in m; default: the middle of the track. x, v and preload are broadcast.
        v: speeds in m/s, -10 to 10; negative: towards winch 2.
        preload: sums of both tensions in N, between twice tension_min and twice tension_max.
        plant: the plant.
        current: ambient current in m/s, constant.
        force: disturbance force in N along the track, constant.
        tension_min: lower limit of a tension in N; 0 lets a rope go slack.
        tension_max: upper limit of a tension in N.

    Raises:
        ConfigurationError: a point off the track, a rope at its shortest length, a speed, preload or limit out of
            range; the message is about the first one.
    """
    coordinates = {"x": plant.track.length / 2 if x is None else x, "v": v, "preload": preload}
    arrays = np.broadcast_arrays(*(np.atleast_1d(number_array(name, values)) for name, values in coordinates.items()))
    points = np.array([np.ravel(values) for values in arrays])
    force, current = one_number("force", force), one_number("current", current)
    tension_min, tension_max = one_number("tension_min", tension_min), one_number("tension_max", tension_max)
    check_range("tension_min", tension_min, 0.0, math.inf, "N")
    check_range("tension_max", tension_max, tension_min, math.inf, "N")
    check_range("force", force, -math.inf, math.inf, "N")
    check_range("current", current, -FASTEST, FASTEST, "m/s")
    for position, speed, total in points.T:
        check_position(float(position), plant.track)
        check_range("v", float(speed), -FASTEST, FASTEST, "m/s")
        check_range("preload", float(total), 2 * tension_min, 2 * tension_max, "N", strictly=True)
    outside = np.array([[force], [current], [tension_min], [tension_max]])
    inputs = np.vstack([points, np.repeat(outside, points.shape[1], axis=1)])
    parameters = np.repeat(np.array([list(numbers(plant).values())]).T, points.shape[1], axis=1)
    structure = plant_structure(plant)
    solution = operating_point_law(structure)(inputs, parameters).full()
    residuals = _left(structure)(solution[:-4], solution[-4:-2], inputs[3:5], parameters).full()
    table = np.vstack([solution, residuals])
    limits = (tension_min, tension_max)
    return [_point(column, inputs[:, k], plant, limits) for k, column in enumerate(table.T)]


@built_once
def operating_point_law(structure: Plant) -> ca.Function:
    """``(x, v, preload, force, current, tension_min, tension_max), p -> state, torques, tensions``."""
    plant, p = symbols(structure, "p")
    point = ca.SX.sym("point", 7)
    x, v, preload, force, current, tension_min, tension_max = ca.vertsplit(point)
    environment = DisturbanceInputs(force, current)
    shared = shared_tensions(resistance(v, environment, plant, x), preload, tension_min, tension_max)
    cruise = steady_motion(x, v, shared, plant)
    values = [*leaves(cruise.state).values(), *leaves(cruise.torques).values(), cruise.F1, cruise.F2]
    return ca.Function("steady_motion", [point, p], [ca.vertcat(*values)])


@built_once
def _left(structure: Plant) -> ca.Function:
    """``state, torques, (force, current), p -> residuals``: largest acceleration and rate of a tension."""
    plant, p = symbols(structure, "p")
    (state, x), (commands, u), w = symbols(blank_state(structure), "x"), symbols(Torques(), "u"), ca.SX.sym("w", 2)
    torques = shaft_torques(commands, state, plant)
    rates = leaves(derivative(state, torques, DisturbanceInputs(*ca.vertsplit(w)), plant))
    descriptions = describe_parts(state)
    radii = {str(number): winch.drum_radius for number, _, winch, *_ in plant.sides}
    accelerations = [
        rate * radii[key.partition(".")[0][-1]] if descriptions[key].quantity.unit == "rad/s" else rate
        for key, rate in rates.items()
        if Mark.RATE in descriptions[key].marks
    ]
    forces = ca.vertcat(*inner_forces(state, plant).values())
    tension_rates = ca.jtimes(forces, x, ca.vertcat(*rates.values()))
    residuals = [ca.norm_inf(ca.vertcat(*accelerations)), ca.norm_inf(tension_rates)]
    return ca.Function("left", [x, u, w, p], [ca.vertcat(*residuals)])


def _point(
    column: NDArray[np.float64], asked: NDArray[np.float64], plant: Plant, limits: tuple[float, float]
) -> OperatingPoint:
    values = [float(value) + 0.0 for value in column]  # -0.0 becomes 0.0
    blank = blank_state(plant)
    state = with_leaves(blank, dict(zip(leaves(blank), values, strict=False)))
    *torques, F1, F2, residual, tension_rate = values[len(leaves(blank)) :]
    forces = F1, F2
    _, v, preload, force, current = (float(value) for value in asked[:5])
    slack = [plant.rope_slack and tension <= 0 for tension in forces]
    return OperatingPoint(
        **vars(state),
        **vars(Torques(*torques)),
        F1=F1,
        F2=F2,
        preload=preload,
        force=force,
        current=current,
        residual=residual,
        tension_rate=tension_rate,
        slack_1=slack[0],
        slack_2=slack[1],
        violations=violations(v, forces, torques, plant, limits),
        remarks=remarks(preload, forces) + contact(gear_torques(state, plant), plant),
    )
