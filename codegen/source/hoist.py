"""Hoisting of invariants out of a step: expressions of the parameters alone are computed once per run.

Before, expressions are rewritten with cheaper instructions: fewer divisions, fewer products.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca

from dualwinch.codegen.source.casadi_c import lacking
from dualwinch.codegen.source.expressions import GRAPHS, Instruction, applied, as_written, instructions, operands_of
from dualwinch.codegen.source.operations import Generator

SCALINGS = {ca.OP_NEG: -1.0, ca.OP_TWICE: 2.0}
"""Operations that are products with a constant."""


@dataclass
class Reciprocals:
    """Reciprocals of divisors that depend on the parameters alone, computed once.

    Attributes:
        symbols, values: symbols of the reciprocals, and their expressions.
    """

    symbols: list[ca.SX] = field(default_factory=list)
    values: list[ca.SX] = field(default_factory=list)
    _of: dict[int, ca.SX] = field(default_factory=dict)

    def of(self, divisor: ca.SX) -> ca.SX:
        """The reciprocal of a divisor."""
        if divisor.is_constant():
            return ca.SX(1 / float(divisor))
        key = divisor.element_hash()
        if key not in self._of:
            self._of[key] = ca.SX.sym(f"reciprocal_{len(self.symbols)}")
            self.symbols.append(self._of[key])
            self.values.append(1 / divisor)
        return self._of[key]


@dataclass(frozen=True)
class _Value:
    """A value in a function: `fixed` if it depends on the parameters alone, else perhaps `factor` × `remainder`."""

    value: ca.SX
    fixed: bool = False
    factor: ca.SX | None = None
    remainder: ca.SX | None = None

    def times(self, factor: ca.SX) -> "_Value":
        """The product with a fixed factor, combined with the present factor."""
        remainder = self.value if self.remainder is None else self.remainder
        if self.factor is not None:
            constant = self.factor.is_constant() and factor.is_constant()
            factor = ca.SX(float(self.factor) * float(factor)) if constant else self.factor * factor
        return _Value(factor * remainder, factor=factor, remainder=remainder)


class Rewriting:
    """The rewritten outputs of a function, instruction by instruction.

    Divisions by expressions of the parameters alone, and several divisions by the same divisor, become products;
    several factors of a product that depend on the parameters alone are combined. Both can change the last bits of a
    result.

    Attributes:
        outputs: the new expressions.
    """

    def __init__(self, function: ca.Function, inputs: list[ca.SX], reciprocals: Reciprocals) -> None:
        """Rewrite a function of dense SX expressions; `inputs` are new symbols, `reciprocals` is extended."""
        self._reciprocals = reciprocals
        self._inputs = [ca.vertsplit(symbol) for symbol in inputs]
        self._fixed = [name == "parameters" for name in function.name_in()]
        self._operands = operands_of(function)
        self._uses = Counter(operand for operands in self._operands.values() for operand in set(operands))
        self._divided_by = Counter(
            self._operands[step][1]
            for step, instruction in enumerate(instructions(function))
            if instruction.operation == ca.OP_DIV
        )
        self._inverses: dict[int, ca.SX] = {}
        self._values: dict[int, _Value] = {}
        outputs = [[ca.SX(0)] * function.numel_out(vector) for vector in range(function.n_out())]
        for step, instruction in enumerate(instructions(function)):
            if instruction.operation == ca.OP_OUTPUT:
                vector, element = instruction.written
                outputs[vector][element] = self._values[self._operands[step][0]].value
            else:
                self._values[step] = self._value(step, instruction)
        self.outputs = [ca.vertcat(*elements) for elements in outputs]

    def _value(self, step: int, instruction: Instruction) -> _Value:
        operation = instruction.operation
        if operation == ca.OP_INPUT:
            vector, element = instruction.read
            return _Value(self._inputs[vector][element], fixed=self._fixed[vector])
        if operation == ca.OP_CONST:
            return _Value(ca.SX(instruction.constant), fixed=True)
        operands = [self._values[operand] for operand in self._operands[step]]
        if not all(value.fixed for value in operands):
            if operation == ca.OP_MUL:
                return self._product(step, *operands)
            if operation == ca.OP_DIV:
                return self._quotient(step, *operands)
            if operation in SCALINGS and operands[0].remainder is not None:
                return operands[0].times(ca.SX(SCALINGS[operation]))
        return _Value(applied(operation, [value.value for value in operands]), all(value.fixed for value in operands))

    def _product(self, step: int, left: _Value, right: _Value) -> _Value:
        if left.fixed or right.fixed:
            return right.times(left.value) if left.fixed else left.times(right.value)
        product, operands = left.value * right.value, self._operands[step]
        for scaled, other, operand in ((left, right, operands[0]), (right, left, operands[1])):
            if scaled.remainder is not None and self._uses[operand] == self._uses[step] == 1:
                return _Value(product, factor=scaled.factor, remainder=scaled.remainder * other.value)
        return _Value(product)

    def _quotient(self, step: int, left: _Value, right: _Value) -> _Value:
        if right.fixed:
            return left.times(self._reciprocals.of(right.value))
        divisor = self._operands[step][1]
        if self._divided_by[divisor] > 1:
            return _Value(left.value * self._inverses.setdefault(divisor, 1 / right.value))
        return _Value(left.value / right.value)


def _column(values: Sequence[ca.SX]) -> ca.SX:
    return ca.vertcat(*values) if values else ca.SX(0, 1)


def hoisted(step: ca.Function) -> tuple[ca.Function, ca.Function]:
    """`hoisted_together` of a single function, with ``derive_NAME`` for ``derive``."""
    derive, (lean,) = hoisted_together((step,), name=f"derive_{step.name()}")
    return derive, lean


@GRAPHS.cached
def hoisted_together(
    functions: tuple[ca.Function, ...],
    *,
    name: str = "derive",
    exact: bool = False,
    generator: Generator = "dualwinch",
) -> tuple[ca.Function, tuple[ca.Function, ...]]:
    """Split functions so that expressions of their parameters alone are computed once, for all of them (cached).

    Products and divisions are rewritten (`Rewriting`), which can change the last bits of a result. A function for
    CasADi's generator is unchanged.

    Args:
        functions: functions of dense SX expressions; inputs of one name are identical. Those that depend on parameters
            have an input ``parameters``.
        name: name of the function of the parameters.
        exact: leave products and divisions unchanged, so that every result is the same to the last bit.
        generator: generator of their C.

    Returns:
        ``derive(parameters) -> derived``, and the functions again with ``derived`` as their last input.
    """
    sizes = {name: function.size1_in(name) for function in functions for name in function.name_in()}
    inputs = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    parameters = inputs.get("parameters", ca.SX.sym("parameters", 0))
    reciprocals = Reciprocals()
    by_casadi = [generator == "casadi" or lacking(function) is not None for function in functions]
    outputs: list[list[ca.SX]] = []
    with as_written():
        for function, untouched in zip(functions, by_casadi, strict=True):
            arguments = [inputs[name] for name in function.name_in()]
            unchanged = exact or untouched
            outputs.append(
                function.call(arguments) if unchanged else Rewriting(function, arguments, reciprocals).outputs
            )
        divided = [results for results, untouched in zip(outputs, by_casadi, strict=True) if not untouched]
        derive, derived, split = _split(name, parameters, divided, reciprocals)
        parts = iter(split)
        outputs = [
            [ca.densify(result) for result in results] if untouched else next(parts)
            for results, untouched in zip(outputs, by_casadi, strict=True)
        ]
        lean = (
            ca.Function(
                function.name(),
                [*(inputs[name] for name in function.name_in()), derived],
                expressions,
                [*function.name_in(), "derived"],
                function.name_out(),
            )
            for function, expressions in zip(functions, outputs, strict=True)
        )
        return derive, tuple(lean)


def _split(
    name: str, parameters: ca.SX, outputs: list[list[ca.SX]], reciprocals: Reciprocals
) -> tuple[ca.Function, ca.SX, list[list[ca.SX]]]:
    """The function of the derived values, their symbols, and the outputs as expressions of these."""
    every = [output for results in outputs for output in results]
    ends = [0]
    for output in every:
        ends.append(ends[-1] + output.numel())
    remainder, symbols, values = ca.extract_parametric(_column(every), ca.vertcat(parameters, *reciprocals.symbols))
    symbol, value = _column(reciprocals.symbols), _column(reciprocals.values)
    values = ca.substitute(_column(values), symbol, value)
    derived = ca.vertcat(symbol, *symbols)
    derive = ca.Function(name, [parameters], [ca.cse(ca.vertcat(value, values))], ["parameters"], ["derived"])
    parts = iter(ca.vertsplit(ca.densify(ca.cse(remainder)), ends))
    return derive, derived, [[next(parts) for _ in results] for results in outputs]
