"""A block seen through FMI: numbered variables with causality, their dependencies, and the functions of its FMU."""

import re
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias, get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.block import Block, Variable
from dualwinch.codegen.errors import CodegenError
from dualwinch.codegen.source.hoist import hoisted_together

Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class FmuFunctions:
    """CasADi functions of an FMU, and what depends on what.

    Attributes:
        derive: ``derive(parameters) -> derived``: what follows from the parameters alone.
        start: ``start(parameters, derived) -> state``.
        now: ``now(state, input, parameters, derived) -> (derivatives, output)``; no derivatives where the block has
            none.
        step: ``step(state, input, parameters, derived) -> next_state``.
        start_tangent: directional derivative of `start`, ``(parameters, parameters_seed) -> state_seed``.
        now_tangent: directional derivative of `now`, ``(state, input, parameters, state_seed, input_seed,
            parameters_seed) -> (derivatives_tangent, output_tangent)``. Both are None without a derivative.
        on_state, on_input: (derivatives + outputs, states or inputs), what `now` depends on.
        at_start: (states + derivatives + outputs, inputs + parameters), what start values depend on.
    """

    derive: ca.Function
    start: ca.Function
    now: ca.Function
    step: ca.Function
    start_tangent: ca.Function | None
    now_tangent: ca.Function | None
    on_state: Bools
    on_input: Bools
    at_start: Bools


def functions_of(block: Block) -> FmuFunctions:
    """The functions of a block's FMU."""
    state, given, parameters = (
        ca.SX.sym(name, len(variables))
        for name, variables in (("state", block.states), ("input", block.inputs), ("parameters", block.parameters))
    )
    point, names = [state, given, parameters], ["state", "input", "parameters"]
    next_state, answer = block.step(*point)
    slope, output = ca.SX(0, 1), answer
    if block.derivative is not None:
        slope, output = block.derivative(*point)
    elif block.output is not None:
        output = block.output(state, parameters)
    at_start = block.initial(parameters)
    now = ca.vertcat(slope, output)
    start_tangent = now_tangent = None
    if block.derivative is not None:
        seeds = [ca.SX.sym(f"{name}_seed", symbol.numel()) for name, symbol in zip(names, point, strict=True)]
        moved = ca.jtimes(now, ca.vertcat(*point), ca.vertcat(*seeds))
        parts = ca.vertsplit(ca.densify(moved), [0, slope.numel(), now.numel()])
        now_tangent = _function(
            "now_tangent",
            [*point, *seeds],
            parts,
            [*names, *(f"{name}_seed" for name in names)],
            ["derivatives_tangent", "output_tangent"],
        )
        start_tangent = _function(
            "start_tangent",
            [parameters, seeds[2]],
            [ca.densify(ca.jtimes(at_start, parameters, seeds[2]))],
            ["parameters", "parameters_seed"],
            ["state_seed"],
        )
    whole = (
        _function("step", point, [next_state], names, ["next_state"]),
        _function("now", point, [slope, output], names, ["derivatives", "output"]),
        _function("start", [parameters], [at_start], ["parameters"], ["state"]),
    )
    derive, (step, now_, start) = hoisted_together(whole, exact=True)
    return FmuFunctions(
        derive=derive,
        start=start,
        now=now_,
        step=step,
        start_tangent=start_tangent,
        now_tangent=now_tangent,
        on_state=_dependence(now, state),
        on_input=_dependence(now, given),
        at_start=_dependence(ca.vertcat(at_start, ca.substitute(now, state, at_start)), ca.vertcat(given, parameters)),
    )


def _function(name: str, inputs: list[ca.SX], outputs: list[ca.SX], in_: list[str], out: list[str]) -> ca.Function:
    return ca.Function(name, inputs, outputs, in_, out, {"cse": True})


def _dependence(expressions: ca.SX, symbols: ca.SX) -> Bools:
    if symbols.numel() == 0:
        return np.zeros((expressions.numel(), 0), dtype=bool)
    return np.array(ca.DM(ca.jacobian_sparsity(expressions, symbols), 1.0).full(), dtype=bool)


