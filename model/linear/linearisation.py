"""Exact linearisation of the plant at an operating point: Jacobians of the simulated functions."""

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from dualwinch.codegen.source.expressions import built_once
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.operating_point import OperatingPoint
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import (
    DisturbanceInputs,
    Plant,
    PlantState,
    Torques,
    blank_state,
    derivative,
    plant_structure,
    shaft_torques,
    tensions,
)
from dualwinch.model.quantities.description import describe, describe_parts
from dualwinch.model.quantities.tree import leaves, numbers, symbols

STATES = tuple(describe(PlantState))
"""States of a plant with massless ropes and rigid gears; other plants have more."""

INPUTS = ("tau_1", "tau_2", "D", "current")
OUTPUTS = ("x", "v", "F1", "F2", "omega_1", "omega_2")

UNITS = {
    **{key: leaf.quantity.unit for group in (PlantState, Torques) for key, leaf in describe(group).items()},
    "D": describe(DisturbanceInputs)["force"].quantity.unit,
    "current": describe(DisturbanceInputs)["current"].quantity.unit,
    **{name: describe(OperatingPoint)[name].quantity.unit for name in ("F1", "F2")},
}
"""Name → unit of these states and of every input and output."""


def names_of(plant: Plant) -> dict[str, Any]:
    """Names and units of the signals of a plant's linear model, by field of `LinearSystem`."""
    states = {key: leaf.quantity.unit for key, leaf in describe_parts(blank_state(plant)).items()}
    return {"states": tuple(states), "inputs": INPUTS, "outputs": OUTPUTS, "units": UNITS | states}


def linearise_at(points: Sequence[OperatingPoint], plant: Plant, dt: float | None = None) -> list[LinearSystem]:
    """The plant without controller, linearised at operating points.

    States are those of `PlantState`, with those of ropes with mass or weight and of rotors behind compliant gearboxes;
    inputs the motor torques tau_1 and tau_2, the disturbance force D and the ambient current; outputs x, v, F1, F2,
    omega_1, omega_2. In a cruise, position, rope lengths and the sag's depth are frozen at x: the system is valid for
    motions that are fast compared with length/v. Ropes stay taut, and teeth in contact as at the operating point.

    Args:
        points: of `model.linear.operating_point.operating_points`.
        plant: of these points.
        dt: sample time in s of discrete systems (zero-order hold); None: continuous time.

    Raises:
        ConfigurationError: a rope is slack, where the plant is not differentiable, or a sample time that is not
            positive.
    """
    for point in points:
        if point.slack_1 or point.slack_2:
            raise ConfigurationError(
                f"rope {1 if point.slack_1 else 2} is slack at x = {point.x:g} m, v = {point.v:g} m/s: "
                "the plant has no linearisation there; tension_min > 0 keeps ropes taut"
            )
    groups = zip(*((point.state, point.torques, point.environment) for point in points), strict=True)
    arguments = [np.array([list(leaves(each).values()) for each in group]).T for group in groups]
    arguments.append(np.repeat(np.array([list(numbers(plant).values())]).T, len(points), axis=1))
    jacobians = [
        np.array(np.split(side_by_side.full(), len(points), axis=1))
        for side_by_side in _jacobians(plant_structure(plant))(*arguments)
    ]
    names = names_of(plant)
    systems = [
        LinearSystem(A, B, C, D, dt=None, **names, operating_point=numbers(point))
        for A, B, C, D, point in zip(*jacobians, points, strict=True)
    ]
    return systems if dt is None else [system.discretised(dt) for system in systems]


@built_once
def _jacobians(structure: Plant) -> ca.Function:
    """``(state, torques, environment, parameters) -> (A, B, C, D)``."""
    plant, p = symbols(structure, "p")
    state, x = symbols(blank_state(structure), "x")
    commands, u = symbols(Torques(), "u")
    environment, w = symbols(DisturbanceInputs(), "w")
    torques = shaft_torques(commands, state, plant)
    dx = ca.vertcat(*leaves(derivative(state, torques, environment, plant)).values())
    force_1, force_2 = tensions(state, plant)
    y = ca.vertcat(state.x, state.v, force_1, force_2, state.omega_1, state.omega_2)
    inputs = ca.vertcat(u, w)
    matrices = [ca.jacobian(dx, x), ca.jacobian(dx, inputs)[:, :4], ca.jacobian(y, x), ca.jacobian(y, inputs)[:, :4]]
    return ca.Function("jacobians", [x, u, w, p], [ca.densify(matrix) for matrix in matrices])
