"""C statements of a function that repeats itself, as a loop: it takes the room of one round, not of all."""

from collections.abc import Sequence

import casadi as ca

from dualwinch.codegen.source.instructions import instructions, operands_of
from dualwinch.codegen.source.loops import Loop, loops
from dualwinch.codegen.source.operations import Style, patterns
from dualwinch.codegen.source.statements import Strand, statements


def rolled_statements(
    function: ca.Function, style: Style | None = None, strands: Sequence[Strand] = (Strand(),)
) -> list[str]:
    """`statements`, with a loop where they repeat themselves: the same operations in the same order.

    Args:
        function: of SX expressions, with dense arguments and results.
        style: how operations are written.
        strands: evaluations side by side; each statement stands there for one after the other.

    Raises:
        CodegenError: the function holds something that is no plain C.
    """
    style = style or Style()
    lines = statements(function, style, strands)
    each = len(strands)  # there is a line an instruction and strand, after the declarations
    declarations = len(lines) - each * len(instructions(function))
    written, upto = lines[:declarations], 0
    for loop in loops(function):
        written += lines[declarations + each * upto : declarations + each * loop.start]
        written += _loop([_Rolling(function, loop, style, strand.register) for strand in strands], loop.rounds)
        upto = loop.end
    return written + lines[declarations + each * upto :]


def _loop(strands: "Sequence[_Rolling]", rounds: int) -> list[str]:
    """A loop in C that carries on some strands."""
    values = [line for made in zip(*(strand.body() for strand in strands), strict=True) for line in made]
    results = [line for strand in strands for line in strand.results()]
    return [
        "  {",
        "    int turn;",
        *(line for strand in strands for line in strand.histories()),  # all else has said by now what it needs
        f"    for (turn=0;turn<{rounds};++turn) {{",
        *values,
        *(line for strand in strands for line in strand.ageing()),
        "    }",
        *results,
        "  }",
    ]


class _Rolling:
    """A strand's part of a loop in C.

    ``a_7`` is the value at position 7 of a round, ``a_7_2`` that of two rounds ago. What comes from before the loop
    stands in the work variables of `statements`, and what is of use after it goes there.
    """

    def __init__(self, function: ca.Function, loop: Loop, style: Style, register: str) -> None:
        self._made, self._operands = instructions(function), operands_of(function)
        self._loop, self._style, self._strand = loop, style, register
        self._ago: dict[int, int] = {}  # position → for how many rounds its value is of use
        self._read_from_start, self._read_after = self._read_from(loop.start), self._read_from(loop.end)

    def body(self) -> list[str]:
        """A round."""
        real, positions = self._style.precision, range(self._loop.length)
        return [f"      const {real} {self._earlier(position, 0)}={self._value(position)};" for position in positions]

    def results(self) -> list[str]:
        """What is of use after the loop goes where it is looked for."""
        loop, lines = self._loop, []
        for operand in sorted(self._read_after):
            position, number = loop.place(operand)
            if 0 <= number < loop.rounds:
                lines.append(f"    {self._register(operand)}={self._earlier(position, loop.rounds - number)};")
        return lines

    def histories(self) -> list[str]:
        """Values of earlier rounds, before the first; to be asked for when all else is written."""
        real = self._style.precision
        return [
            f"    {real} {self._earlier(position, ago)}={self._first(position, ago)};"
            for position, ago in self._backwards()
        ]

    def ageing(self) -> list[str]:
        """At the end of a round its values become those of the round before; likewise."""
        return [
            f"      {self._earlier(position, ago)}={self._earlier(position, ago - 1)};"
            for position, ago in self._backwards()
        ]

    def _backwards(self) -> list[tuple[int, int]]:
        return [(position, ago) for position in sorted(self._ago) for ago in range(self._ago[position], 0, -1)]

    def _value(self, position: int) -> str:
        """What a position becomes in every round."""
        index, names = self._loop.start + position, []
        for now, then in zip(self._operands[index], self._operands[index + self._loop.length], strict=True):
            other, number = self._loop.place(now)
            names.append(self._register(now) if now == then else self._earlier(other, -number))
        return patterns(self._style)[self._made[index].operation].format(*names)

    def _first(self, position: int, ago: int) -> str:
        """What a history holds before the first round."""
        before = self._loop.start + position - ago * self._loop.length
        return self._register(before) if before in self._read_from_start else "0"

    def _earlier(self, position: int, ago: int) -> str:
        if ago == 0:
            return f"{self._strand}_{position}"
        self._ago[position] = max(self._ago.get(position, 0), ago)
        return f"{self._strand}_{position}_{ago}"

    def _register(self, index: int) -> str:
        """The work variable of an instruction outside of the loop."""
        return f"{self._strand}{self._made[index].written[0]}"

    def _read_from(self, start: int) -> set[int]:
        """What the instructions from one on read."""
        return {operand for index in range(start, len(self._made)) for operand in self._operands.get(index, ())}
