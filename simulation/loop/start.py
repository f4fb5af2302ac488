"""The closed loop's state before the first sample as a function of its parameters."""

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.source.expressions import built_once
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.exogenous.sensors import Sensors
from dualwinch.simulation.loop.closed_loop import starting_state
from dualwinch.simulation.loop.structure import Structure, parameters_of, template_of

Floats = NDArray[np.float64]


@built_once
def start_function(structure: Structure) -> ca.Function:
    """``start(parameters) -> state`` of a structure, the numbers of `closed_loop.starting_state`; (states,)."""
    parameters, state = _start(structure, steps=True)
    return ca.Function("start", [parameters], [state], ["parameters"], ["state"])


def starts(structure: Structure, vectors: Floats) -> Floats:
    """States before the first sample (runs, states) of parameters (runs, parameters) as the closed loop takes them."""
    function = _mapped(structure, len(vectors))
    states = np.empty((len(vectors), function.size1_out(0)))
    buffer, evaluate = function.buffer()  # arrays in and out take CasADi longer than this function
    buffer.set_arg(0, np.ascontiguousarray(vectors).reshape(-1).data)  # pyright: ignore[reportCallIssue]
    buffer.set_res(0, states.reshape(-1).data)  # pyright: ignore[reportCallIssue]
    evaluate()
    return states


@built_once
def _mapped(structure: Structure, count: int) -> ca.Function:
    return start_function(structure).map(count)


@built_once
def start_slopes(structure: Structure) -> ca.Function:
    """``start_slopes(parameters) -> slopes``, (states, parameters): the same derived, of encoders without steps."""
    parameters, state = _start(structure, steps=False)
    return ca.Function("start_slopes", [parameters], [ca.densify(ca.jacobian(state, parameters))])


def _start(structure: Structure, *, steps: bool) -> tuple[ca.SX, ca.SX]:
    template = template_of(structure)
    symbols = {name: ca.SX.sym(name) for name in parameters_of(template)}
    sensors = symbols if steps else {**symbols, "sensors.encoder_counts": 0, "sensors.position_resolution": 0.0}
    state = starting_state(
        structure,
        with_leaves(template.controller, symbols, "controller."),
        with_leaves(template.plant, symbols, "plant."),
        with_leaves(Sensors(), sensors, "sensors."),
        with_leaves(template.actuator, symbols, "actuator."),
        [with_leaves(metric, symbols, "metrics.") for metric in template.metrics],
    )
    return ca.vertcat(*symbols.values()), ca.densify(ca.vertcat(*state.values()))
