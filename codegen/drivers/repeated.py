"""A function applied to its own result several times in compiled C, for many points."""

from collections.abc import Callable

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.cache import loaded
from dualwinch.codegen.compiler import NON_FINITE, find_compiler
from dualwinch.codegen.drivers.unit import recipe, unit
from dualwinch.codegen.source.c_source import PART, c_source

Floats = NDArray[np.float64]


def compile_repeated(
    function: ca.Function, rounds: int, flags: tuple[str, ...] = ()
) -> Callable[[Floats, Floats], Floats]:
    """Compile (or find in the cache) and load ``rounds`` calls of a function in a row.

    Args:
        function: ``function(state, constant, number) -> next`` of dense SX expressions; the number of a round counts
            from 0.
        rounds: number of calls.
        flags: additional flags for the compiler.

    Returns:
        ``(state, constant) -> result``, (s, state) and (s, constant) to (s, state). It releases the global interpreter
        lock.

    Raises:
        CompilerNotFoundError, CompileError, CacheError: as in `codegen.native.compile`.
    """
    sizes = {"STATE": function.numel_in(0), "CONSTANT": function.numel_in(1), "ROUNDS": rounds}

    def source() -> str:
        name = f"#define ROUND {function.name()}\n"
        return unit(sizes, (function,), c_source([function], part=PART), name, "repeated.c")

    made_of = recipe((function,), "repeated", PART, rounds)
    library = loaded(source, find_compiler(), (*NON_FINITE, *flags), made_of, repeated="pppn")

    def run(state: Floats, constant: Floats) -> Floats:
        result = np.empty(state.shape)
        library.repeated(np.ascontiguousarray(state), np.ascontiguousarray(constant), result, len(state))
        return result

    return run
