"""Loop rolling: repeated sequences of instructions of a function become loops."""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.source.casadi_c import by_casadi
from dualwinch.codegen.source.expressions import instructions, operands_of
from dualwinch.codegen.source.operations import Style
from dualwinch.codegen.source.statements import Strand, statements

Ints = NDArray[np.int_]

WORTHWHILE = 200
"""Least number of statements that a loop must save."""

WORD = 24
"""Length of the words of operations by which repetitions are found."""


@dataclass(frozen=True)
class Loop:
    """`rounds` repetitions of `length` instructions, from `start` on.

    An operand is a value of the same round or of an earlier one, at a constant distance; or a value from before the
    loop, the same in every round.
    """

    start: int
    length: int
    rounds: int

    @property
    def end(self) -> int:
        """The first instruction after the loop."""
        return self.start + self.rounds * self.length

    @property
    def saved(self) -> int:
        """Number of statements it saves."""
        return (self.rounds - 1) * self.length

    def place(self, instruction: int) -> tuple[int, int]:
        """Position of an instruction in its round, and the number of that round: negative before the loop."""
        number, position = divmod(instruction - self.start, self.length)
        return position, number


def loops(function: ca.Function) -> list[Loop]:
    """The loops in a function of SX expressions, in order: the one that saves most, then those before and after it."""
    listing = instructions(function)
    operations = np.array([instruction.operation for instruction in listing], dtype=int)
    operations[np.isin(operations, [ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST])] = -1  # never part of a loop
    operands = np.full((len(listing), 2), -1)
    for index, values in operands_of(function).items():
        operands[index, : len(values)] = values
    return _loops_in(0, len(listing), operations, operands)


def _loops_in(start: int, end: int, operations: Ints, operands: Ints) -> list[Loop]:
    longest = _longest(start, end, operations, operands)
    if longest is None:
        return []
    before = _loops_in(start, longest.start, operations, operands)
    return [*before, longest, *_loops_in(longest.end, end, operations, operands)]


