"""Exact linearisation of the sampled closed loop, whole or cut open.

One sample of plant and controller is a map from state to state. Its Jacobian at steady cruise tells how deviations
from the moving steady trajectory go on. In a cruise the rope lengths are frozen at the point, so the system holds for
motions that are quick against length/v.
"""

from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.source.expressions import built_once
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import nearest
from dualwinch.simulation.analysis.loop_cruise import LoopCruise, loop_cruise, with_taut_ropes
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import CUTS, closed_loop, initial_loop_state
from dualwinch.simulation.loop.structure import Structure, structure_of
from dualwinch.simulation.rows import COLUMNS

Floats = NDArray[np.float64]

INPUTS = {
    "reference.x": ("x_ref", "m"),
    "reference.v": ("v_ref", "m/s"),
    "reference.a": ("a_ref", "m/s^2"),
    "current": ("current", "m/s"),
    "normal_force_variation": ("normal_force_variation", "N"),
    "force": ("force", "N"),
    "noise.position": ("position_noise", "m"),
    "noise.speed": ("speed_noise", "m/s"),
    "noise.tension_1": ("tension_1_noise", "N"),
    "noise.tension_2": ("tension_2_noise", "N"),
}
"""Signal from outside → its name and unit as an input of the closed loop."""

OUTPUTS = ("x", "v", "e", "F1", "F2", "u", "tau_1", "tau_2")
"""Columns of a result that are outputs of the closed loop, beside the controller's own signals."""


def linear_closed_loop(experiment: Experiment, x: float = 25.0, v: float = 0.0) -> LinearSystem:
    """The closed loop over one sample, around steady cruise.

    States are those of plant and controller that move anything; see `INPUTS` and `OUTPUTS`. Its matrices are exact
    Jacobians of the step that is simulated, with perfect sensors and calm sea; noises are inputs.

    Args:
        experiment: plant, gains, sample time and delay.
        x: position in m.
        v: speed in m/s.

    Raises:
        ConfigurationError: no steady cruise there (see `simulation.analysis.loop_cruise.loop_cruise`).
    """
    cruise = loop_cruise(experiment, x, v)
    loop = cruise.loop
    A, B, C, D = _jacobians(structure_of_cruise(cruise), "")(cruise.state, cruise.exogenous, cruise.parameters)
    outputs = [*OUTPUTS, *(name for name in loop.columns if name not in COLUMNS)]
    rows, columns = [loop.columns.index(name) for name in outputs], [loop.exogenous.index(name) for name in INPUTS]
    matrices = (A.full(), B.full()[:, columns], C.full()[rows], D.full()[np.ix_(rows, columns)])
    units = {name: loop.quantities[name].unit for name in outputs} | dict(INPUTS.values())
    inputs = tuple(name for name, _ in INPUTS.values())
    return without_idle_states(_named(cruise, matrices, inputs, tuple(outputs), units))


def linear_broken_loop(
    experiment: Experiment, x: float = 25.0, v: float = 0.0, cut: str = "u", nominal: Plant | None = None
) -> LinearSystem:
    """The loop cut at one signal: from what leaves the cut to minus what comes back to it.

    The sign is that of negative feedback: closing the loop gives 1/(1 + L).

    Args:
        experiment: plant, gains, sample time and delay.
        x: position in m.
        v: speed in m/s.
        cut: ``u``, the position law's force command; ``tau_1`` or ``tau_2``, a winch's torque.
        nominal: the plant the controller was designed for; default: the experiment's.

    Raises:
        ConfigurationError: another cut, or no steady cruise there.
    """
    return without_idle_states(whole_broken_loop(experiment, x, v, cut, nominal))


def whole_broken_loop(
    experiment: Experiment, x: float, v: float, cut: str, nominal: Plant | None = None
) -> LinearSystem:
    """`linear_broken_loop` with all states, also those that move nothing: the same for all values of the gains."""
    if cut not in CUTS:
        raise ConfigurationError(f"unknown cut '{cut}'; did you mean '{nearest(cut, CUTS)}'?")
    cruise = loop_cruise(experiment, x, v, nominal)
    column = CUTS[cut]
    steady = cruise.row[column]
    A, B, C, D = _jacobians(structure_of_cruise(cruise), cut)(cruise.state, cruise.exogenous, cruise.parameters, steady)
    row = [cruise.loop.columns.index(column)]
    unit = cruise.loop.quantities[column].unit
    names = f"{cut}_in", f"{cut}_out"
    matrices = (A.full(), B.full(), -C.full()[row], -D.full()[row])
    return _named(cruise, matrices, names[:1], names[1:], dict.fromkeys(names, unit))


def structure_of_cruise(cruise: LoopCruise) -> Structure:
    """The structure that was linearised: ropes taut."""
    return with_taut_ropes(structure_of(cruise.experiment))


@built_once
def _jacobians(structure: Structure, cut: str) -> ca.Function:
    """``(state, exogenous, parameters[, cut]) -> A, B, C, D`` of a step; B and D are for the cut where there is one."""
    step = closed_loop(structure, cuts=(cut,) if cut else ()).step
    symbols = [ca.SX.sym(name, step.size1_in(name)) for name in step.name_in()]
    following, row, _ = step(*symbols)
    state, outside = symbols[0], symbols[3] if cut else symbols[1]
    wanted = [ca.jacobian(value, by) for value in (following, row) for by in (state, outside)]
    return ca.Function("jacobians", symbols, wanted)


def _named(
    cruise: LoopCruise,
    matrices: tuple[Floats, Floats, Floats, Floats],
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    units: dict[str, str],
) -> LinearSystem:
    """A system of all states."""
    names, state_units = state_names(cruise)
    return LinearSystem(
        *matrices,
        dt=cruise.experiment.simulation.sample_time,
        states=tuple(names),
        inputs=inputs,
        outputs=outputs,
        units=units | state_units,
        operating_point=cruise.row
        | {"preload": cruise.experiment.controller.limits.preload, "residual": cruise.residual},
    )


def without_idle_states(system: LinearSystem) -> LinearSystem:
    """The system of the states that matter: something depends on them, and they move.

    A state that keeps its value whatever happens, such as an integral without a gain, stays where the cruise has it.
    """
    A, B, C = system.A, system.B, system.C
    matters = C.any(axis=0)
    while True:
        grown = matters | A[matters].any(axis=0)
        if (grown == matters).all():
            break
        matters = grown
    moves = A.any(axis=1) & (np.eye(len(A)) != A).any(axis=1)
    matters &= moves | B.any(axis=1)
    kept = np.flatnonzero(matters)
    states = tuple(system.states[index] for index in kept)
    idle = set(system.states) - set(states)
    units = {name: unit for name, unit in system.units.items() if name not in idle - {*system.inputs, *system.outputs}}
    return replace(system, A=A[np.ix_(kept, kept)], B=B[kept], C=C[:, kept], states=states, units=units)


def state_names(cruise: LoopCruise) -> tuple[list[str], dict[str, str]]:
    """Short names of the closed loop's states, and their units by these names."""
    experiment = cruise.experiment
    start = initial_loop_state(
        structure_of(experiment), experiment.controller, experiment.plant, experiment.sensors, experiment.actuator
    )
    known = describe_parts(start)
    names, units = [], {}
    for state in cruise.loop.states:
        name = state
        for prefix in ("motion.plant.", "controller.law.", "controller.coordination.", "controller."):
            if state.startswith(prefix):
                name = state.removeprefix(prefix)
                break
        torque = state.startswith("queue.")
        names.append(name)
        units[name] = "N m" if torque else known[state].quantity.unit if state in known else "1"
    return names, units