Version: TypeAlias = Literal[2, 3]
VERSIONS: tuple[Version, ...] = get_args(Version)
Kind: TypeAlias = Literal["co-simulation", "model-exchange", "both"]
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True)
class FmuVariable:
    """One variable of an FMU; its value reference is its position among all.

    Attributes:
        name: in FMI's structured convention.
        role: ``input``, ``parameter``, ``output``, ``state``, ``derivative`` or ``time``.
        reference: value reference.
        variable: unit, description, start value, range.
        state: value reference of the state a derivative belongs to.
    """

    name: str
    role: str
    reference: int
    variable: Variable
    state: int | None = None


@dataclass(frozen=True)
class FmuModel:
    """A block seen through FMI.

    Attributes:
        block: what is exported.
        kind: which interfaces it offers.
        version: of FMI.
    """

    block: Block
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
        """The functions it computes with."""
        return functions_of(self.block)

    @cached_property
    def signals(self) -> tuple[FmuVariable, ...]:
        """Every variable in the order of the value references: inputs, parameters, outputs, states, derivatives, time.

        Raises:
            CodegenError: two variables have one name.
        """
        block = self.block
        names = [_structured(f"state.{variable.name}") for variable in block.states]
        first_state = len(block.inputs) + len(block.parameters) + len(block.outputs)
        rows = [
            *((_structured(variable.name), "input", variable, None) for variable in block.inputs),
            *((_structured(variable.name), "parameter", variable, None) for variable in block.parameters),
            *((_structured(variable.name), "output", variable, None) for variable in block.outputs),
            *((name, "state", variable, None) for name, variable in zip(names, block.states, strict=True)),
            *(
                (f"der({name})", "derivative", _rate(variable), reference)
                for reference, (name, variable) in enumerate(zip(names, block.continuous, strict=False), first_state)
            ),
            ("time", "time", Variable("time", "s", "time", 0.0), None),
        ]
        twice = [name for name, count in Counter(name for name, *_ in rows).items() if count > 1]
        if twice:
            raise CodegenError(f"two variables of {block.name} are called {twice[0]}")
        return tuple(
            FmuVariable(name, role, reference, variable, state)
            for reference, (name, role, variable, state) in enumerate(rows)
        )

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
            unknown.reference: [known.reference for known, used in zip(inputs, uses.on_input[row], strict=True) if used]
            + [known.reference for known, used in zip(states, uses.on_state[row], strict=False) if used]
            for row, unknown in enumerate(unknowns)
        }

    @cached_property
    def initial_unknowns(self) -> dict[int, list[int]]:
        """Value reference of what follows from start values → those of the inputs and parameters it depends on.

        Outputs and, with model exchange, continuous states and their derivatives.
        """
        unknowns = (*self.of("state"), *self.of("derivative"), *self.of("output"))
        continuous = {signal.state for signal in self.of("derivative")}
        knowns = (*self.of("input"), *self.of("parameter"))
        wanted = {signal.reference for signal in self.of("output")}
        if self.flows:
            wanted |= continuous | {signal.reference for signal in self.of("derivative")}
        found = {
            unknown.reference: [known.reference for known, used in zip(knowns, row, strict=True) if used]
            for unknown, row in zip(unknowns, self.functions.at_start, strict=True)
            if unknown.reference in wanted
        }
        return dict(sorted(found.items()))


def _structured(name: str) -> str:
    """A dotted name in FMI's structured convention: a number in the path is an array index."""
    return re.sub(r"\.(\d+)(?=\.|$)", r"[\1]", name)


def _rate(state: Variable) -> Variable:
    """The derivative of a state by time."""
    unit = state.unit
    if unit == "1":
        unit = "1/s"
    elif unit.endswith("/s"):
        unit += "^2"
    else:
        unit = f"({unit})/s" if "/" in unit else f"{unit}/s"
    return Variable(f"der({state.name})", unit, f"time derivative of: {state.description}", 0.0)
