"""Operating points: where the plant is linearised. At rest an equilibrium, else a steady cruise."""

import math
from dataclasses import dataclass
from typing import Annotated

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.codegen.source.expressions import built_once
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.operating_limits import FASTEST, check_position, check_range, remarks, violations
from dualwinch.model.plant import (
    Environment,
    Plant,
    PlantState,
    Torques,
    derivative,
    plant_structure,
    shaft_torques,
    symbolic_plant,
    tensions,
)
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.quantities.tree import leaves, numbers
from dualwinch.model.steady_cruise import (
    PRELOAD,
    TENSION_MAX,
    TENSION_MIN,
    resistance,
    shared_tensions,
    steady_cruise,
)


@dataclass(frozen=True)
class OperatingPoint:
    """One instant of a steady cruise (see `model.steady_cruise`), or an equilibrium where v is zero."""

    x: Annotated[float, Quantity("m", "position of the vehicle along the track")]
    v: Annotated[float, Quantity("m/s", "speed of the vehicle")]
    theta_1: Annotated[float, Quantity("rad", "angle of drum 1")]
    omega_1: Annotated[float, Quantity("rad/s", "speed of drum 1")]
    theta_2: Annotated[float, Quantity("rad", "angle of drum 2")]
    omega_2: Annotated[float, Quantity("rad/s", "speed of drum 2")]
    tau_1: Annotated[float, Quantity("N m", "motor torque of winch 1")]
    tau_2: Annotated[float, Quantity("N m", "motor torque of winch 2")]
    F1: Annotated[float, Quantity("N", "tension of rope 1")]
    F2: Annotated[float, Quantity("N", "tension of rope 2")]
    preload: Annotated[float, Quantity("N", "sum of both tensions asked for")]
    force: Annotated[float, Quantity("N", "disturbance force along the track")]
    current: Annotated[float, Quantity("m/s", "ambient current along the track")]
    residual: Annotated[float, Quantity("m/s^2", "largest acceleration left (round-off)")]
    tension_rate: Annotated[float, Quantity("N/s", "largest rate of a tension left (round-off)")]
    slack_1: Annotated[bool, Quantity("", "rope 1 hangs loose")]
    slack_2: Annotated[bool, Quantity("", "rope 2 hangs loose")]
    violations: Annotated[tuple[str, ...], Quantity("", "limits that are not respected, in words")]
    remarks: Annotated[tuple[str, ...], Quantity("", "what else is to be known, in words")]

    @property
    def state(self) -> PlantState:
        """The plant's state."""
        return PlantState(self.x, self.v, self.theta_1, self.omega_1, self.theta_2, self.omega_2)

    @property
    def torques(self) -> Torques:
        """The plant's input."""
        return Torques(self.tau_1, self.tau_2)

    @property
    def environment(self) -> Environment:
        """What acts from outside."""
        return Environment(self.force, self.current)


def operating_point(
    x: float = 25.0,
    v: float = 0.0,
    preload: float = PRELOAD,
    plant: Plant | None = None,
    *,
    current: float = 0.0,
    force: float = 0.0,
    tension_min: float = TENSION_MIN,
    tension_max: float = TENSION_MAX,
) -> OperatingPoint:
    """State, torques and tensions with which the vehicle passes x at the constant speed v.

    The tensions differ by what friction, drag and disturbance ask for. Their sum is the preload, or as near to it as
    the limits allow, as the controller shares them (paper Section 3.2). An operating point that needs more than
    tension_max, or torques beyond the winches' limits, is returned with its violations in words.

    Args:
        x: position in m.
        v: speed in m/s, -10 to 10; negative: towards winch 2.
        preload: sum of both tensions in N, between twice tension_min and twice tension_max.
        plant: default: the paper's.
        current: ambient current in m/s, constant.
        force: disturbance force in N along the track, constant.
        tension_min: lower limit of a tension in N; 0 lets a rope go slack.
        tension_max: upper limit of a tension in N.

    Raises:
        ConfigurationError: a point off the track, a rope at its shortest length, a speed, preload or limit out of
            range.
    """
    given = plant or Plant()
    return operating_points(
        x, v, preload, given, current=current, force=force, tension_min=tension_min, tension_max=tension_max
    )[0]