def _longest(first: int, last: int, operations: Ints, operands: Ints) -> Loop | None:
    """The loop between two instructions that saves most; None if none saves enough."""
    best: Loop | None = None
    for length, limit in _lengths(operations[first:last]):
        if limit < (best.saved + 1 if best else WORTHWHILE):
            break
        now, then = slice(first, last - length), slice(first + length, last)
        repeats = (operations[now] == operations[then]) & (operations[now] >= 0)
        repeats &= ((operands[now] == operands[then]) | (operands[now] + length == operands[then])).all(axis=1)
        edges = first + np.flatnonzero(np.diff(repeats.astype(int), prepend=0, append=0))
        for start, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            loop = Loop(start, length, (end - start) // length + 1)
            if loop.saved >= (best.saved + 1 if best else WORTHWHILE) and _regular(loop, operands):
                best = loop
    return best


def _lengths(operations: Ints) -> list[tuple[int, int]]:
    """Possible lengths of rounds with the largest number of statements they can save, in descending order.

    Rounds consist of the same operations, so that equal words of operations recur at a distance of one round, as often
    as there are operations in all rounds but one, less a word.
    """
    if len(operations) <= WORD:
        return []
    words = np.lib.stride_tricks.sliding_window_view(operations, WORD)
    _, names = np.unique(words, axis=0, return_inverse=True)
    counts = np.zeros(len(operations), dtype=int)
    order = np.argsort(names, kind="stable")
    for positions in np.split(order, np.flatnonzero(np.diff(names[order])) + 1):
        if len(positions) > 1:
            counts += _distances(positions, len(operations))
    counts[counts > 0] += WORD - 1
    return [(length, int(counts[length])) for length in np.argsort(-counts, kind="stable").tolist() if counts[length]]


def _distances(positions: Ints, count: int) -> Ints:
    """Number of pairs of positions (below `count`) by their distance, from 0 to count − 1."""
    if len(positions) ** 2 < count:
        distances = positions[None, :] - positions[:, None]
        return np.bincount(distances[distances > 0], minlength=count)
    occurrence = np.bincount(positions, minlength=count).astype(float)
    spectrum = np.fft.rfft(occurrence, 2 * count)  # of the autocorrelation, without wrapping around
    pairs = np.rint(np.fft.irfft(np.abs(spectrum) ** 2, 2 * count)[:count]).astype(int)
    pairs[0] = 0
    return pairs


def _regular(loop: Loop, operands: Ints) -> bool:
    """Whether the operands are at the same relative positions in every round."""
    rounds = operands[loop.start : loop.end].reshape(loop.rounds, loop.length, 2)
    steps = np.diff(rounds, axis=0)
    fixed = rounds[0][steps[0] == 0]
    return bool((steps == steps[0]).all() and (fixed < loop.start).all())


def rolled_statements(
    function: ca.Function, style: Style | None = None, strands: Sequence[Strand] = (Strand(),)
) -> list[str]:
    """`statements` with loops for repetitions: the same operations in the same order.

    Args:
        function: function of SX expressions, with dense arguments and results.
        style: style of operations.
        strands: interleaved evaluations.

    Raises:
        CodegenError: an argument or a result is sparse.
    """
    style = style or Style()
    lines = statements(function, style, strands)
    if by_casadi(function, style):
        return lines
    each = len(strands)  # one line per instruction and strand, after the declarations
    declarations = len(lines) - each * len(instructions(function))
    written, upto = lines[:declarations], 0
    for loop in loops(function):
        written += lines[declarations + each * upto : declarations + each * loop.start]
        written += _loop([_Rolling(function, loop, style, strand.register) for strand in strands], loop.rounds, style)
        upto = loop.end
    return written + lines[declarations + each * upto :]


def _loop(strands: "Sequence[_Rolling]", rounds: int, style: Style) -> list[str]:
    """A loop over all strands."""
    values = [
        line for lines_of_round in zip(*(strand.body() for strand in strands), strict=True) for line in lines_of_round
    ]
    results = [line for strand in strands for line in strand.results()]
    histories = [line for strand in strands for line in strand.histories()]  # last, when all earlier values are known
    ageing = [line for strand in strands for line in strand.ageing()]
    return style.loop(rounds, histories, [*values, *ageing], results)


class _Rolling:
    """A strand's part of a loop.

    ``a_7`` is the value at position 7 of a round, ``a_7_2`` that of two rounds ago. Values from before the loop, and
    those used after it, are in the work variables of `statements`.
    """

    def __init__(self, function: ca.Function, loop: Loop, style: Style, register: str) -> None:
        self._made, self._operands = instructions(function), operands_of(function)
        self._loop, self._style, self._strand = loop, style, register
        self._ago: dict[int, int] = {}  # position → number of rounds for which its value is used
        self._read_from_start, self._read_after = self._read_from(loop.start), self._read_from(loop.end)

    def body(self) -> list[str]:
        """Statements of a round."""
        return [f"      {self._style.declared(self._value(k), constant=True)}" for k in range(self._loop.length)]

    def results(self) -> list[str]:
        """Statements that copy the values used after the loop to their work variables."""
        loop, lines = self._loop, []
        for operand in sorted(self._read_after):
            position, number = loop.place(operand)
            if 0 <= number < loop.rounds:
                value = self._earlier(position, loop.rounds - number)
                lines.append(f"    {self._style.copy(self._register(operand), value)}")
        return lines

    def histories(self) -> list[str]:
        """Initial values of earlier rounds; to be called after all other statements are written."""
        style = self._style
        return [
            f"    {style.declared(style.copy(self._earlier(position, ago), self._first(position, ago)))}"
            for position, ago in self._backwards()
        ]

    def ageing(self) -> list[str]:
        """Statements that shift the values at the end of a round; to be called likewise."""
        return [
            f"      {self._style.copy(self._earlier(position, ago), self._earlier(position, ago - 1))}"
            for position, ago in self._backwards()
        ]

    def _backwards(self) -> list[tuple[int, int]]:
        return [(position, ago) for position in sorted(self._ago) for ago in range(self._ago[position], 0, -1)]

    def _value(self, position: int) -> str:
        """The statement at a position of every round."""
        index, names = self._loop.start + position, []
        for now, then in zip(self._operands[index], self._operands[index + self._loop.length], strict=True):
            other, number = self._loop.place(now)
            names.append(self._register(now) if now == then else self._earlier(other, -number))
        return self._style.operation(self._earlier(position, 0), self._made[index].operation, names)

    def _first(self, position: int, ago: int) -> str:
        """Initial value of a history before the first round."""
        before = self._loop.start + position - ago * self._loop.length
        return self._register(before) if before in self._read_from_start else self._style.number(0)

    def _earlier(self, position: int, ago: int) -> str:
        if ago == 0:
            return f"{self._strand}_{position}"
        self._ago[position] = max(self._ago.get(position, 0), ago)
        return f"{self._strand}_{position}_{ago}"

    def _register(self, index: int) -> str:
        """The work variable of an instruction outside of the loop."""
        return f"{self._strand}{self._made[index].written[0]}"

    def _read_from(self, start: int) -> set[int]:
        """The operands of all instructions from `start` on."""
        return {operand for index in range(start, len(self._made)) for operand in self._operands.get(index, ())}
