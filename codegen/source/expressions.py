"""How CasADi builds expressions: one thread at a time, and as they are written where that matters."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import casadi as ca

BUILDING = threading.RLock()
"""Held while expressions are built: what CasADi simplifies is one setting for all threads."""


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
