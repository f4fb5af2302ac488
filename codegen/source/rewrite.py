"""A function's expressions written anew with cheaper instructions: fewer divisions, fewer products."""

from collections import Counter
from dataclasses import dataclass, field

import casadi as ca

from dualwinch.codegen.source.instructions import Instruction, applied, instructions, operands_of

SCALINGS = {ca.OP_NEG: -1.0, ca.OP_TWICE: 2.0}
"""Operations that are products with a constant."""


@dataclass
class Reciprocals:
    """Divisions by something that depends on the parameters alone, as products with a reciprocal computed once.

    Attributes:
        symbols, values: what stands for the reciprocals, and what they are.
    """

    symbols: list[ca.SX] = field(default_factory=list)
    values: list[ca.SX] = field(default_factory=list)
    _of: dict[int, ca.SX] = field(default_factory=dict)

    def of(self, divisor: ca.SX) -> ca.SX:
        """A divisor's reciprocal."""
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
    """A value in a function: `fixed` if it depends on the parameters alone, else maybe a fixed `factor` × `rest`."""

    whole: ca.SX
    fixed: bool = False
    factor: ca.SX | None = None
    rest: ca.SX | None = None

    def times(self, factor: ca.SX) -> "_Value":
        """The product with something fixed, gathered with the factor there is."""
        rest = self.whole if self.rest is None else self.rest
        if self.factor is not None:
            constant = self.factor.is_constant() and factor.is_constant()
            factor = ca.SX(float(self.factor) * float(factor)) if constant else self.factor * factor
        return _Value(factor * rest, factor=factor, rest=rest)


class Rewriting:
    """The outputs of a function, whose instructions are followed one by one.

    Divisions by what depends on the parameters alone, and several ones by the same divisor, become products; factors
    that depend on the parameters alone become one factor where several stand in a product. Either can change the last
    bits of a result.

    Attributes:
        outputs: the new expressions.
    """

    def __init__(self, function: ca.Function, inputs: list[ca.SX], reciprocals: Reciprocals) -> None:
        """Rewrite a function of dense SX expressions; `inputs` are new symbols, `reciprocals` is added to."""
        self._reciprocals = reciprocals
        self._inputs = [ca.vertsplit(symbol) for symbol in inputs]
        self._fixed = [name == "parameters" for name in function.name_in()]
        self._operands = operands_of(function)
        self._uses = Counter(operand for made in self._operands.values() for operand in set(made))
        self._divided_by = Counter(
            self._operands[step][1] for step, made in enumerate(instructions(function)) if made.operation == ca.OP_DIV
        )
        self._inverses: dict[int, ca.SX] = {}
        self._values: dict[int, _Value] = {}
        outputs = [[ca.SX(0)] * function.numel_out(vector) for vector in range(function.n_out())]
        for step, instruction in enumerate(instructions(function)):
            if instruction.operation == ca.OP_OUTPUT:
                vector, element = instruction.written
                outputs[vector][element] = self._values[self._operands[step][0]].whole
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
        made = [self._values[operand] for operand in self._operands[step]]
        if not all(value.fixed for value in made):
            if operation == ca.OP_MUL:
                return self._product(step, *made)
            if operation == ca.OP_DIV:
                return self._quotient(step, *made)
            if operation in SCALINGS and made[0].rest is not None:
                return made[0].times(ca.SX(SCALINGS[operation]))
        return _Value(applied(operation, [value.whole for value in made]), all(value.fixed for value in made))

    def _product(self, step: int, left: _Value, right: _Value) -> _Value:
        if left.fixed or right.fixed:
            return right.times(left.whole) if left.fixed else left.times(right.whole)
        whole, operands = left.whole * right.whole, self._operands[step]
        for scaled, other, operand in ((left, right, operands[0]), (right, left, operands[1])):
            if scaled.rest is not None and self._uses[operand] == self._uses[step] == 1:
                return _Value(whole, factor=scaled.factor, rest=scaled.rest * other.whole)
        return _Value(whole)

    def _quotient(self, step: int, left: _Value, right: _Value) -> _Value:
        if right.fixed:
            return left.times(self._reciprocals.of(right.whole))
        divisor = self._operands[step][1]
        if self._divided_by[divisor] > 1:
            return _Value(left.whole * self._inverses.setdefault(divisor, 1 / right.whole))
        return _Value(left.whole / right.whole)
