"""Moves work out of a step that runs a million times: what depends on the parameters alone is computed once."""

from functools import cache

import casadi as ca
import numpy as np

from dualwinch.codegen.source.expressions import as_written
from dualwinch.codegen.source.rewrite import Reciprocals, Rewriting


def _column(values: list[ca.SX]) -> ca.SX:
    return ca.vertcat(*values) if values else ca.SX(0, 1)


@cache
def hoisted(step: ca.Function, *, exact: bool = False) -> tuple[ca.Function, ca.Function]:
    """Split a function so that what depends on its parameters alone is computed once (cached).

    Products and divisions are written anew (`codegen.source.rewrite`), which can change the last bits of a result.

    Args:
        step: a function of dense SX expressions with an input ``parameters``.
        exact: leave them as they are: every result stays as it was, to the last bit.

    Returns:
        ``derive_NAME(parameters) -> derived``, and the function again with ``derived`` as its last input.
    """
    names = step.name_in()
    inputs = [ca.SX.sym(name, step.size1_in(name)) for name in names]
    parameters = inputs[names.index("parameters")]
    with as_written():
        if exact:
            return _split(step, inputs, parameters, step.call(inputs), Reciprocals())
        rewriting = Rewriting(step, inputs)
        return _split(step, inputs, parameters, rewriting.outputs, rewriting.reciprocals)


def _split(
    step: ca.Function, inputs: list[ca.SX], parameters: ca.SX, outputs: list[ca.SX], reciprocals: Reciprocals
) -> tuple[ca.Function, ca.Function]:
    ends = np.cumsum([0, *(output.numel() for output in outputs)])
    rest, symbols, values = ca.extract_parametric(ca.vertcat(*outputs), ca.vertcat(parameters, *reciprocals.symbols))
    symbol, value = _column(reciprocals.symbols), _column(reciprocals.values)
    values = ca.substitute(_column(values), symbol, value)
    derived = ca.vertcat(symbol, *symbols)
    derive = ca.Function(
        f"derive_{step.name()}", [parameters], [ca.cse(ca.vertcat(value, values))], ["parameters"], ["derived"]
    )
    parts = ca.vertsplit(ca.densify(ca.cse(rest)), [int(end) for end in ends])
    return derive, ca.Function(step.name(), [*inputs, derived], parts, [*step.name_in(), "derived"], step.name_out())
