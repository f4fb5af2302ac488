"""The instructions a CasADi function of SX expressions is made of."""

from collections.abc import Sequence

import casadi as ca


def applied(operation: int, operands: Sequence[ca.SX]) -> ca.SX:
    """An operation of one or two operands as an expression."""
    build = ca.SX.unary if len(operands) == 1 else ca.SX.binary
    return build(operation, *operands)


def operands_of(function: ca.Function) -> dict[int, tuple[int, ...]]:
    """Instruction → the instructions that made its operands; none for inputs and constants."""
    made_by: dict[int, int] = {}
    operands: dict[int, tuple[int, ...]] = {}
    for step in range(function.n_instructions()):
        operation = function.instruction_id(step)
        if operation not in {ca.OP_INPUT, ca.OP_CONST}:
            operands[step] = tuple(made_by[place] for place in function.instruction_input(step))
        if operation != ca.OP_OUTPUT:
            made_by[function.instruction_output(step)[0]] = step
    return operands
