"""Functions that Python calls as they are and Numba compiles into their callers."""

from collections.abc import Callable
from typing import Any, TypeVar

Law = TypeVar("Law", bound=Callable[..., Any])

try:
    from numba.extending import register_jitable as _register_jitable  # pyright: ignore[reportMissingImports]
except ImportError:
    _register_jitable = None


def compilable(law: Law) -> Law:
    """The function itself; where Numba is installed, compiled code may call it too."""
    return law if _register_jitable is None else _register_jitable(error_model="numpy")(law)
