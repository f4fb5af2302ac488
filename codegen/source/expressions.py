"""CasADi's expressions: construction and cache, and the instructions of a function of SX expressions.

Expressions are built on one thread at a time, and without simplification where that matters; the cache of results is
limited.
"""

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from functools import wraps
from itertools import islice
from typing import Any, NamedTuple, ParamSpec, TypeVar

import casadi as ca

from dualwinch.codegen.errors import CodegenError

Arguments = ParamSpec("Arguments")
Built = TypeVar("Built")

BUILDING = threading.RLock()
"""Lock for the construction of expressions: CasADi shares them between threads without locks, and its setting of
simplification is global. Finished functions may be called on any thread."""


class _Call:
    """A call as a key of the cache; its hash, over all numbers of a plant, is computed once."""

    __slots__ = ("arguments", "hash")

    def __init__(self, *arguments: Any) -> None:
        self.arguments = arguments
        self.hash = hash(arguments)

    def __hash__(self) -> int:
        return self.hash

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Call) and self.arguments == other.arguments


class GraphCache:
    """Least-recently-used cache of results of functions of hashable arguments, limited in instructions.

    There is one cache for all functions: a process with many laws, estimators and ropes keeps the graphs of the latest
    ones. The result of the last call is kept at any size.

    Args:
        limit: largest number of instructions of the CasADi functions in all results and their arguments, of some 100
            bytes each; a function counts in each of them.
    """

    def __init__(self, limit: int = 2**23) -> None:
        self.limit, self.size = limit, 0
        self._results: OrderedDict[_Call, tuple[Any, int]] = OrderedDict()
        self._lock = threading.Lock()

    def cached(self, build: Callable[Arguments, Built]) -> Callable[Arguments, Built]:
        """Decorator: cache the results of a function. Two threads may build the same result at once."""

        @wraps(build)
        def result_of(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Built:
            call = _Call(build, args, frozenset(kwargs.items()))
            with self._lock:
                if call in self._results:
                    self._results.move_to_end(call)
                    return self._results[call][0]
            result = build(*args, **kwargs)
            size = _instructions_in((call.arguments, result))
            with self._lock:
                if call not in self._results:
                    self._results[call] = result, size
                    self.size += size
                while self.size > self.limit and len(self._results) > 1:
                    self.size -= self._results.popitem(last=False)[1][1]
            return result

        return result_of


def _instructions_in(value: object) -> int:
    """Number of instructions of the CasADi functions in a value, at most a hundred in each sequence.

    Those of called functions are included: a solver calls the derivatives of its problem, which are ten times as large
    as the rest of it. Where a function has no instructions, the length of its work vectors is taken.
    """
    if isinstance(value, ca.Function):
        if value.is_a("SXFunction"):
            return value.n_instructions()
        count = value.n_instructions() if value.is_a("MXFunction") else value.sz_w() + value.sz_iw()
        return count + sum(_instructions_in(value.get_function(name)) for name in value.get_function())
    parts: Iterable[object] = ()
    if isinstance(value, Mapping):
        parts = value.values()
    elif isinstance(value, tuple | list | frozenset):
        parts = value
    elif is_dataclass(value) and not isinstance(value, type):
        parts = (getattr(value, field.name) for field in fields(value))
    return sum(map(_instructions_in, islice(parts, 100)))


GRAPHS = GraphCache()
"""Cache of this process for built and compiled functions."""


def built_once(build: Callable[Arguments, Built]) -> Callable[Arguments, Built]:
    """Decorator: cache a function of hashable arguments in `GRAPHS`, and run it on one thread at a time."""
    cached = GRAPHS.cached(build)

    @wraps(build)
    def result_of(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Built:
        with BUILDING:
            return cached(*args, **kwargs)

    return result_of


@contextmanager
def as_written() -> Iterator[None]:
    """Context without CasADi's simplifications, such as x (1/y) to x/y."""
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
        operation: CasADi's code of the operation (``OP_ADD``, …).
        read: the registers of its operands; for an input, its argument and element.
        written: the register of its result; for an output, its result and element.
        constant: the value of a constant.
    """

    operation: int
    read: tuple[int, ...]
    written: tuple[int, ...]
    constant: float


@GRAPHS.cached
def instructions(function: ca.Function) -> tuple[Instruction, ...]:
    """The instructions of a function in their order.

    Raises:
        CodegenError: it is no function of SX expressions.
    """
    if not function.is_a("SXFunction"):
        raise CodegenError(f"{function.name()} is no function of SX expressions; expand() it first")
    listing = []
    for index in range(function.n_instructions()):
        operation = function.instruction_id(index)
        read, written = function.instruction_input(index), function.instruction_output(index)
        constant = function.instruction_constant(index) if operation == ca.OP_CONST else 0.0
        listing.append(Instruction(operation, tuple(read), tuple(written), constant))
    return tuple(listing)


def elements_read(function: ca.Function, name: str) -> set[int]:
    """The elements of an input that a function reads or may read; none without such an input."""
    if name not in function.name_in():
        return set()
    if not function.is_a("SXFunction"):
        return set(range(function.numel_in(name)))
    argument, steps = function.name_in().index(name), instructions(function)
    return {step.read[1] for step in steps if step.operation == ca.OP_INPUT and step.read[0] == argument}


def applied(operation: int, operands: Sequence[ca.SX]) -> ca.SX:
    """An operation of one or two operands as an expression."""
    build = ca.SX.unary if len(operands) == 1 else ca.SX.binary
    return build(operation, *operands)


def operands_of(function: ca.Function) -> dict[int, tuple[int, ...]]:
    """Instruction → the instructions that computed its operands; none for inputs and constants.

    Raises:
        CodegenError: the function calls another function.
    """
    made_by: dict[int, int] = {}
    operands: dict[int, tuple[int, ...]] = {}
    for index, (operation, read, written, _) in enumerate(instructions(function)):
        if operation == ca.OP_CALL:
            raise CodegenError(f"{function.name()} calls a function that is not inlined; its derivatives are missing")
        if operation not in {ca.OP_INPUT, ca.OP_CONST}:
            operands[index] = tuple(made_by[register] for register in read)
        if operation != ca.OP_OUTPUT:
            made_by[written[0]] = index
    return operands


def with_fixed(function: ca.Function, argument: str, element: int, value: float) -> tuple[list[ca.SX], list[ca.SX]]:
    """New symbols for the inputs of a function, and its outputs with one element of an input fixed.

    Choices which that decides are left out, with all that only they need. What is left are the same operations, and so
    the same results to the last bit.

    Raises:
        CodegenError: as for `operands_of`.
    """
    symbols = [ca.SX.sym(name, function.size1_in(name)) for name in function.name_in()]
    outputs = [[ca.SX(0)] * function.numel_out(vector) for vector in range(function.n_out())]
    values, operands, fixed = dict[int, ca.SX](), operands_of(function), (function.name_in().index(argument), element)
    decided = set[int]()  # instructions with constant results, because of the fixed element
    with as_written():
        for step, instruction in enumerate(instructions(function)):
            operation, made_of = instruction.operation, operands.get(step, ())
            arguments = [values[operand] for operand in made_of]
            if operation == ca.OP_OUTPUT:
                vector, index = instruction.written
                outputs[vector][index] = arguments[0]
            elif operation == ca.OP_INPUT:
                vector, index = instruction.read
                values[step] = ca.SX(value) if instruction.read == fixed else symbols[vector][index]
                decided |= {step} if instruction.read == fixed else set()
            elif operation == ca.OP_CONST:
                values[step] = ca.SX(instruction.constant)
            elif decided.isdisjoint(made_of):
                values[step] = applied(operation, arguments)
            else:
                values[step] = _decided(operation, arguments)
                decided |= {step} if values[step].is_constant() else set()
    return symbols, [ca.vertcat(*elements) for elements in outputs]


def _decided(operation: int, operands: list[ca.SX]) -> ca.SX:
    """An operation of which an operand is a constant: its result if that decides it."""
    if all(operand.is_constant() for operand in operands):
        return ca.SX(float(ca.evalf(applied(operation, operands))))
    nothing = [operand.is_constant() and operand.is_zero() for operand in operands]
    if operation == ca.OP_IF_ELSE_ZERO and operands[0].is_constant():
        return ca.SX(0) if nothing[0] else operands[1]
    if operation == ca.OP_MUL and any(nothing):
        return ca.SX(0)
    if operation == ca.OP_ADD and any(nothing):
        return operands[nothing.index(True) ^ 1]
    return applied(operation, operands)
