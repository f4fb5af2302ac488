"""Functions of users over symbols: what asks a symbol for its value is told in a line, with what to write instead."""

from collections.abc import Iterator
from contextlib import contextmanager

import casadi as ca

from dualwinch.codegen.errors import DualwinchError
from dualwinch.model.errors import ConfigurationError

BRANCHES = "use where(condition, a, b) of dualwinch.model.scalar in place of if, and, or, not, min and max"
FUNCTIONS = "use functions of dualwinch.model.scalar or casadi in place of those of math and others"

HINTS = {
    "truth value": BRANCHES,
    "a symbol is no float": FUNCTIONS,
    "to_int not defined": FUNCTIONS,
    "interpreted as an integer": FUNCTIONS,
    "casadi SX does not support": FUNCTIONS,
}
"""What stands in errors of Python, CasADi and below → what to write instead."""

AS_FLOAT = ca.SX.__float__


@contextmanager
def over_symbols(name: str) -> Iterator[None]:
    """Call a user's function over symbols in here.

    The float of a symbol is an error in here. CasADi gives NaN, of which `math` makes more, without a word.

    Args:
        name: what the function is called in messages, e.g. ``mine: its step``.

    Raises:
        ConfigurationError: the function asks a symbol for its value.
    """
    ca.SX.__float__ = _float  # pyright: ignore[reportAttributeAccessIssue]
    try:
        yield
    except DualwinchError:
        raise
    except Exception as error:
        hint = next((hint for words, hint in HINTS.items() if words in str(error)), None)
        if hint is None:
            raise
        raise ConfigurationError(f"{name} asks for the value of a symbol; {hint}") from error
    finally:
        ca.SX.__float__ = AS_FLOAT


def _float(symbol: ca.SX) -> float:
    if not symbol.is_constant():
        raise TypeError("a symbol is no float")
    return AS_FLOAT(symbol)
