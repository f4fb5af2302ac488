"""A block as an FMI model: numbered variables with causality, their dependencies, and the functions of its FMU."""

import re
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias, get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import blocks, errors, language

Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class FmuFunctions:
    """CasADi functions of an FMU, and their dependences.

    Attributes:
        derive: ``derive(parameters) -> derived``: expressions of the parameters alone.
        rules: ``rules(parameters) -> holds``: requirements beyond the ranges of single parameters.
        start: ``start(parameters, derived) -> state``.
        now: ``now(state, input, parameters, derived) -> (derivatives, output)``; the derivatives may be empty.
        step: ``step(state, input, parameters, derived) -> next_state``.
        start_tangent: directional derivative of `start`, ``(parameters, parameters_seed) -> state_seed``.
        now_tangent: directional derivative of `now`, ``(state, input, parameters, state_seed, input_seed,
            parameters_seed) -> (derivatives_tangent, output_tangent)``. Both are None without a derivative.
        on_state, on_input: (derivatives + outputs, states or inputs), dependence of `now`.
        at_start: (states + derivatives + outputs, inputs + parameters), dependence of start values.
    """

    derive: ca.Function
    rules: ca.Function
    start: ca.Function
    now: ca.Function
    step: ca.Function
    start_tangent: ca.Function | None
    now_tangent: ca.Function | None
    on_state: Bools
    on_input: Bools
    at_start: Bools


def functions_of(block: blocks.Block) -> FmuFunctions:
    """The functions of a block's FMU."""
    state, inputs_now, parameters = (
        ca.SX.sym(name, len(variables))
        for name, variables in (("state", block.states), ("input", block.inputs), ("parameters", block.parameters))
    )
    point, names = [state, inputs_now, parameters], ["state", "input", "parameters"]
    next_state, answer = block.step(*point)
    slope, output = ca.SX(0, 1), answer
    if block.derivative is not None:
        slope, output = block.derivative(*point)
    elif block.output is not None:
        output = block.output(state, parameters)
    at_start = block.initial(parameters)
    now, cse = ca.vertcat(slope, output), {"cse": True}
    start_tangent = now_tangent = None
    if block.derivative is not None:
        seeds = [ca.SX.sym(f"{name}_seed", symbol.numel()) for name, symbol in zip(names, point, strict=True)]
        tangent = ca.densify(ca.jtimes(now, ca.vertcat(*point), ca.vertcat(*seeds)))
        parts = ca.vertsplit(tangent, [0, slope.numel(), now.numel()])
        inputs, results = [*names, *(f"{name}_seed" for name in names)], ["derivatives_tangent", "output_tangent"]
        now_tangent = ca.Function("now_tangent", [*point, *seeds], parts, inputs, results, cse)
        tangent = [ca.densify(ca.jtimes(at_start, parameters, seeds[2]))]
        inputs = ["parameters", "parameters_seed"]
        start_tangent = ca.Function("start_tangent", [parameters, seeds[2]], tangent, inputs, ["state_seed"], cse)
    functions = (
        ca.Function("step", point, [next_state], names, ["next_state"], cse),
        ca.Function("now", point, [slope, output], names, ["derivatives", "output"], cse),
        ca.Function("start", [parameters], [at_start], ["parameters"], ["state"], cse),
    )
    derive, (step, now_, start) = language.hoisted_together(functions, exact=True)
    return FmuFunctions(
        derive=derive,
        rules=block.rules or ca.Function("rules", [parameters], [ca.SX(0, 1)], ["parameters"], ["holds"]),
        start=start,
        now=now_,
        step=step,
        start_tangent=start_tangent,
        now_tangent=now_tangent,
        on_state=_dependence(now, state),
        on_input=_dependence(now, inputs_now),
        at_start=_dependence(
            ca.vertcat(at_start, ca.substitute(now, state, at_start)), ca.vertcat(inputs_now, parameters)
        ),
    )


def _dependence(expressions: ca.SX, symbols: ca.SX) -> Bools:
    if symbols.numel() == 0:
        return np.zeros((expressions.numel(), 0), dtype=bool)
    return np.array(ca.DM(ca.jacobian_sparsity(expressions, symbols), 1.0).full(), dtype=bool)


Version: TypeAlias = Literal[2, 3]
VERSIONS: tuple[Version, ...] = get_args(Version)
Kind: TypeAlias = Literal["co-simulation", "model-exchange", "both"]
FMU_KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True)
class FmuVariable:
    """One variable of an FMU; its value reference is its position among all.

    Attributes:
        name: name in FMI's structured convention.
        role: ``input``, ``parameter``, ``output``, ``state``, ``derivative`` or ``time``.
        reference: value reference.
        variable: unit, description, start value, range.
        state: value reference of the state a derivative belongs to.
    """

    name: str
    role: str
    reference: int
    variable: blocks.Variable
    state: int | None = None


