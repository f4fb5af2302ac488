"""CasADi's expressions: how they are built, and the instructions that a function of SX expressions consists of.

They are built on one thread at a time, and as they are written where that matters.
"""

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache, wraps
from typing import NamedTuple, ParamSpec, TypeVar

import casadi as ca

from dualwinch.codegen.errors import CodegenError

Arguments = ParamSpec("Arguments")
Built = TypeVar("Built")

BUILDING = threading.RLock()
"""Held while expressions are built: CasADi shares them between threads without locks of its own, and what it simplifies
is one setting for all. Functions that are built may be called on any thread."""


def built_once(build: Callable[Arguments, Built]) -> Callable[Arguments, Built]:
    """A cache of what a function of hashable arguments builds, on one thread at a time."""
    cached = cache(build)

    @wraps(build)
    def found(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Built:
        with BUILDING:
            return cached(*args, **kwargs)

    return found


@contextmanager
def as_written() -> Iterator[None]:
    """Within, CasADi keeps x (1/y) as it is; else it makes x/y of it."""
    with BUILDING:
        before = ca.GlobalOptions.getSimplificationOnTheFly()
        ca.GlobalOptions.setSimplificationOnTheFly(False)
        try:
            yield
        finally:
            ca.GlobalOptions.setSimplificationOnTheFly(before)


class Instruction(NamedTuple):
    """One instruction.

    Attributes:
        operation: CasADi's number of it (``OP_ADD``, …).
        read: the registers of its operands; of an input, its argument and element.
        written: the register of its result; of an output, its result and element.
        constant: the number, of a constant.
    """

    operation: int
    read: tuple[int, ...]
    written: tuple[int, ...]
    constant: float


@lru_cache(maxsize=64)
def instructions(function: ca.Function) -> tuple[Instruction, ...]:
    """The instructions of a function in their order.

    Raises:
        CodegenError: it is no function of SX expressions, or calls another one.
    """
    if not function.is_a("SXFunction"):
        raise CodegenError(f"{function.name()} is no function of SX expressions; expand() it first")
    found = []
    for index in range(function.n_instructions()):
        operation = function.instruction_id(index)
        if operation == ca.OP_CALL:
            raise CodegenError(f"no plain C for {function.name()}: it calls a function that is not inlined")
        read, written = function.instruction_input(index), function.instruction_output(index)
        constant = function.instruction_constant(index) if operation == ca.OP_CONST else 0.0
        found.append(Instruction(operation, tuple(read), tuple(written), constant))
    return tuple(found)


def elements_read(function: ca.Function, name: str) -> set[int]:
    """Which elements of an input a function reads; none where it has no such input."""
    if name not in function.name_in():
        return set()
    argument = function.name_in().index(name)
    reads = (made.read for made in instructions(function) if made.operation == ca.OP_INPUT)
    return {element for vector, element in reads if vector == argument}


def applied(operation: int, operands: Sequence[ca.SX]) -> ca.SX:
    """An operation of one or two operands as an expression."""
    build = ca.SX.unary if len(operands) == 1 else ca.SX.binary
    return build(operation, *operands)


def operands_of(function: ca.Function) -> dict[int, tuple[int, ...]]:
    """Instruction → the instructions that made its operands; none for inputs and constants."""
    made_by: dict[int, int] = {}
    operands: dict[int, tuple[int, ...]] = {}
    for index, (operation, read, written, _) in enumerate(instructions(function)):
        if operation not in {ca.OP_INPUT, ca.OP_CONST}:
            operands[index] = tuple(made_by[register] for register in read)
        if operation != ca.OP_OUTPUT:
            made_by[written[0]] = index
    return operands
