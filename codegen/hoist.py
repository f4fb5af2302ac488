"""Moves work out of a step that runs a million times: what depends on the parameters alone is computed once."""

from collections import Counter
from dataclasses import dataclass, field
from functools import cache

import casadi as ca
import numpy as np

from codegen.expressions import as_written


@dataclass
class _Reciprocals:
    """Divisions by something that depends on the parameters alone, as products with a reciprocal computed once."""

    parameter_input: int
    symbols: list[ca.SX] = field(default_factory=list)
    values: list[ca.SX] = field(default_factory=list)
    _of: dict[int, ca.SX] = field(default_factory=dict)

    def of(self, divisor: ca.SX) -> ca.SX:
        """The symbol of a divisor's reciprocal."""
        key = divisor.element_hash()
        if key not in self._of:
            self._of[key] = ca.SX.sym(f"reciprocal_{len(self.symbols)}")
            self.symbols.append(self._of[key])
            self.values.append(1 / divisor)
        return self._of[key]


def _shared_divisors(function: ca.Function) -> dict[int, int]:
    """Instruction → number of its divisor, for divisions by something that others are divided by as well."""
    version: dict[int, int] = {}
    divisor: dict[int, int] = {}
    for step in range(function.n_instructions()):
        operation = function.instruction_id(step)
        if operation == ca.OP_DIV:
            divisor[step] = version[function.instruction_input(step)[1]]
        if operation != ca.OP_OUTPUT:
            version[function.instruction_output(step)[0]] = step
    counts = Counter(divisor.values())
    return {step: number for step, number in divisor.items() if counts[number] > 1}


def _without_divisions(function: ca.Function, inputs: list[ca.SX], reciprocals: _Reciprocals) -> list[ca.SX]:
    """The function's outputs, built anew from its instructions with divisions replaced where possible."""
    elements = [ca.vertsplit(symbol) for symbol in inputs]
    outputs = [[ca.SX(0)] * function.numel_out(place) for place in range(function.n_out())]
    shared = _shared_divisors(function)
    inverses: dict[int, ca.SX] = {}
    work: dict[int, ca.SX] = {}
    fixed: dict[int, bool] = {}  # whether a value depends on the parameters alone
    for step in range(function.n_instructions()):
        operation = function.instruction_id(step)
        into, outof = function.instruction_output(step), function.instruction_input(step)
        if operation == ca.OP_OUTPUT:
            outputs[into[0]][into[1]] = work[outof[0]]
            continue
        target = into[0]
        if operation == ca.OP_INPUT:
            work[target], fixed[target] = elements[outof[0]][outof[1]], outof[0] == reciprocals.parameter_input
        elif operation == ca.OP_CONST:
            work[target], fixed[target] = ca.SX(function.instruction_constant(step)), True
        elif len(outof) == 1:
            work[target], fixed[target] = ca.SX.unary(operation, work[outof[0]]), fixed[outof[0]]
        else:
            (left, right), both_fixed = (work[place] for place in outof), all(fixed[place] for place in outof)
            if operation == ca.OP_DIV and fixed[outof[1]] and not both_fixed:
                inverse = 1 / float(right) if right.is_constant() else reciprocals.of(right)
                work[target] = left * inverse
            elif operation == ca.OP_DIV and step in shared:
                inverse = inverses.setdefault(shared[step], 1 / right)
                work[target] = left * inverse
            else:
                work[target] = ca.SX.binary(operation, left, right)
            fixed[target] = both_fixed
    return [ca.vertcat(*values) for values in outputs]


def _column(values: list[ca.SX]) -> ca.SX:
    return ca.vertcat(*values) if values else ca.SX(0, 1)


@cache
def hoisted(step: ca.Function) -> tuple[ca.Function, ca.Function]:
    """Split a function so that what depends on its parameters alone is computed once (cached).

    Divisions by such values become products with their reciprocals, which can change the last bit of a result.

    Args:
        step: a function of dense SX expressions with an input ``parameters``.

    Returns:
        ``derive_NAME(parameters) -> derived``, and the function again with ``derived`` as its last input.
    """
    names = step.name_in()
    inputs = [ca.SX.sym(name, step.size1_in(name)) for name in names]
    parameters = inputs[names.index("parameters")]
    reciprocals = _Reciprocals(names.index("parameters"))
    with as_written():
        outputs = _without_divisions(step, inputs, reciprocals)
        return _split(step, inputs, parameters, outputs, reciprocals)


def _split(
    step: ca.Function, inputs: list[ca.SX], parameters: ca.SX, outputs: list[ca.SX], reciprocals: _Reciprocals
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
