"""What a run receives from outside, page by page: drawn when first read, kept as long as somebody may read it."""

import threading
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.exogenous.signals import exogenous_pieces
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import exogenous_names

Floats = NDArray[np.float64]

ROOM = 2**27
"""Bytes that the pages take which are read side by side."""

SHORTEST, LONGEST = 256, 2**16
"""Samples of a page, at least and at most."""


class Page:
    """Signals of some samples of a run, and of the first sample of the page that follows.

    Readers of one run share its pages, wherever each of them is: a page holds the one that follows, once that has been
    read, and nothing holds a page that everybody has read.

    Attributes:
        table: (samples + 1, exogenous), columns in the closed loop's order.
        start: number of the first sample.
    """

    def __init__(self, table: Floats, start: int, source: Iterator[Floats], lock: threading.Lock) -> None:
        self.table, self.start = table, start
        self._source, self._lock = source, lock
        self._following: Page | None = None

    @property
    def end(self) -> int:
        """Number of the sample that the following page starts with."""
        return self.start + len(self.table) - 1

    def address(self, sample: int) -> int:
        """Where in memory the signals of a sample stand."""
        return self.table.__array_interface__["data"][0] + (sample - self.start) * self.table.strides[0]

    def following(self) -> "Page":
        """The next page."""
        with self._lock:
            if self._following is None:
                table = np.concatenate([self.table[-1:], next(self._source)])
                self._following = Page(table, self.end, self._source, self._lock)
            return self._following


def page_length(experiment: Experiment, runs: int) -> int:
    """Samples of a page where so many runs like `experiment` have pages of their own."""
    signals = len(exogenous_names(experiment.controller))
    return min(max(ROOM // (8 * signals * runs), SHORTEST), LONGEST)


def first_page(experiment: Experiment, length: int) -> Page:
    """The first page of a run, `length` samples long; all pages together hold one sample more than the run has.

    That is for the observation after the last sample.
    """
    source = exogenous_pieces(experiment, length, experiment.samples + 1)
    return Page(next(source), 0, source, threading.Lock())
