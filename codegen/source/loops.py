"""Where the instructions of a function repeat themselves."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate

from dualwinch.codegen.source.instructions import instructions, operands_of

Ints = NDArray[np.int_]

WORTHWHILE = 200
"""How many statements a loop has to save."""

WORD = 24
"""Length of the words of operations that tell where rounds may begin again."""


@dataclass(frozen=True)
class Loop:
    """Instructions that are `rounds` times the same `length` ones, from `start` on.

    An operand of a round is a value of this round or of one before, the same number of rounds ago in every one; or a
    value from before the loop, the same in every round.
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
        """How many statements it saves."""
        return (self.rounds - 1) * self.length

    def place(self, instruction: int) -> tuple[int, int]:
        """An instruction's position in its round, and the number of that round: negative before the loop."""
        number, position = divmod(instruction - self.start, self.length)
        return position, number


def loops(function: ca.Function) -> list[Loop]:
    """The loops in a function of SX expressions, in their order: the one that saves most, and those beside it."""
    made = instructions(function)
    operations = np.array([instruction.operation for instruction in made], dtype=int)
    operations[np.isin(operations, [ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST])] = -1  # none is like another
    operands = np.full((len(made), 2), -1)
    for index, values in operands_of(function).items():
        operands[index, : len(values)] = values
    return _loops_in(0, len(made), operations, operands)


def _loops_in(start: int, end: int, operations: Ints, operands: Ints) -> list[Loop]:
    longest = _longest(start, end, operations, operands)
    if longest is None:
        return []
    before = _loops_in(start, longest.start, operations, operands)
    return [*before, longest, *_loops_in(longest.end, end, operations, operands)]


def _longest(first: int, last: int, operations: Ints, operands: Ints) -> Loop | None:
    """The loop between two instructions that saves most; None where there is none worth while."""
    best: Loop | None = None
    for length, most in _lengths(operations[first:last]):
        if most < (best.saved + 1 if best else WORTHWHILE):
            break
        now, then = slice(first, last - length), slice(first + length, last)
        alike = (operations[now] == operations[then]) & (operations[now] >= 0)
        alike &= ((operands[now] == operands[then]) | (operands[now] + length == operands[then])).all(axis=1)
        edges = first + np.flatnonzero(np.diff(alike.astype(int), prepend=0, append=0))
        for start, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            loop = Loop(start, length, (end - start) // length + 1)
            if loop.saved >= (best.saved + 1 if best else WORTHWHILE) and _regular(loop, operands):
                best = loop
    return best


def _lengths(operations: Ints) -> list[tuple[int, int]]:
    """Lengths that rounds may have, with how many statements they save at most: most first.

    Rounds consist of the same operations, so that as many pairs of equal words, some operations long, lie one round
    apart as there are operations in all rounds but one, less a word.
    """
    if len(operations) <= WORD:
        return []
    words = np.lib.stride_tricks.sliding_window_view(operations, WORD)
    _, names = np.unique(words, axis=0, return_inverse=True)
    found = np.zeros(len(operations), dtype=int)
    order = np.argsort(names, kind="stable")
    for positions in np.split(order, np.flatnonzero(np.diff(names[order])) + 1):
        if len(positions) > 1:
            found += _distances(positions, len(operations))
    found[found > 0] += WORD - 1
    return [(length, int(found[length])) for length in np.argsort(-found, kind="stable").tolist() if found[length]]


def _distances(positions: Ints, count: int) -> Ints:
    """How many pairs of some positions, below a count, lie so far apart; by distance from 0 to count − 1."""
    if len(positions) ** 2 < count:
        apart = positions[None, :] - positions[:, None]
        return np.bincount(apart[apart > 0], minlength=count)
    there = np.bincount(positions, minlength=count).astype(float)
    pairs = np.rint(correlate(there, there, method="fft")[count - 1 :]).astype(int)
    pairs[0] = 0
    return pairs


def _regular(loop: Loop, operands: Ints) -> bool:
    """Whether every round finds its operands as the first one does."""
    rounds = operands[loop.start : loop.end].reshape(loop.rounds, loop.length, 2)
    steps = np.diff(rounds, axis=0)
    fixed = rounds[0][steps[0] == 0]
    return bool((steps == steps[0]).all() and (fixed < loop.start).all())
