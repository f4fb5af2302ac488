"""Steady cruise of the sampled closed loop: the state that repeats from sample to sample while the vehicle moves on."""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.source.expressions import built_once
from dualwinch.model.disturbance import Disturbance
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.operating_point import operating_point
from dualwinch.model.linear.operating_point import resistance as resistance_of_plant
from dualwinch.model.plant import Environment, Plant, PlantState, tensions
from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.ropes import Creep
from dualwinch.simulation.check import check
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import ClosedLoop, closed_loop, initial_state_of
from dualwinch.simulation.loop.structure import Structure, parameters_of, structure_of

Floats = NDArray[np.float64]

ITERATIONS = 40
"""Newton steps at most."""

RESIDUAL, STEP = 1e-7, 1e-6
"""Largest change of a state over a sample beyond the cruise's own, and largest step that Newton's method would still
take, both over the state's size.

The change alone says nothing of a state that moves slowly, such as an integral: it may be metres from where it rests.
A drum angle of tens of rad in double precision leaves a tension uncertain by some 1e-8 N.
"""

ROUNDS = 6
"""How many times at most what has been learnt of a machine, and all else, are solved for in turns."""

BOUNDLESS = 1e9
"""A limit that nothing reaches."""

LIMITS = "controller.coordination."
"""What the keys of the limits of a tension begin with."""

UNLIMITED = {f"{LIMITS}tension_min": -BOUNDLESS, f"{LIMITS}tension_max": BOUNDLESS}
"""Values of parameters with which no tension is limited."""

BELIEVING = {"controller.trust.gate": BOUNDLESS, "controller.trust.jump": BOUNDLESS}
"""Values with which an estimator that judges what it reads believes everything."""

PRESSED = 1.0
"""Integral in N s that presses a torque against its limit, where a tension command is at its limit."""


@dataclass(frozen=True)
class LoopCruise:
    """A point of the closed loop around which it is linear.

    Attributes:
        loop: the closed loop with ropes that never go slack: the same wherever they are taut.
        experiment: what it is of, with perfect sensors and no disturbance.
        state, exogenous, parameters: values of the closed loop's vectors.
        row: column → value of the result's row there.
        residual: largest change of a state over a sample beyond the cruise's own, over the state's size.
    """

    loop: ClosedLoop
    experiment: Experiment
    state: Floats
    exogenous: Floats
    parameters: Floats
    row: dict[str, float]
    residual: float


def loop_cruise(experiment: Experiment, x: float, v: float, nominal: Plant | None = None) -> LoopCruise:
    """Solve for steady cruise through a position; at v = 0 that is rest.

    Everything repeats but what the motion itself carries on: positions by ``v Ts``, drums by what keeps the tensions.
    Sensors are taken as perfect and disturbances as absent.

    Args:
        experiment: plant, gains and sample time.
        x: position in m, on the track.
        v: speed in m/s.
        nominal: the plant the controller was designed for, as a `Scenario` has it; default: the simulated one.

    Raises:
        ConfigurationError: a position off the track, a speed whose resistance the ropes cannot overcome, or gains
            with which nothing is steady.
    """
    calm = in_calm(experiment)
    _check(calm, v)
    structure = with_taut_ropes(structure_of(calm))
    loop, values = closed_loop(structure), parameters_of(calm, nominal)
    parameters = loop.vector(values)
    start = _first_guess(calm, loop, parameters, x, v)
    state, exogenous, residual, left = _solved(structure, parameters, *start, v)
    if not (residual < RESIDUAL and left < STEP):
        # a law whose integrals are far off starts at its limits, where it has no slope: first without limits
        believing = values | {name: value for name, value in BELIEVING.items() if name in values}
        solution = _in_turns(structure, loop.vector(believing | UNLIMITED), *start, v)[0]
        taken = [name.startswith(("controller.law.", "controller.estimator.")) for name in loop.states]
        begun = np.where(taken, solution, start[0]), start[1]
        if believing != values:
            begun = _in_turns(structure, loop.vector(believing), *begun, v)[:2]
        state, exogenous, residual, left = _in_turns(structure, parameters, *begun, v)
    row = dict(zip(loop.columns, np.array(loop.step(state, exogenous, parameters)[1]).ravel().tolist(), strict=True))
    _check_solution(calm, row, max(residual / RESIDUAL, left / STEP), v)
    row |= {"x": x, "v": v}  # as asked for, without round-off
    return LoopCruise(
        loop=loop,
        experiment=calm,
        state=state,
        exogenous=exogenous,
        parameters=parameters,
        row=row,
        residual=residual,
    )


