"""Export controller, plant and closed loop as blocks for other tools, with the equations that `simulate` runs."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias, get_args

import annotated_types as at
import casadi as ca
import numpy as np

from dualwinch.codegen.block import Block, Variable
from dualwinch.controllers.controller import Controller, controller_step, initial_controller_state, own_signals
from dualwinch.controllers.parts import Measurement
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.motions import Previewed
from dualwinch.model.plant import (
    DisturbanceInputs,
    Plant,
    PlantState,
    Torques,
    blank_state,
    holding_torques,
    resting_state,
    shaft_torques,
    tensions,
)
from dualwinch.model.quantities.description import describe, describe_parts
from dualwinch.model.quantities.quantity import Leaf, Quantity, unknown
from dualwinch.model.quantities.tree import leaves, rules, with_leaves
from dualwinch.model.reference import Setpoint
from dualwinch.model.ropes import rope_lengths
from dualwinch.model.scalar import Scalar
from dualwinch.model.winch import total_inertia
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.integrators import INTEGRATORS, Motion, Problem
from dualwinch.simulation.loop.closed_loop import closed_loop, initial_loop_state, starting_state, zero_exogenous
from dualwinch.simulation.loop.structure import solver_of, structure_of, symbolic_parts
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.rows import COLUMNS

Scalars: TypeAlias = dict[str, Scalar]
Facts: TypeAlias = dict[str, tuple[Quantity, tuple[float, float]]]
"""Variable name → quantity and range."""

PHASE, SAMPLE, SLOW = "phase", "sample", "slow"
"""States in addition to the plant's; the last is memory of an integrator, not a state of the continuous plant."""

ANY = (-np.inf, np.inf)
SATURATED = Quantity("1", "1 where the force command is beyond its limit")
SAMPLE_NUMBER = Quantity("1", "number of the sample"), ANY


