"""How far a command is: one line on a terminal that is there at once, or a line now and then in a log.

Nothing is imported here that takes long, so that the first line is there before the rest of the program is.
"""

import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.spinner import Spinner
from rich.table import Table
from rich.text import Text

INTERVAL = 10.0
"""Time in s between two lines of a phase in a log."""

BAR_WIDTH = 40
"""Columns of a terminal."""


class ProgressLine:
    """A `simulation.progress.PhaseProgress` on standard error, while it is used as a context.

    On a terminal it is a line that disappears at the end: phase, and status or a bar with the time left. Elsewhere a
    command with a name writes a line for each phase, and every ten seconds one with the status, or with the share that
    is done and the time left; others write nothing.
    """

    def __init__(self, phase: str = "", *, command: str = "", console: Console | None = None) -> None:
        """Begin with a phase.

        Args:
            phase: what is done first.
            command: begins the lines of a log; empty: there are none.
            console: default: standard error.
        """
        self.console = console or Console(stderr=True, markup=False)
        self._command, self._phase, self._status = command, "", ""
        self._fraction = self._first = 0.0
        self._began = self._written = time.monotonic()
        self._spinner = Spinner("dots")
        self._live = Live(get_renderable=self._line, console=self.console, transient=True)
        if phase:
            self(0.0, phase)

    def __enter__(self) -> Self:
        if self.console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def stop(self) -> None:
        """Take the line away, for what is printed from now on."""
        self._live.stop()

    def __call__(self, fraction: float, phase: str = "", status: str = "") -> None:
        """Report progress, as `simulation.progress.PhaseProgress` says."""
        new = bool(phase) and phase != self._phase
        self._fraction, self._status = fraction, status
        if new:
            self._phase, self._first, self._began = phase, fraction, time.monotonic()
        if self.console.is_terminal:
            if new and self._live.is_started:
                self._live.refresh()
        elif self._command and new:
            self.say(f"{self._command}: {phase}")
        elif self._command and time.monotonic() - self._written > INTERVAL:
            self.say(f"{self._command}: {status or f'{self._phase}, {100 * fraction:.0f} %{self._left()}'}")

    def say(self, words: str) -> None:
        """Write a line that stays."""
        self._written = time.monotonic()
        self.console.print(words, highlight=False, markup=False, soft_wrap=True)

    def _line(self) -> Table:
        line = Table.grid(padding=(0, 1))
        words = Text(self._status or self._phase, no_wrap=True, overflow="ellipsis")
        if self._status or not self._fraction:
            line.add_row(self._spinner, words)
        else:
            bar = ProgressBar(total=1.0, completed=self._fraction, width=BAR_WIDTH)
            line.add_row(self._spinner, words, bar, f"{100 * self._fraction:.0f} %{self._left()}")
        return line

    def _left(self) -> str:
        """The time left, from what the phase took so far."""
        done = self._fraction - self._first
        if not done >= 0.01 or self._fraction >= 1:
            return ""
        left = (time.monotonic() - self._began) * (1 - self._fraction) / done
        return f" · {left / 60:.0f} min left" if left >= 90 else f" · {left:.0f} s left"
