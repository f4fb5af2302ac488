"""Moves work out of a step that runs a million times: what depends on the parameters alone is computed once."""

from collections.abc import Sequence
from functools import cache

import casadi as ca

from dualwinch.codegen.source.expressions import as_written
from dualwinch.codegen.source.rewrite import Reciprocals, Rewriting


def _column(values: Sequence[ca.SX]) -> ca.SX:
    return ca.vertcat(*values) if values else ca.SX(0, 1)


def hoisted(step: ca.Function, *, exact: bool = False) -> tuple[ca.Function, ca.Function]:
    """`hoisted_together` of a single function.

    Returns:
        ``derive_NAME(parameters) -> derived``, and the function again with ``derived`` as its last input.
    """
    derive, (lean,) = hoisted_together((step,), exact=exact)
    return derive, lean


@cache
def hoisted_together(
    functions: tuple[ca.Function, ...], *, exact: bool = False
) -> tuple[ca.Function, tuple[ca.Function, ...]]:
    """Split functions so that what depends on their parameters alone is computed once, for all of them (cached).

    Products and divisions are written anew (`codegen.source.rewrite`), which can change the last bits of a result.

    Args:
        functions: of dense SX expressions; inputs of one name are one and the same. Those that depend on parameters
            have an input ``parameters``.
        exact: leave products and divisions as they are: every result stays as it was, to the last bit.

    Returns:
        ``derive_NAME(parameters) -> derived`` with the first function's name, and the functions again with ``derived``
        as their last input.
    """
    sizes = {name: function.size1_in(name) for function in functions for name in function.name_in()}
    inputs = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    parameters = inputs.get("parameters", ca.SX.sym("parameters", 0))
    reciprocals = Reciprocals()
    outputs: list[list[ca.SX]] = []
    with as_written():
        for function in functions:
            given = [inputs[name] for name in function.name_in()]
            outputs.append(function.call(given) if exact else Rewriting(function, given, reciprocals).outputs)
        derive, derived, split = _split(functions[0].name(), parameters, outputs, reciprocals)
        lean = (
            ca.Function(
                function.name(),
                [*(inputs[name] for name in function.name_in()), derived],
                expressions,
                [*function.name_in(), "derived"],
                function.name_out(),
            )
            for function, expressions in zip(functions, split, strict=True)
        )
        return derive, tuple(lean)


def _split(
    name: str, parameters: ca.SX, outputs: list[list[ca.SX]], reciprocals: Reciprocals
) -> tuple[ca.Function, ca.SX, list[list[ca.SX]]]:
    """The function of what is derived, the symbols that stand for it, and the outputs that make use of them."""
    every = [output for results in outputs for output in results]
    ends = [0]
    for output in every:
        ends.append(ends[-1] + output.numel())
    rest, symbols, values = ca.extract_parametric(ca.vertcat(*every), ca.vertcat(parameters, *reciprocals.symbols))
    symbol, value = _column(reciprocals.symbols), _column(reciprocals.values)
    values = ca.substitute(_column(values), symbol, value)
    derived = ca.vertcat(symbol, *symbols)
    derive = ca.Function(
        f"derive_{name}", [parameters], [ca.cse(ca.vertcat(value, values))], ["parameters"], ["derived"]
    )
    parts = iter(ca.vertsplit(ca.densify(ca.cse(rest)), ends))
    return derive, derived, [[next(parts) for _ in results] for results in outputs]
