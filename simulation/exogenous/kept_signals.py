"""Signals of the latest scenarios, kept: all controllers and candidates of a scenario share them."""

import threading
from collections import OrderedDict
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.controllers.controller import Controller
from dualwinch.simulation.batch.cores import cores
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

KEPT, KEPT_BYTES = 32 * cores(), 2**27 * cores()
"""Scenarios whose signals are kept, and room for them: those of a portion of 50 s at 1 kHz."""


class KeptSignals:
    """The signals of the experiments that were asked for last, so many and so many bytes; for many threads."""

    def __init__(self, most: int, room: int) -> None:
        self._most, self._room, self._taken = most, room, 0
        self._tables: OrderedDict[Experiment, Floats] = OrderedDict()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._tables)

    def __call__(self, experiment: Experiment) -> Floats:
        """The signals of an experiment (`exogenous_signals`); not to be written to. They leave the controller out."""
        key = replace(experiment, controller=Controller())
        with self._lock:
            if key in self._tables:
                self._tables.move_to_end(key)
                return self._tables[key]
        table = exogenous_signals(key)
        with self._lock:
            if key not in self._tables and table.nbytes <= self._room:
                self._tables[key] = table
                self._taken += table.nbytes
            while self._taken > self._room or len(self) > self._most:
                self._taken -= self._tables.popitem(last=False)[1].nbytes
        return table


signals = KeptSignals(KEPT, KEPT_BYTES)
"""The signals of an experiment, kept for the next call."""
