"""Which engine a command runs: compiled C where there is a compiler, else CasADi's interpreter, and a line says so."""

import os

from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.errors import CompilerNotFoundError
from dualwinch.commands.output import terminal
from dualwinch.simulation.loop.engine import EngineName

NO_COMPILER = (
    "no C compiler found, so CasADi's interpreter runs instead: the same results, tens of times slower; "
    "install gcc or clang, or add the compiler from PyPI: uv run --extra zig dualwinch …"
)


def engine_here() -> EngineName:
    """The fastest engine that this machine has; where that is the interpreter, a line on standard error says so.

    Raises:
        CompilerNotFoundError: the compiler asked for by name (``DUALWINCH_CC``, ``CC``) is none.
    """
    try:
        find_compiler()
    except CompilerNotFoundError:
        if os.environ.get("DUALWINCH_CC") or os.environ.get("CC"):
            raise
        terminal(stderr=True, soft_wrap=True).print(NO_COMPILER)
        return "interpreter"
    return "compiled"
