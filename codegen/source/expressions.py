"""How CasADi builds expressions: one thread at a time, and as they are written where that matters."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, wraps
from typing import ParamSpec, TypeVar

import casadi as ca

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
