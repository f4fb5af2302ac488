"""Signals of the latest scenarios, kept: all controllers and candidates of a scenario share them."""

import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from cachetools import LRUCache, cached
from numpy.typing import NDArray

from dualwinch.controllers.controller import Controller
from dualwinch.simulation.batch.cores import cores
from dualwinch.simulation.exogenous.signals import SIGNALS, exogenous_signals
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

SHARE = 8 * SIGNALS * 50_000
"""Bytes of a scenario of 50 s at 1 kHz. A shorter one counts for as many: a portion's scenarios are kept, not more."""

ROOM = 32 * cores() * SHARE
"""Bytes of the signals that are kept: those of a portion."""


def size(table: Floats) -> int:
    """Bytes that the signals of a scenario count for."""
    return max(table.nbytes, SHARE)


def _scenario(experiment: Experiment) -> Experiment:
    return replace(experiment, controller=Controller())


def keeping(room: int) -> Callable[[Experiment], Floats]:
    """The signals of an experiment (`exogenous_signals`), those asked for last kept within a number of bytes.

    They do not depend on the controller, are for many threads, and not to be written to.
    """
    return cached(LRUCache(room, getsizeof=size), key=_scenario, lock=threading.Lock())(exogenous_signals)


signals = keeping(ROOM)
"""The signals of an experiment, kept for the next call."""
