"""Where the instructions of a function repeat themselves."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.source.instructions import instructions, operands_of

WORTHWHILE = 200
"""How many statements a loop has to save."""


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


def longest_loop(function: ca.Function) -> Loop | None:
    """The loop that saves most of a function of SX expressions; None where there is none worth while."""
    made = instructions(function)
    operations = np.array([instruction.operation for instruction in made])
    operations[np.isin(operations, [ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST])] = -1  # none is like another
    operands = np.full((len(made), 2), -1)
    for index, values in operands_of(function).items():
        operands[index, : len(values)] = values
    best: Loop | None = None
    for length in range(1, len(made) // 2):
        before, after = operands[:-length], operands[length:]
        alike = (operations[:-length] == operations[length:]) & (operations[:-length] >= 0)
        alike &= ((before == after) | (before + length == after)).all(axis=1)
        edges = np.flatnonzero(np.diff(alike.astype(int), prepend=0, append=0)).tolist()
        for start, end in zip(edges[::2], edges[1::2], strict=True):
            loop = Loop(start, length, (end - start) // length + 1)
            if loop.saved >= (best.saved + 1 if best else WORTHWHILE) and _regular(loop, operands):
                best = loop
    return best


def _regular(loop: Loop, operands: NDArray[np.int_]) -> bool:
    """Whether every round finds its operands as the first one does."""
    rounds = operands[loop.start : loop.end].reshape(loop.rounds, loop.length, 2)
    steps = np.diff(rounds, axis=0)
    fixed = rounds[0][steps[0] == 0]
    return bool((steps == steps[0]).all() and (fixed < loop.start).all())
