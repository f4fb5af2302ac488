"""Controller, plant and closed loop as blocks for other people's tools, from the functions that `simulate` runs."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Literal, TypeAlias, get_args

import annotated_types as at
import casadi as ca
import numpy as np

from dualwinch.codegen.block import Block, Variable
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant, holding_torques, resting_state, tensions
from dualwinch.model.quantities.quantity import Leaf, nearest
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.check import check
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.equations import (
    Equations,
    Facts,
    Scalars,
    closed_loop_equations,
    controller_equations,
    plant_equations,
)
from dualwinch.simulation.loop.structure import described_parameters, parameters_of, structure_of

BlockName: TypeAlias = Literal["controller", "plant", "closed-loop"]
BLOCKS: tuple[BlockName, ...] = get_args(BlockName)


def block(name: str, experiment: Experiment | None = None, nominal: Plant | None = None) -> Block:
    """A part of an experiment as a block, with the experiment's values as its parameters' own.

    * ``controller``: sensor values and reference in, motor torques and inner signals out.
    * ``plant``: motor torques, current and further forces in; motion and tensions out. One step is one sample of
      `simulate`; the vortex force comes from the parameters. Torques arrive at once: ``simulation.delay_samples``
      belongs to the closed loop.
    * ``closed-loop``: reference, sensor noise and sea in; a row of a result out. Figures of merit are left out.

    Args:
        name: one of these.
        experiment: structure and values (default: the paper's Case 2).
        nominal: the plant the controller was designed for; default: the simulated one.

    Raises:
        ConfigurationError: an unknown `name`, or values that do not fit together.
    """
    if name not in BLOCKS:
        raise ConfigurationError(
            f"unknown block '{name}': must be {', '.join(BLOCKS)}; did you mean '{nearest(name, BLOCKS)}'?"
        )
    experiment = experiment or Experiment()
    check(experiment)
    values = parameters_of(experiment, nominal)
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
    """The block of a law, without the inputs and parameters that nothing depends on."""
    given = {"step": ("state", "input", "parameters"), "initial": ("parameters",), "output": ("state", "parameters")}
    given["derivative"] = given["step"]
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
        expressions = [_column(part) for part in results[kind].values() if part]
        columns = [_column(vectors[name]) for name in given[kind]]
        return ca.Function(kind, columns, expressions, [*given[kind]], [*results[kind]], {"cse": True})

    step, initial = function("step"), function("initial")
    output = function("output") if law.output_now else None
    numbers = [values[key] for key in parameters]
    state = np.array(initial(numbers)).ravel()
    at_rest = _at_rest(experiment)
    known = described_parameters(structure_of(experiment))
    start = [at_rest.get(key, 0.0) for key in inputs]
    first = output(state, numbers) if output else step(state, start, numbers)[1]
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
        outputs=_variables(law.output, np.array(first).ravel(), of_output),
        parameters=tuple(_parameter(key, values[key], known[key]) for key in parameters),
        sample_time=experiment.simulation.sample_time,
        output=output,
        derivative=function("derivative") if law.derivative else None,
        silent=experiment.controller.estimator.silent & inputs.keys() if name == "controller" else frozenset(),
    )


def _column(values: Scalars) -> ca.SX:
    return ca.densify(ca.vertcat(*values.values()))


def _used(symbols: Scalars, expressions: ca.SX) -> Scalars:
    needed = ca.which_depends(expressions, ca.vertcat(*symbols.values()), 1, False)  # noqa: FBT003
    return {name: symbol for (name, symbol), used in zip(symbols.items(), needed, strict=True) if used}


def _at_rest(experiment: Experiment) -> dict[str, float]:
    """Sensor values and motor torques at rest before the first sample, by the names of inputs."""
    preload, plant = experiment.controller.limits.preload, experiment.plant
    rest = resting_state(preload, plant)
    forces = dict(zip(("F1", "F2"), tensions(rest, plant), strict=True))
    return {
        key: float(value) for key, value in (leaves(rest) | forces | leaves(holding_torques(preload, plant))).items()
    }


def _variables(names: Iterable[str], starts: Iterable[float], about: Facts) -> tuple[Variable, ...]:
    return tuple(
        Variable(name, about[name][0].unit, about[name][0].meaning, float(start), *about[name][1])
        for name, start in zip(names, starts, strict=True)
    )


def _parameter(key: str, value: float, leaf: Leaf) -> Variable:
    """A parameter with its metadata; its source is the default's own, or the configuration."""
    believed = key.startswith("nominal.")
    return Variable(
        name=key,
        unit=leaf.quantity.unit or "1",
        description=f"{leaf.quantity.meaning}, as the controller believes" if believed else leaf.quantity.meaning,
        start=value,
        lower=leaf.bounds[0],
        upper=leaf.bounds[1],
        source=leaf.quantity.source if value == leaf.default else "configuration",
        exclusive=any(isinstance(constraint, at.Gt) for constraint in leaf.constraints),
    )
