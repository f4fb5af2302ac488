"""C statements of a function that repeats itself, as a loop: it takes the room of one round, not of all."""

import casadi as ca

from dualwinch.codegen.source.instructions import instructions, operands_of
from dualwinch.codegen.source.loops import Loop, longest_loop
from dualwinch.codegen.source.operations import Style, patterns
from dualwinch.codegen.source.statements import Element, Strand, of_array, statements


def rolled_statements(function: ca.Function, style: Style, element: Element = of_array) -> list[str]:
    """`statements` of one strand, the longest loop among them as a loop: the same operations in the same order.

    Args:
        function: of SX expressions, with dense arguments and results.
        style: how operations are written.
        element: where the elements of arguments and results stand.

    Raises:
        CodegenError: the function holds something that is no plain C.
    """
    lines = statements(function, style, [Strand(element)])
    loop = longest_loop(function)
    if loop is None:
        return lines
    declarations = len(lines) - len(instructions(function))  # then there is a line an instruction
    before, after = lines[: declarations + loop.start], lines[declarations + loop.end :]
    return [*before, *_Rolling(function, loop, style).lines(), *after]


class _Rolling:
    """A loop in C.

    ``b7`` is the value at position 7 of a round, ``b7_2`` that of two rounds ago. What comes from before the loop
    stands in the work variables of `statements`, and what is of use after it goes there.
    """

    def __init__(self, function: ca.Function, loop: Loop, style: Style) -> None:
        self._made, self._operands = instructions(function), operands_of(function)
        self._loop, self._style = loop, style
        self._ago: dict[int, int] = {}  # position → for how many rounds its value is of use

    def lines(self) -> list[str]:
        real, loop = self._style.precision, self._loop
        body = [f"      const {real} b{position}={self._value(position)};" for position in range(loop.length)]
        results = self._results()
        histories = [(position, ago) for position in sorted(self._ago) for ago in range(self._ago[position], 0, -1)]
        return [
            "  {",
            "    int turn;",
            *(f"    {real} b{position}_{ago}={self._first(position, ago)};" for position, ago in histories),
            f"    for (turn=0;turn<{loop.rounds};++turn) {{",
            *body,
            *(f"      b{position}_{ago}=b{position}{f'_{ago - 1}' if ago > 1 else ''};" for position, ago in histories),
            "    }",
            *results,
            "  }",
        ]

    def _value(self, position: int) -> str:
        """What a position becomes in every round."""
        index, names = self._loop.start + position, []
        for now, then in zip(self._operands[index], self._operands[index + self._loop.length], strict=True):
            other, number = self._loop.place(now)
            names.append(self._register(now) if now == then else self._earlier(other, -number))
        return patterns(self._style)[self._made[index].operation].format(*names)

    def _results(self) -> list[str]:
        """What is of use after the loop goes where it is looked for."""
        loop, lines = self._loop, []
        for operand in sorted(self._read_from(loop.end)):
            position, number = loop.place(operand)
            if 0 <= number < loop.rounds:
                lines.append(f"    {self._register(operand)}={self._earlier(position, loop.rounds - number)};")
        return lines

    def _first(self, position: int, ago: int) -> str:
        """What a history holds before the first round."""
        before = self._loop.start + position - ago * self._loop.length
        return self._register(before) if before in self._read_from(self._loop.start) else "0"

    def _earlier(self, position: int, ago: int) -> str:
        if ago == 0:
            return f"b{position}"
        self._ago[position] = max(self._ago.get(position, 0), ago)
        return f"b{position}_{ago}"

    def _register(self, index: int) -> str:
        """The work variable of an instruction outside of the loop."""
        return f"a{self._made[index].written[0]}"

    def _read_from(self, start: int) -> set[int]:
        """What the instructions from one on read."""
        return {operand for index in range(start, len(self._made)) for operand in self._operands.get(index, ())}