def with_taut_ropes(structure: Structure) -> Structure:
    """A structure with ropes that never go slack."""
    return replace(structure, plant=replace(structure.plant, rope_slack=False))


def _in_turns(
    structure: Structure, parameters: Floats, state: Floats, exogenous: Floats, v: float
) -> tuple[Floats, Floats, float, float]:
    """`_solved`, first for all but what has been learnt of the machine, which follows from it.

    An estimate is far from linear in the information that it rests on, and that grows for thousands of samples.
    """
    held = closed_loop(structure).marked(Mark.LEARNT)
    if not held.any():
        return _solved(structure, parameters, state, exogenous, v)
    residual, left = np.inf, np.inf
    for _ in range(ROUNDS):
        state = _learning(structure, parameters, state, exogenous, v)[0]
        state, exogenous, residual, left = _solved(structure, parameters, state, exogenous, v, held=held)
        _, change, step = _learning(structure, parameters, state, exogenous, v)
        residual, left = max(residual, change), max(left, step)
        if residual < RESIDUAL and left < STEP:
            break
    return state, exogenous, residual, left


def _learning(
    structure: Structure, parameters: Floats, state: Floats, exogenous: Floats, v: float
) -> tuple[Floats, float, float]:
    """A state with what is learnt of the machine there; how that changed before, and the step to it (`_solved`).

    First comes what depends on nothing else that is learnt, then what does.
    """
    learnt, found = np.flatnonzero(closed_loop(structure).marked(Mark.LEARNT)), state.copy()
    changes = list[float]()
    for alone in (True, False):
        change, slope, _ = (np.array(value) for value in _residual_function(structure)(found, exogenous, parameters, v))
        among = slope[np.ix_(learnt, learnt)]
        others = ((among != 0) & ~np.eye(len(learnt), dtype=bool)).any(axis=1)
        chosen = learnt[~others] if alone else learnt
        matrix, rest = slope[np.ix_(chosen, chosen)], change.ravel()[chosen]
        changes.append(float(np.max(np.abs(rest) / np.maximum(np.abs(found[chosen]), 1.0), initial=0.0)))
        if not (np.isfinite(matrix).all() and np.isfinite(rest).all()):
            return state, np.inf, np.inf
        found[chosen] += _least_step(matrix, rest)
    step = np.abs(found - state)[learnt] / np.maximum(np.abs(found[learnt]), 1.0)
    return found, max(changes), float(step.max())


