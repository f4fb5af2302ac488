"""Ensembles of short runs, and what a computation takes of memory."""

import gc
import tracemalloc
from collections.abc import Callable

from dualwinch.config.ensemble_file import load_ensemble, reset
from dualwinch.simulation.ensembles.ensemble import Ensemble


def lasting(seconds: float, name: str = "sea") -> Ensemble:
    """A built-in ensemble whose runs last so long."""
    return reset(load_ensemble(name), {"simulation.duration": seconds})


def peak_memory(call: Callable[[], object]) -> int:
    """Largest memory in bytes that Python's objects take during a call."""
    gc.collect()
    gc.freeze()  # or garbage of other tests puts off that of this one
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
        gc.unfreeze()