def operating_points(
    x: ArrayLike,
    v: ArrayLike,
    preload: ArrayLike,
    plant: Plant,
    *,
    current: float = 0.0,
    force: float = 0.0,
    tension_min: float = TENSION_MIN,
    tension_max: float = TENSION_MAX,
) -> list[OperatingPoint]:
    """Many operating points at once: x, v and preload are broadcast against each other (see `operating_point`).

    Raises:
        ConfigurationError: as `operating_point`, for the first point that is wrong.
    """
    given = {"x": x, "v": v, "preload": preload}
    asked = np.broadcast_arrays(*(np.atleast_1d(_numbers(name, values)) for name, values in given.items()))
    points = np.array([np.ravel(values) for values in asked])
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
    found = cruise_law(structure)(inputs, parameters).full()
    left = _left(structure)(found[:6], found[6:8], inputs[3:5], parameters).full()
    table = np.vstack([found, left])
    limits = (tension_min, tension_max)
    return [_point(column, inputs[:, k], plant, limits) for k, column in enumerate(table.T)]


def _numbers(name: str, values: ArrayLike) -> NDArray[np.float64]:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        kind = type(values).__name__
        raise ConfigurationError(
            f"{name}: must be a number or an array of numbers, not {kind}; the order is x, v, preload, plant"
        ) from None


@built_once
def cruise_law(structure: Plant) -> ca.Function:
    """``(x, v, preload, force, current, tension_min, tension_max), p -> state, torques, tensions``."""
    plant, p = symbolic_plant(structure)
    point = ca.SX.sym("point", 7)
    x, v, preload, force, current, tension_min, tension_max = ca.vertsplit(point)
    environment = Environment(force, current)
    shared = shared_tensions(resistance(v, environment, plant), preload, tension_min, tension_max)
    cruise = steady_cruise(x, v, shared, plant)
    values = [*leaves(cruise.state).values(), *leaves(cruise.torques).values(), cruise.F1, cruise.F2]
    return ca.Function("steady_cruise", [point, p], [ca.vertcat(*values)])


@built_once
def _left(structure: Plant) -> ca.Function:
    """``state, torques, (force, current), p -> what is left``: largest acceleration and rate of a tension."""
    plant, p = symbolic_plant(structure)
    x, u, w = ca.SX.sym("x", 6), ca.SX.sym("u", 2), ca.SX.sym("w", 2)
    state = PlantState(*ca.vertsplit(x))
    torques = shaft_torques(Torques(*ca.vertsplit(u)), state.theta_1, state.theta_2, plant)
    rate = derivative(state, torques, Environment(*ca.vertsplit(w)), plant)
    radius_1, radius_2 = plant.winch_1.drum_radius, plant.winch_2.drum_radius
    accelerations = ca.vertcat(rate.v, radius_1 * rate.omega_1, radius_2 * rate.omega_2)
    tension_rates = ca.jtimes(ca.vertcat(*tensions(state, plant)), x, ca.vertcat(*leaves(rate).values()))
    left = [ca.norm_inf(accelerations), ca.norm_inf(tension_rates)]
    return ca.Function("left", [x, u, w, p], [ca.vertcat(*left)])


def _point(
    column: NDArray[np.float64], asked: NDArray[np.float64], plant: Plant, limits: tuple[float, float]
) -> OperatingPoint:
    values = [float(value) + 0.0 for value in column]  # -0.0 becomes 0.0
    state, torques, forces, left = PlantState(*values[:6]), Torques(*values[6:8]), values[8:10], values[10:]
    _, v, preload, force, current = (float(value) for value in asked[:5])
    slack = [plant.rope_slack and tension <= 0 for tension in forces]
    return OperatingPoint(
        **leaves(state),
        **leaves(torques),
        F1=forces[0],
        F2=forces[1],
        preload=preload,
        force=force,
        current=current,
        residual=left[0],
        tension_rate=left[1],
        slack_1=slack[0],
        slack_2=slack[1],
        violations=violations(v, forces, values[6:8], plant, limits),
        remarks=remarks(preload, forces),
    )