def _solved(
    structure: Structure,
    parameters: Floats,
    state: Floats,
    exogenous: Floats,
    v: float,
    held: NDArray[np.bool_] | None = None,
) -> tuple[Floats, Floats, float, float]:
    """Newton's method on state and reference position: both, the residual, and the step that is left.

    Held states stay as they are.
    """
    loop, evaluate = closed_loop(structure), _residual_function(structure)
    state, exogenous = state.copy(), exogenous.copy()
    rows = ~loop.marked(Mark.BOOKKEEPING)
    if held is not None:
        rows &= ~held
    unknown = rows & np.array([name != "motion.plant.x" for name in loop.states])
    index = loop.exogenous.index("reference.x")
    residual, left = np.inf, np.inf
    for _ in range(ITERATIONS):
        change, slope_state, slope_reference = (np.array(value) for value in evaluate(state, exogenous, parameters, v))
        # a state that nothing depends on may grow for ever; one that nothing moves, such as an integral without a gain,
        # is where it began
        counted = rows & slope_state[rows].any(axis=0)
        moved = unknown & counted & slope_state[:, rows].any(axis=1)
        kept, last = change.ravel()[counted], residual
        residual = float(np.max(np.abs(kept) / np.maximum(np.abs(state[counted]), 1.0)))
        matrix = np.column_stack([slope_state[np.ix_(counted, moved)], slope_reference[counted, index]])
        if not (np.isfinite(residual) and np.isfinite(matrix).all()):
            break
        step = _least_step(matrix, kept)
        left = float(np.max(np.abs(step) / np.maximum(np.abs([*state[moved], exogenous[index]]), 1.0)))
        if last < RESIDUAL and residual >= last / 2 and left < STEP:
            break
        state[moved] += step[:-1]
        exogenous[index] += step[-1]
    return state, exogenous, residual, left


def _least_step(matrix: Floats, change: Floats) -> Floats:
    """Newton step, in units in which rows and columns are of one size; zero along what moves nothing."""
    rows, columns = np.ones(matrix.shape[0]), np.ones(matrix.shape[1])
    for _ in range(4):
        scaled = np.abs(matrix / rows[:, None] * columns)
        rows *= np.where(scaled.any(axis=1), np.sqrt(scaled.max(axis=1)), 1.0)
        columns /= np.where(scaled.any(axis=0), np.sqrt(scaled.max(axis=0)), 1.0)
    return columns * np.linalg.lstsq(matrix / rows[:, None] * columns, -change / rows, rcond=1e-13)[0]


def in_calm(experiment: Experiment) -> Experiment:
    """The experiment in calm water, with perfect sensors, and without what no motion is steady with.

    What goes round with drums and motors, eccentricity and ripple, and creeping ropes are disturbances of a loop, no
    part of it.
    """
    # a noise of 1 makes the noise inputs of the linear system readings in the sensor's unit
    sensors = replace(
        experiment.sensors,
        position_noise=1.0,
        position_resolution=0.0,
        position_drift=0.0,
        outage_length=0.0,
        speed_noise=1.0,
        tension_noise=1.0,
        encoder_counts=0,
    )
    simulation = replace(experiment.simulation, jitter=0.0)
    plant = experiment.plant
    still = {"eccentricity": 0.0, "torque_ripple": 0.0}
    winch_1, winch_2 = replace(plant.winch_1, **still), replace(plant.winch_2, **still)
    plant = replace(plant, winch_1=winch_1, winch_2=winch_2, creep_1=Creep(), creep_2=Creep())
    return replace(experiment, plant=plant, disturbance=Disturbance(), sensors=sensors, simulation=simulation)


def _check(experiment: Experiment, v: float) -> None:
    check(experiment)
    limit, needed = experiment.controller.limits.force, resistance(experiment, v)
    if not abs(needed) < limit:
        raise ConfigurationError(
            f"v = {v:g}: cruise needs a force of {needed:.4g} N, must be within ±{limit:g} N "
            "(tension_max - reserve - tension_min)"
        )


def resistance(experiment: Experiment, v: float) -> float:
    """Net force in N that the ropes have to give at a steady speed."""
    return float(resistance_of_plant(v, Environment(), experiment.plant))


def _check_solution(experiment: Experiment, row: dict[str, float], excess: float, v: float) -> None:
    kind = experiment.controller.law.kind
    if not excess < 1:
        raise ConfigurationError(f"v = {v:g}: '{kind}' with these gains comes to no steady cruise")
    if row["u"] != row["u_sat"] or min(row["F1"], row["F2"]) <= 0:
        raise ConfigurationError(
            f"v = {v:g}: steady cruise of '{kind}' is beyond its limits: force command {row['u']:.4g} N, "
            f"tensions {row['F1']:.4g} and {row['F2']:.4g} N"
        )


