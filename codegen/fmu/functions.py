"""The functions an FMU computes with, made from those of its block."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.block import Block
from dualwinch.codegen.source.hoist import hoisted_together

Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Functions:
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


def functions_of(block: Block) -> Functions:
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
    return Functions(
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
