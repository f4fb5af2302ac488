"""The instructions a CasADi function of SX expressions is made of."""

import casadi as ca


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