def _first_guess(
    experiment: Experiment, loop: ClosedLoop, parameters: Floats, x: float, v: float
) -> tuple[Floats, Floats]:
    """The steady cruise of a perfect controller: no errors, tensions as commanded."""
    plant, limits = experiment.plant, experiment.controller.limits
    point = operating_point(x, v, limits.preload, plant, tension_min=limits.tension_min, tension_max=limits.command_max)
    guess = dict.fromkeys(loop.states, 0.0) | initial_state_of(experiment) | leaves(point.state, "motion.plant.")
    state = np.array([guess[name] for name in loop.states])
    state[loop.marked(Mark.POSITION)], state[loop.marked(Mark.SPEED)] = x, v
    outside = dict.fromkeys(loop.exogenous, 0.0) | {"reference.x": x, "reference.v": v}
    signals = np.array([outside[name] for name in loop.exogenous])
    # what remembers the last sample, or whether there was one, knows it after two
    remembers = np.array([name.startswith(("controller.", "actuator_")) for name in loop.states])
    remembers &= ~loop.marked(Mark.POSITION, Mark.SPEED)
    for _ in range(2):
        state = np.where(remembers, np.array(loop.step(state, signals, parameters)[0]).ravel(), state)
    pressed = _pressed_integrals(guess, point.F1 - point.F2, experiment)
    return np.array([pressed.get(name, value) for name, value in zip(loop.states, state, strict=True)]), signals


def _pressed_integrals(guess: dict[str, float], force: float, experiment: Experiment) -> dict[str, float]:
    """Integrals of the winches whose command is at a limit.

    The torque limit is that of the command too: such a winch rests on the very edge of its limit, and any ripple
    leaves its integral on the far side of it. There it holds its torque, which is what it does in a run.
    """
    limits = experiment.controller.limits
    wanted = {"winch_1": (limits.preload + force) / 2, "winch_2": (limits.preload - force) / 2}
    found = {}
    for winch, command in wanted.items():
        key = f"controller.coordination.{winch}.integral"
        if key in guess and not limits.tension_min < command < limits.command_max:
            found[key] = -PRESSED if command <= limits.tension_min else PRESSED
    return found


@built_once
def _residual_function(structure: Structure) -> ca.Function:
    """``(state, exogenous, parameters, v) -> (change, d change/d state, d change/d exogenous)`` over a sample.

    The change of a position is that beyond ``v Ts``; in a drum angle's place stands its rope's change of tension.
    """
    loop = closed_loop(structure)
    sizes = {"state": len(loop.states), "exogenous": len(loop.exogenous), "parameters": len(loop.parameters)}
    symbols = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    v = ca.SX.sym("v")
    following = loop.step(*symbols.values())[0]
    values = dict(zip(loop.parameters, ca.vertsplit(symbols["parameters"]), strict=True))
    plant = with_leaves(structure.plant, values, "plant.")

    def forces(vector: ca.SX) -> tuple[ca.SX, ca.SX]:
        of_state = dict(zip(loop.states, ca.vertsplit(vector), strict=True))
        return tensions(PlantState(*(of_state[f"motion.plant.{key}"] for key in PlantState.__annotations__)), plant)

    moving = loop.marked(Mark.POSITION)
    before, after = forces(symbols["state"]), forces(following)
    changes = []
    for index, name in enumerate(loop.states):
        change = following[index] - symbols["state"][index]
        if name in {"motion.plant.theta_1", "motion.plant.theta_2"}:
            rope = int(name[-1]) - 1
            change = (after[rope] - before[rope]) * 1e-3
        elif moving[index]:
            change = (change - v * values["simulation.sample_time"]) * 1e3
        changes.append(change)
    change = ca.vertcat(*changes)
    slopes = [ca.jacobian(change, symbols["state"]), ca.jacobian(change, symbols["exogenous"])]
    return ca.Function("steady", [*symbols.values(), v], [change, *slopes])
