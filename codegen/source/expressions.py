"""CasADi's expressions: how they are built and kept, and the instructions of a function of SX expressions.

They are built on one thread at a time, and as they are written where that matters; what is built of them is kept
within a number of bytes.
"""

import sys
import threading
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import Any, NamedTuple, ParamSpec, TypeVar

import casadi as ca

from dualwinch.codegen.errors import CodegenError

Arguments = ParamSpec("Arguments")
Built = TypeVar("Built")

BUILDING = threading.RLock()
"""Held while expressions are built: CasADi shares them between threads without locks of its own, and what it simplifies
is one setting for all. Functions that are built may be called on any thread."""


class _Call:
    """A call as a key of the cache; its hash, which goes through all numbers of a plant, is computed once."""

    __slots__ = ("arguments", "hash")

    def __init__(self, *arguments: Any) -> None:
        self.arguments = arguments
        self.hash = hash(arguments)

    def __hash__(self) -> int:
        return self.hash

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Call) and self.arguments == other.arguments


class GraphCache:
    """Cache of what functions build of hashable arguments, by least recent use within a number of bytes.

    One cache for all functions: a process that has gone through many laws, estimators and ropes keeps the graphs of the
    latest ones. The result of the last call stays, however large it is.

    Args:
        limit: most bytes, as estimated, of all results and the arguments they were built of.
        per_instruction: bytes of one instruction of a CasADi function: its node and its place in the algorithm take 75,
            the rest is for sparsity patterns and what CasADi keeps of derivatives.
        sample: most elements of a sequence whose bytes are counted; those of a longer one are as many times more.
    """

    def __init__(self, limit: int = 512 << 20, per_instruction: int = 110, sample: int = 100) -> None:
        self.limit = limit
        self.per_instruction = per_instruction
        self.sample = sample
        self.size = 0
        """Estimated bytes of what is kept now."""
        self._kept: OrderedDict[_Call, tuple[Any, set[ca.Function], int]] = OrderedDict()
        self._users = Counter[ca.Function]()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        """How many results are kept now."""
        return len(self._kept)

    def clear(self) -> None:
        """Keep nothing of what was built so far."""
        with self._lock:
            self._kept.clear()
            self._users.clear()
            self.size = 0

    def cached(self, build: Callable[Arguments, Built]) -> Callable[Arguments, Built]:
        """Decorator: a function whose results this cache keeps. Two threads may build the same result at once."""

        @wraps(build)
        def found(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Built:
            call = _Call(build, args, frozenset(kwargs.items()))
            with self._lock:
                if call in self._kept:
                    self._kept.move_to_end(call)
                    return self._kept[call][0]
            result = build(*args, **kwargs)
            functions = set[ca.Function]()
            rest = self._bytes_beside_functions((call.arguments, result), functions)
            with self._lock:
                if call not in self._kept:
                    self._kept[call] = result, functions, rest
                    self._count(functions, rest, 1)
                while self.size > self.limit and len(self._kept) > 1:
                    _, (_, functions, rest) = self._kept.popitem(last=False)
                    self._count(functions, rest, -1)
            return result

        return found

    def _bytes_beside_functions(self, value: object, functions: set[ca.Function]) -> int:
        """Estimated bytes of a value without CasADi functions, which are added to those given."""
        if isinstance(value, ca.Function):
            functions.add(value)
            return 0
        if isinstance(value, Mapping):
            parts = list(value.values())
        elif isinstance(value, tuple | list | frozenset):
            parts = list(value)
        elif is_dataclass(value) and not isinstance(value, type):
            parts = [getattr(value, field.name) for field in fields(value)]
        else:
            return sys.getsizeof(value)
        counted = parts[:: -(-len(parts) // self.sample) or 1]
        size = sum(self._bytes_beside_functions(part, functions) for part in counted)
        return sys.getsizeof(value) + (size * len(parts) // len(counted) if counted else 0)

    def _count(self, functions: Iterable[ca.Function], rest: int, sign: int) -> None:
        """Add the bytes of an entry, or take them away; a function that several entries have counts once."""
        self.size += sign * rest
        for function in functions:
            users = self._users[function]
            self._users[function] = users + sign
            if 0 in {users, users + sign}:
                self.size += sign * self.per_instruction * _instructions(function)
            if users + sign == 0:
                del self._users[function]


def _instructions(function: ca.Function) -> int:
    """The number of instructions, or of numbers in the work vectors of what has none, and those of what it calls.

    A solver calls the derivatives of its problem, ten times as large as all else of it.
    """
    if function.is_a("SXFunction"):
        return function.n_instructions()
    own = function.n_instructions() if function.is_a("MXFunction") else function.sz_w() + function.sz_iw()
    return own + sum(_instructions(function.get_function(name)) for name in function.get_function())


GRAPHS = GraphCache()
"""What the functions of this process build of structures, and what is compiled of them."""


def built_once(build: Callable[Arguments, Built]) -> Callable[Arguments, Built]:
    """Decorator: `GRAPHS` keeps what a function of hashable arguments builds, on one thread at a time."""
    cached = GRAPHS.cached(build)

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


@GRAPHS.cached
def instructions(function: ca.Function) -> tuple[Instruction, ...]:
    """The instructions of a function in their order.

    Raises:
        CodegenError: it is no function of SX expressions.
    """
    if not function.is_a("SXFunction"):
        raise CodegenError(f"{function.name()} is no function of SX expressions; expand() it first")
    found = []
    for index in range(function.n_instructions()):
        operation = function.instruction_id(index)
        read, written = function.instruction_input(index), function.instruction_output(index)
        constant = function.instruction_constant(index) if operation == ca.OP_CONST else 0.0
        found.append(Instruction(operation, tuple(read), tuple(written), constant))
    return tuple(found)


def elements_read(function: ca.Function, name: str) -> set[int]:
    """Which elements of an input a function reads, or might; none where it has no such input."""
    if name not in function.name_in():
        return set()
    if not function.is_a("SXFunction"):
        return set(range(function.numel_in(name)))
    argument, steps = function.name_in().index(name), range(function.n_instructions())
    reads = (function.instruction_input(step) for step in steps if function.instruction_id(step) == ca.OP_INPUT)
    return {element for vector, element in reads if vector == argument}


def applied(operation: int, operands: Sequence[ca.SX]) -> ca.SX:
    """An operation of one or two operands as an expression."""
    build = ca.SX.unary if len(operands) == 1 else ca.SX.binary
    return build(operation, *operands)


def operands_of(function: ca.Function) -> dict[int, tuple[int, ...]]:
    """Instruction → the instructions that made its operands; none for inputs and constants.

    Raises:
        CodegenError: the function calls another one, which has many results.
    """
    made_by: dict[int, int] = {}
    operands: dict[int, tuple[int, ...]] = {}
    for index, (operation, read, written, _) in enumerate(instructions(function)):
        if operation == ca.OP_CALL:
            raise CodegenError(f"{function.name()} calls a function that is not inlined; its derivatives are not there")
        if operation not in {ca.OP_INPUT, ca.OP_CONST}:
            operands[index] = tuple(made_by[register] for register in read)
        if operation != ca.OP_OUTPUT:
            made_by[written[0]] = index
    return operands
