"""Equations of controller, plant and closed loop over symbols, from the functions that `simulate` runs."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import casadi as ca
import numpy as np

from dualwinch.controllers.controller import Controller, controller_step, initial_controller_state, own_signals
from dualwinch.controllers.nominal import nominal_structure
from dualwinch.controllers.signals import Measurement
from dualwinch.model.motions import Previewed
from dualwinch.model.plant import (
    Environment,
    Plant,
    PlantState,
    Torques,
    resting_state,
    shaft_torques,
    tensions,
    torques_amid,
)
from dualwinch.model.quantities.description import describe, describe_parts
from dualwinch.model.quantities.quantity import Leaf, Quantity
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.reference import Setpoint
from dualwinch.model.ropes import rope_lengths
from dualwinch.model.scalar import Scalar
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.integrators import INTEGRATORS, Motion, Problem
from dualwinch.simulation.integrators.solver import solver_of
from dualwinch.simulation.loop.closed_loop import closed_loop, initial_loop_state, nothing_from_outside, starting_state
from dualwinch.simulation.loop.row import COLUMNS
from dualwinch.simulation.loop.structure import structure_of

Scalars: TypeAlias = dict[str, Scalar]
Facts: TypeAlias = dict[str, tuple[Quantity, tuple[float, float]]]
"""Variable name → what it is and the range it may take."""

PHASE, SAMPLE, SLOW = "phase", "sample", "slow"
"""What moves beside the plant's own state; the last is an integrator's memory and no part of the continuous plant."""

ANY = (-np.inf, np.inf)
SATURATED = Quantity("1", "1 where the force command is beyond its limit")
SAMPLE_NUMBER = Quantity("1", "number of the sample"), ANY


@dataclass(frozen=True)
class Equations:
    """A block's equations, over symbols.

    Attributes:
        state, input: the symbols by name.
        initial, next_state, output: expressions by name; `output` may depend on the input.
        about: what states, inputs and outputs are.
        output_now: the output from the state before the step, where it does not depend on the input.
        nominal: sizes of states beside the others, where they are not 1.
        derivative: by time of the states that are continuous, which come first; of a continuous system.
    """

    state: Scalars
    input: Scalars
    initial: Scalars
    next_state: Scalars
    output: Scalars
    about: tuple[Facts, Facts, Facts]
    output_now: Scalars | None = None
    derivative: Scalars | None = None
    nominal: dict[str, float] = field(default_factory=dict)


def _symbolic(experiment: Experiment, symbols: Scalars) -> tuple[Controller, Plant, Plant]:
    """Controller, plant and believed plant of an experiment with symbols for their numbers."""
    return (
        with_leaves(experiment.controller, symbols, "controller."),
        with_leaves(experiment.plant, symbols, "plant."),
        with_leaves(nominal_structure(experiment.plant), symbols, "nominal."),
    )


def _new(names: Iterable[str]) -> Scalars:
    return {name: ca.SX.sym(name) for name in names}


def _facts(described: Mapping[str, Leaf]) -> Facts:
    return {name: (leaf.quantity, leaf.bounds) for name, leaf in described.items()}


def reference_inputs(controller: Controller) -> Facts:
    """Setpoints as inputs of a controller: of now, and of each time of its preview."""
    of_now = {name: COLUMNS[name] for name in ("x_ref", "v_ref", "a_ref")}
    ahead = {
        f"{name}_ahead_{number}": replace(quantity, meaning=f"{quantity.meaning} {time:g} s ahead")
        for number, time in enumerate(controller.preview, start=1)
        for name, quantity in of_now.items()
    }
    return {name: (quantity, ANY) for name, quantity in (of_now | ahead).items()}


def _setpoint(wanted: Sequence[Scalar], times: Sequence[float]) -> Previewed:
    """The setpoint of `reference_inputs`."""
    points = [Setpoint(*wanted[first : first + 3]) for first in range(0, len(wanted), 3)]
    return Previewed(**vars(points[0]), known=dict(zip(times, points[1:], strict=True)))


def controller_equations(experiment: Experiment, symbols: Scalars) -> Equations:
    """One sample of the controller: sensor values and reference in, torques and inner signals out."""
    controller, _, nominal = _symbolic(experiment, symbols)
    start = initial_controller_state(experiment.controller)
    state, sensed = _new(leaves(start)), _new(describe(Measurement))
    references = reference_inputs(experiment.controller)
    wanted = _new(references)
    following, output = controller_step(
        with_leaves(start, state),
        Measurement(**sensed),
        _setpoint(list(wanted.values()), experiment.controller.preview),
        controller,
        nominal,
        symbols["simulation.sample_time"],
    )
    winches, position, own = output.winches, output.position, own_signals(output)
    flat = {"tau_1": winches.tau_1, "tau_2": winches.tau_2, "F1_cmd": winches.F1_cmd, "F2_cmd": winches.F2_cmd}
    flat |= {"u": position.u, "u_sat": position.u_sat} | {name: value for name, (value, _) in own.items()}
    flat |= {"saturated": output.saturated, "torque_saturated": winches.torque_saturated}
    about = _facts(describe_parts(winches)) | _facts(describe_parts(position))
    about |= {name: (quantity, ANY) for name, (_, quantity) in own.items()} | {"saturated": (SATURATED, ANY)}
    return Equations(
        state=state,
        input=sensed | wanted,
        initial=leaves(start),
        next_state=leaves(following),
        output=flat,
        about=(_facts(describe_parts(start)), _facts(describe(Measurement)) | references, about),
    )


def plant_equations(experiment: Experiment, symbols: Scalars) -> Equations:
    """One sample of the plant as `simulate` integrates it, and its time derivative."""
    controller, plant, _ = _symbolic(experiment, symbols)
    state = _new((*describe(PlantState), PHASE, SAMPLE, SLOW))
    torques, sea = _new(describe(Torques)), _new(describe(Environment))
    sample_time = symbols["simulation.sample_time"]
    motion = with_leaves(Motion(PlantState(0, 0, 0, 0, 0, 0)), {f"plant.{name}": state[name] for name in state} | state)
    t, here = state[SAMPLE] * sample_time, motion.plant
    problem = Problem(
        t=t,
        duration=sample_time,
        torques=torques_amid(Torques(**torques), here, sample_time, plant),
        environment=Environment(**sea),
        disturbance=with_leaves(experiment.disturbance, symbols, "disturbance."),
        plant=plant,
    )
    solver = solver_of(experiment)
    moved = INTEGRATORS[solver.integrator].advance(problem, motion, solver.substeps)
    held = replace(problem, torques=shaft_torques(Torques(**torques), here.theta_1, here.theta_2, plant))
    slope = held.derivative(t, motion)

    def output(at: PlantState, when: Scalar) -> Scalars:
        return leaves(at) | dict(zip(("F1", "F2"), tensions(at, plant, when), strict=True))

    states = (
        _facts(describe_parts(motion.plant))
        | _facts({name: describe_parts(motion)[name] for name in (PHASE, SLOW)})
        | {SAMPLE: SAMPLE_NUMBER}
    )
    return Equations(
        state=state,
        input=torques | sea,
        initial=leaves(resting_state(controller.limits.preload, plant)) | dict.fromkeys((PHASE, SAMPLE, SLOW), 0.0),
        next_state=leaves(moved.plant) | {PHASE: moved.phase, SAMPLE: state[SAMPLE] + 1, SLOW: moved.slow},
        output=output(moved.plant, t + sample_time),
        about=(
            states,
            _facts(describe(Torques)) | _facts(describe(Environment)),
            states | {name: (COLUMNS[name], ANY) for name in ("F1", "F2")},
        ),
        output_now=output(here, t),
        derivative=leaves(slope.plant) | {PHASE: slope.phase, SAMPLE: 1 / sample_time},
        nominal=_swings(experiment.plant, experiment.controller.limits.preload),
    )


def _swings(plant: Plant, preload: float) -> dict[str, float]:
    """Size of each speed beside its position: the frequency in rad/s of the ropes' swing amid the track, in decades.

    A solver that allows both the same error would ask more of the speeds than the positions can give.
    """
    lengths = rope_lengths(plant.track.length / 2, plant.track)
    ropes = (plant.rope_1, plant.rope_2)
    rates = [rope.tangent(preload / 2, length)[0] for rope, length in zip(ropes, lengths, strict=True)]
    squares = {"v": sum(rates) / plant.vehicle.mass}
    for number, rate, winch in zip((1, 2), rates, (plant.winch_1, plant.winch_2), strict=True):
        squares[f"omega_{number}"] = rate * winch.drum_radius**2 / winch.inertia
    return {name: 10.0 ** round(math.log10(square) / 2) for name, square in squares.items()}


def _outside(controller: Controller) -> Facts:
    """What the signals are that the closed loop receives."""
    calm = nothing_from_outside(controller)
    found = _facts(describe_parts(calm))
    if times := controller.preview:
        for (name, _), time in zip(leaves(calm.ahead, "ahead.").items(), 3 * times, strict=True):
            quantity, allowed = found[name]
            found[name] = replace(quantity, meaning=f"{quantity.meaning}, {time:g} s ahead"), allowed
    return found


def closed_loop_equations(experiment: Experiment, symbols: Scalars) -> Equations:
    """One sample of the closed loop, without the sums behind the figures of merit."""
    structure = structure_of(experiment)
    loop = closed_loop(structure)
    exogenous = _new(loop.exogenous)
    start = starting_state(
        structure,
        *_symbolic(experiment, symbols)[:2],
        with_leaves(experiment.sensors, symbols, "sensors."),
        with_leaves(experiment.actuator, symbols, "actuator."),
    )
    initial = {name: value for name, value in start.items() if not name.startswith("metrics.")}
    state = _new(initial)
    all_states = ca.vertcat(*(state.get(name, 0) for name in loop.states))
    vectors = ca.vertcat(*exogenous.values()), ca.vertcat(*(symbols[name] for name in loop.parameters))
    next_state, row, _ = loop.step(all_states, *vectors)
    following = dict(zip(loop.states, ca.vertsplit(next_state), strict=True))
    parts = initial_loop_state(
        structure, experiment.controller, experiment.plant, experiment.sensors, experiment.actuator
    )
    torques = _facts(describe(Torques))
    queue = {name: torques[name.rsplit(".", 1)[1]] for name in initial if name.startswith("queue.")}
    return Equations(
        state=state,
        input=exogenous,
        initial=initial,
        next_state={name: following[name] for name in initial},
        output=dict(zip(loop.columns, ca.vertsplit(row), strict=True)),
        about=(
            _facts(describe_parts(parts)) | queue,
            _outside(experiment.controller),
            {name: (quantity, ANY) for name, quantity in loop.quantities.items()},
        ),
    )