@dataclass(frozen=True)
class Equations:
    """A block's equations, over symbols.

    Attributes:
        state, input: the symbols by name.
        initial, next_state, output: expressions by name; `output` may depend on the input.
        about: quantities and ranges of states, inputs and outputs.
        output_now: the output from the state before the step, if it does not depend on the input.
        nominal: nominal magnitudes of states relative to each other, where they are not 1.
        derivative: time derivative of the continuous states, which come first; only for a continuous system.
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


def _new(names: Iterable[str]) -> Scalars:
    return {name: ca.SX.sym(name) for name in names}


def _facts(described: Mapping[str, Leaf]) -> Facts:
    return {name: (leaf.quantity, leaf.bounds) for name, leaf in described.items()}


def reference_inputs(controller: Controller) -> Facts:
    """Setpoints as inputs of a controller: the present one, and one for each preview time."""
    of_now = {name: COLUMNS[name] for name in ("x_ref", "v_ref", "a_ref")}
    ahead = {
        f"{name}_ahead_{number}": replace(quantity, meaning=f"{quantity.meaning} {time:g} s ahead")
        for number, time in enumerate(controller.preview, start=1)
        for name, quantity in of_now.items()
    }
    return {name: (quantity, ANY) for name, quantity in (of_now | ahead).items()}


def controller_equations(experiment: Experiment, symbols: Scalars) -> Equations:
    """One sample of the controller: from sensor values and reference to torques and internal signals."""
    parts = symbolic_parts(experiment, symbols)
    start = initial_controller_state(experiment.controller, experiment.reference.start)
    state, sensed = _new(leaves(start)), _new(describe(Measurement))
    references = reference_inputs(experiment.controller)
    setpoints = _new(references)
    elements = iter(setpoints.values())
    point, *ahead = (Setpoint(*each) for each in zip(elements, elements, elements, strict=True))
    following, output = controller_step(
        with_leaves(start, state),
        Measurement(**sensed),
        Previewed(**vars(point), known=dict(zip(experiment.controller.preview, ahead, strict=True))),
        parts.controller,
        with_leaves(structure_of(experiment).nominal, symbols, "nominal."),
        symbols["simulation.sample_time"],
    )
    winches, position, signals_of_law = output.winches, output.position, own_signals(output)
    flat = {"tau_1": winches.tau_1, "tau_2": winches.tau_2, "F1_cmd": winches.F1_cmd, "F2_cmd": winches.F2_cmd}
    flat |= {"u": position.u, "u_sat": position.u_sat} | {name: value for name, (value, _) in signals_of_law.items()}
    flat |= {"saturated": output.saturated, "torque_saturated": winches.torque_saturated}
    about = _facts(describe_parts(winches)) | _facts(describe_parts(position))
    about |= {name: (quantity, ANY) for name, (_, quantity) in signals_of_law.items()} | {"saturated": (SATURATED, ANY)}
    return Equations(
        state=state,
        input=sensed | setpoints,
        initial=leaves(start),
        next_state=leaves(following),
        output=flat,
        about=(_facts(describe_parts(start)), _facts(describe(Measurement)) | references, about),
    )


def plant_equations(experiment: Experiment, symbols: Scalars) -> Equations:
    """One sample of the plant as `simulate` integrates it, and its time derivative."""
    parts = symbolic_parts(experiment, symbols)
    plant = parts.plant
    still = Motion(blank_state(plant))
    state = _new((*leaves(still.plant), PHASE, SAMPLE, SLOW))
    torques, sea = _new(describe(Torques)), _new(describe(DisturbanceInputs))
    sample_time = symbols["simulation.sample_time"]
    motion = with_leaves(still, {f"plant.{name}": state[name] for name in state} | state)
    t, here = state[SAMPLE] * sample_time, motion.plant
    problem = Problem(
        t=t,
        duration=sample_time,
        torques=shaft_torques(Torques(**torques), here, plant, sample_time / 2),
        environment=DisturbanceInputs(**sea),
        disturbance=parts.disturbance,
        plant=plant,
    )
    solver = solver_of(experiment)
    end = INTEGRATORS[solver.integrator].advance(problem, motion, solver.substeps)
    problem_now = replace(problem, torques=shaft_torques(Torques(**torques), here, plant))
    slope = problem_now.derivative(t, motion)

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
        initial=leaves(resting_state(parts.controller.limits.preload, plant, experiment.reference.start))
        | dict.fromkeys((PHASE, SAMPLE, SLOW), 0.0),
        next_state=leaves(end.plant) | {PHASE: end.phase, SAMPLE: state[SAMPLE] + 1, SLOW: end.slow},
        output=output(end.plant, t + sample_time),
        about=(
            states,
            _facts(describe(Torques)) | _facts(describe(DisturbanceInputs)),
            states | {name: (COLUMNS[name], ANY) for name in ("F1", "F2")},
        ),
        output_now=output(here, t),
        derivative=leaves(slope.plant) | {PHASE: slope.phase, SAMPLE: 1 / sample_time},
        nominal=_swings(experiment.plant, experiment.controller.limits.preload),
    )


def _swings(plant: Plant, preload: float) -> dict[str, float]:
    """Magnitude of each speed relative to its position: natural frequency at mid-track in rad/s, as a power of ten.

    With one tolerance for both, a solver would demand more accuracy of the speeds than the positions can give.
    """
    lengths = rope_lengths(plant.track.length / 2, plant.track)
    ropes = (plant.rope_1, plant.rope_2)
    rates = [rope.tangent(preload / 2, length)[0] for rope, length in zip(ropes, lengths, strict=True)]
    squares = {"v": sum(rates) / plant.vehicle.mass}
    for number, rate, winch in zip((1, 2), rates, (plant.winch_1, plant.winch_2), strict=True):
        squares[f"omega_{number}"] = rate * winch.drum_radius**2 / total_inertia(winch)
    return {name: 10.0 ** round(math.log10(square) / 2) for name, square in squares.items()}


def _exogenous_facts(controller: Controller) -> Facts:
    """Quantities and ranges of the exogenous signals of the closed loop."""
    calm = zero_exogenous(controller)
    facts = _facts(describe_parts(calm))
    if times := controller.preview:
        for (name, _), time in zip(leaves(calm.ahead, "ahead.").items(), 3 * times, strict=True):
            quantity, allowed = facts[name]
            facts[name] = replace(quantity, meaning=f"{quantity.meaning}, {time:g} s ahead"), allowed
    return facts


def closed_loop_equations(experiment: Experiment, symbols: Scalars) -> Equations:
    """One sample of the closed loop, without the sums behind the figures of merit."""
    structure = structure_of(experiment)
    loop = closed_loop(structure)
    exogenous = _new(loop.exogenous)
    start = starting_state(structure, symbolic_parts(experiment, symbols), experiment.reference.start)
    initial = {name: value for name, value in start.items() if not name.startswith("metrics.")}
    state = _new(initial)
    all_states = ca.vertcat(*(state.get(name, 0) for name in loop.states))
    vectors = ca.vertcat(*exogenous.values()), ca.vertcat(*(symbols[name] for name in loop.parameters))
    next_state, row, _ = loop.step(all_states, *vectors)
    following = dict(zip(loop.states, ca.vertsplit(next_state), strict=True))
    torques = _facts(describe(Torques))
    queue = {name: torques[name.rsplit(".", 1)[1]] for name in initial if name.startswith("queue.")}
    return Equations(
        state=state,
        input=exogenous,
        initial=initial,
        next_state={name: following[name] for name in initial},
        output=dict(zip(loop.columns, ca.vertsplit(row), strict=True)),
        about=(
            _facts(describe_parts(initial_loop_state(structure))) | queue,
            _exogenous_facts(experiment.controller),
            {name: (quantity, ANY) for name, quantity in loop.quantities.items()},
        ),
    )


BlockName: TypeAlias = Literal["controller", "plant", "closed-loop"]
BLOCKS: tuple[BlockName, ...] = get_args(BlockName)


def block(name: str, experiment: Experiment | None = None, nominal: Plant | None = None) -> Block:
    """Build a block of a part of an experiment, with the experiment's values as defaults of its parameters.

    * ``controller``: inputs are sensor values and reference, outputs motor torques and internal signals.
    * ``plant``: inputs are motor torques, current and further forces, outputs motion and tensions. One step is one
      sample of `simulate`; the vortex force follows from the parameters. Torques act without delay, as
      ``simulation.delay_samples`` belongs to the closed loop.
    * ``closed-loop``: inputs are reference, sensor noise, current and forces, output is a row of a result. Figures of
      merit are left out.

    Args:
        name: one of the above.
        experiment: structure and values; default: the paper's Case 2.
        nominal: the plant the controller was designed for; default: the simulated one.

    Raises:
        ConfigurationError: an unknown `name`, or inconsistent values.

    Example:
        >>> import dualwinch as dw
        >>> controller = dw.block("controller", dw.case(2))
        >>> controller.name, [output.name for output in controller.outputs][:2]
        ('controller', ['tau_1', 'tau_2'])
    """
    if name not in BLOCKS:
        raise ConfigurationError(unknown("block", name, BLOCKS))
    experiment = experiment or Experiment()
    values = prepare(experiment, nominal).parameters
    symbols = {name: ca.SX.sym(name) for name in values}
    controller = experiment.controller
    law = f"{controller.law.kind} control, {controller.coordination.kind} coordination"
    build, description = {
        "controller": (controller_equations, f"Controller of a vehicle between two winches ({law})"),
        "plant": (plant_equations, "Vehicle between two winches"),
        "closed-loop": (closed_loop_equations, f"Vehicle between two winches in closed loop ({law})"),
    }[name]
    return _assemble(name.replace("-", "_"), description, build(experiment, symbols), symbols, values, experiment)


def _assemble(
    name: str, description: str, law: Equations, symbols: Scalars, values: dict[str, float], experiment: Experiment
) -> Block:
    """The block of some equations, without inputs and parameters that nothing depends on."""
    arguments = {
        "step": ("state", "input", "parameters"),
        "initial": ("parameters",),
        "output": ("state", "parameters"),
    }
    arguments["derivative"] = arguments["step"]
    results = {
        "step": {"next_state": law.next_state, "output": law.output},
        "initial": {"state": law.initial},
        "output": {"output": law.output_now},
        "derivative": {"dx": law.derivative, "output": law.output_now},
    }
    every = ca.vertcat(*(_column(part) for parts in results.values() for part in parts.values() if part))
    inputs, parameters = _used(law.input, every), _used(symbols, every)
    vectors = {"state": law.state, "input": inputs, "parameters": parameters}

    def function(kind: str) -> ca.Function:
        expressions = [_column(part) for part in results[kind].values()]
        columns = [_column(vectors[name]) for name in arguments[kind]]
        return ca.Function(kind, columns, expressions, [*arguments[kind]], [*results[kind]], {"cse": True})

    step, initial = function("step"), function("initial")
    output = function("output") if law.output_now else None
    numbers = [values[key] for key in parameters]
    state = np.array(initial(numbers)).ravel()
    at_rest = _at_rest(experiment)
    descriptions = structure_of(experiment).parameters
    start = [at_rest.get(key, 0.0) for key in inputs]
    outputs_at_start = output(state, numbers) if output else step(state, start, numbers)[1]
    ruled, requirements = _requirements(experiment, parameters, descriptions)
    of_state, of_input, of_output = law.about
    return Block(
        name=name,
        description=description,
        step=step,
        initial=initial,
        states=tuple(
            replace(variable, nominal=law.nominal.get(variable.name, 1.0))
            for variable in _variables(law.state, state, of_state)
        ),
        inputs=_variables(inputs, start, of_input),
        outputs=_variables(law.output, np.array(outputs_at_start).ravel(), of_output),
        parameters=tuple(_parameter(key, values[key], descriptions[key]) for key in parameters),
        sample_time=experiment.simulation.sample_time,
        output=output,
        derivative=function("derivative") if law.derivative else None,
        silent=experiment.controller.silent & inputs.keys() if name == "controller" else frozenset(),
        rules=ca.Function("rules", [_column(parameters)], [requirements], ["parameters"], ["holds"]) if ruled else None,
        ruled=ruled,
    )


def _requirements(
    experiment: Experiment, parameters: Scalars, described: Mapping[str, Leaf]
) -> tuple[tuple[str, ...], ca.SX]:
    """Requirements on the parameters beyond their ranges: the parameter that each is about, and whether they hold.

    They are that whole numbers are whole, and the rules between the values of a group (`Rule`).

    Raises:
        ConfigurationError: a rule of a part of one's own takes no symbols.
    """
    ruled = [name for name in parameters if described[name].kind is int]
    conditions = [ca.floor(parameters[name]) == parameters[name] for name in ruled]
    parts = symbolic_parts(experiment, parameters)
    nominal = with_leaves(structure_of(experiment).nominal, parameters, "nominal.")
    groups = {f"{name}.": group for name, group in vars(parts).items() if name != "metrics"} | {"nominal.": nominal}
    for prefix, group in groups.items():
        for table, owner, rule in rules(group, prefix):
            try:
                holds = rule.holds(owner)
            except (TypeError, RuntimeError, NotImplementedError) as error:
                raise ConfigurationError(
                    f"{table}{rule.fields[0]}: its rule takes no symbols ({error}); "
                    "join conditions by both() and either()"
                ) from None
            if isinstance(holds, ca.SX) and not holds.is_constant():
                ruled.append(next(key for field in rule.fields if (key := table + field) in parameters))
                conditions.append(holds)
    return tuple(ruled), ca.densify(ca.vertcat(*conditions)) if conditions else ca.SX(0, 1)


def _column(values: Scalars) -> ca.SX:
    return ca.densify(ca.vertcat(*values.values()))


def _used(symbols: Scalars, expressions: ca.SX) -> Scalars:
    needed = ca.which_depends(expressions, ca.vertcat(*symbols.values()), 1, False)  # noqa: FBT003
    return {name: symbol for (name, symbol), used in zip(symbols.items(), needed, strict=True) if used}


def _at_rest(experiment: Experiment) -> dict[str, float]:
    """Sensor values, reference and motor torques at rest before the first sample, by input name."""
    preload, plant, x = experiment.controller.limits.preload, experiment.plant, experiment.reference.start
    state = resting_state(preload, plant, x)
    read = dict(zip(("F1", "F2"), tensions(state, plant), strict=True))
    references = ("reference.x", *reference_inputs(experiment.controller))
    read |= {name: x for name in references if name.partition("_ahead")[0] in {"x_ref", "reference.x"}}
    read |= {f"theta_{number}": angle for number, (angle, _) in enumerate(state.shafts, start=1)}
    return {
        key: float(value) for key, value in (leaves(state) | read | leaves(holding_torques(preload, plant))).items()
    }


def _variables(names: Iterable[str], starts: Iterable[float], about: Facts) -> tuple[Variable, ...]:
    return tuple(
        Variable(name, about[name][0].unit, about[name][0].meaning, float(start), *about[name][1])
        for name, start in zip(names, starts, strict=True)
    )


def _parameter(key: str, value: float, leaf: Leaf) -> Variable:
    """A parameter with its metadata; its source is that of the default, or "configuration"."""
    nominal = key.startswith("nominal.")
    return Variable(
        name=key,
        unit=leaf.quantity.unit or "1",
        description=f"{leaf.quantity.meaning}, nominal value of the controller" if nominal else leaf.quantity.meaning,
        start=value,
        lower=leaf.bounds[0],
        upper=leaf.bounds[1],
        source=leaf.quantity.source if value == leaf.default else "configuration",
        exclusive=any(isinstance(constraint, at.Gt) for constraint in leaf.constraints),
    )