@dataclass(frozen=True)
class FmuModel:
    """A block as an FMI model.

    Attributes:
        block: the block.
        kind: its interfaces.
        version: version of FMI.
    """

    block: blocks.Block
    kind: Kind
    version: Version

    @property
    def steps(self) -> bool:
        """Whether it offers co-simulation."""
        return self.kind != "model-exchange"

    @property
    def flows(self) -> bool:
        """Whether it offers model exchange."""
        return self.kind != "co-simulation"

    @cached_property
    def functions(self) -> FmuFunctions:
        """Its functions."""
        return functions_of(self.block)

    @cached_property
    def signals(self) -> tuple[FmuVariable, ...]:
        """Every variable in the order of the value references: inputs, parameters, outputs, states, derivatives, time.

        Raises:
            CodegenError: two variables have one name.
        """
        block, signals = self.block, list[FmuVariable]()
        vectors = {
            "input": block.inputs,
            "parameter": block.parameters,
            "output": block.outputs,
            "state": block.states,
            "derivative": block.continuous,
        }
        first_state = sum(len(vectors[role]) for role in ("input", "parameter", "output"))
        for role, variables in vectors.items():
            for position, variable in enumerate(variables):
                state = f"state.{variable.name}" if role in {"state", "derivative"} else variable.name
                name = re.sub(r"\.(\d+)(?=\.|$)", r"[\1]", state)  # a number in a path is an array index
                if role == "derivative":
                    of = first_state + position
                    signals.append(FmuVariable(f"der({name})", role, len(signals), _rate(variable), of))
                else:
                    signals.append(FmuVariable(name, role, len(signals), variable))
        signals.append(FmuVariable("time", "time", len(signals), blocks.Variable("time", "s", "time", 0.0)))
        twice = [name for name, count in Counter(signal.name for signal in signals).items() if count > 1]
        if twice:
            raise errors.CodegenError(f"two variables of {block.name} are called {twice[0]}")
        return tuple(signals)

    def of(self, role: str) -> tuple[FmuVariable, ...]:
        """The variables of one role."""
        return tuple(signal for signal in self.signals if signal.role == role)

    @cached_property
    def dependencies(self) -> dict[int, list[int]]:
        """Value reference of each output and derivative → those of the inputs and continuous states it depends on."""
        unknowns = (*self.of("derivative"), *self.of("output"))
        inputs, states = self.of("input"), self.of("state") if self.flows else ()
        uses = self.functions
        return {
            unknown.reference: [
                variable.reference for variable, used in zip(inputs, uses.on_input[row], strict=True) if used
            ]
            + [variable.reference for variable, used in zip(states, uses.on_state[row], strict=False) if used]
            for row, unknown in enumerate(unknowns)
        }

    @cached_property
    def initial_unknowns(self) -> dict[int, list[int]]:
        """Value reference of each initial unknown → those of the inputs and parameters it depends on.

        Unknowns are outputs and, with model exchange, continuous states and their derivatives.
        """
        unknowns = (*self.of("state"), *self.of("derivative"), *self.of("output"))
        continuous = {signal.state for signal in self.of("derivative")}
        knowns = (*self.of("input"), *self.of("parameter"))
        references = {signal.reference for signal in self.of("output")}
        if self.flows:
            references |= continuous | {signal.reference for signal in self.of("derivative")}
        dependencies = {
            unknown.reference: [
                known_variable.reference for known_variable, used in zip(knowns, row, strict=True) if used
            ]
            for unknown, row in zip(unknowns, self.functions.at_start, strict=True)
            if unknown.reference in references
        }
        return dict(sorted(dependencies.items()))


def fmu_model(block: blocks.Block, version: int = 2, kind: str | None = None) -> FmuModel:
    """A block as an FMI model.

    Args:
        block: the block.
        version: version of FMI, 2 or 3.
        kind: ``co-simulation``, ``model-exchange`` or ``both``; default: all that the block supports.

    Raises:
        CodegenError: an unknown version or kind, or model exchange of a block without derivatives.
    """
    if version not in VERSIONS:
        raise errors.CodegenError(f"FMI version {version}: must be 2 or 3")
    kind = kind or ("both" if block.derivative is not None else "co-simulation")
    if kind not in FMU_KINDS:
        raise errors.CodegenError(f"unknown kind of FMU '{kind}': must be {', '.join(FMU_KINDS)}")
    if kind != "co-simulation" and block.derivative is None:
        raise errors.CodegenError(f"{block.name} has no time derivative: the kind of its FMU must be co-simulation")
    return FmuModel(block, kind, version)  # pyright: ignore[reportArgumentType]


def _rate(state: blocks.Variable) -> blocks.Variable:
    """The time derivative of a state."""
    unit = state.unit
    if unit == "1":
        unit = "1/s"
    elif unit.endswith("/s"):
        unit += "^2"
    else:
        unit = f"({unit})/s" if "/" in unit else f"{unit}/s"
    return blocks.Variable(f"der({state.name})", unit, f"time derivative of: {state.description}", 0.0)
