"""Lanes: runs of a closed loop side by side, each with its scenario and the page of signals that it reads."""

from collections.abc import Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.stepping import SteppedRuns, Stepping
from dualwinch.simulation.stepper.pages import Page
from dualwinch.simulation.stepper.scenarios import Lane

Indices = NDArray[np.int64]

NEVER = np.iinfo(np.int64).max


class Lanes:
    """Runs and their pages.

    Attributes:
        runs: what the compiled code moves on.
        lanes: what each run started from; not its first page, which would hold all that follow.
    """

    def __init__(self, code: Stepping, count: int, samples: int, *, shared: bool) -> None:
        """Make room; see `codegen.drivers.stepping.SteppedRuns`."""
        self.runs = SteppedRuns(code, count, samples, shared=shared)
        self.lanes: dict[int, Lane] = {}
        self._pages: dict[int, Page] = {}
        self._ends = np.full(count, NEVER)
        self._left = NEVER

    def start(self, indices: Indices, lanes: Sequence[Lane], pages: Sequence[Page]) -> None:
        """Begin some runs anew, each from a lane and its first page."""
        states, parameters = (np.array([getattr(lane, name) for lane in lanes]) for name in ("state", "parameters"))
        self.runs.start(indices, states, parameters)
        for index, lane, page in zip(indices.tolist(), lanes, pages, strict=True):
            self.lanes[index] = lane
            self._turn(index, page, 0)
        self._count_left()
        self.runs.look()

    def step(self, samples: int, threads: int = 1, row: int | None = None) -> int:
        """Move all runs under way on; the number of those that are so after it. See `SteppedRuns.step`."""
        running = 1
        while samples and running:
            stretch = min(samples, self._left)
            running = self.runs.step(stretch, threads, row)
            samples -= stretch
            self._left -= stretch
            if not self._left:
                self._turn_pages()
            if row is not None:
                row += stretch * 8 * self.runs.columns
        return running

    def copies(self, indices: Indices) -> "Lanes":
        """Some lanes as they are, in others that go on by themselves."""
        numbered = list(enumerate(indices.tolist()))
        other = copy(self)
        vars(other).update(
            runs=self.runs.copies(indices),
            lanes={to: self.lanes[index] for to, index in numbered},
            _pages={to: self._pages[index] for to, index in numbered},
            _ends=self._ends[indices],
        )
        return other

    def _turn(self, index: int, page: Page, sample: int) -> None:
        self._pages[index], self._ends[index] = page, page.end
        self.runs.read(index, page.address(sample))

    def _turn_pages(self) -> None:
        done = self.runs.done
        for index in np.flatnonzero((self.runs.outcomes == Outcome.RUNNING) & (done == self._ends)).tolist():
            self._turn(index, self._pages[index].following(), int(done[index]))
        self._count_left()

    def _count_left(self) -> None:
        """Samples until the first run under way has read its page."""
        running = self.runs.outcomes == Outcome.RUNNING
        self._left = int((self._ends - self.runs.done)[running].min(initial=NEVER))
