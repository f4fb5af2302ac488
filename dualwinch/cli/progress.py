"""Progress of a command: one line on a terminal, or occasional lines in a log.

Imports are light, so that the line appears before the rest of the program is loaded.
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
"""Width of the bar in characters."""


class ProgressLine:
    """A `simulation.progress.PhaseProgress` on standard error, used as a context manager.

    On a terminal it is a line that disappears at the end: phase, and status or a bar with the time left. In a log, a
    command with a name writes a line for each phase, and every ten seconds one with the status, or with the share
    done and the time left; a patient one writes only the latter; others write nothing.
    """

    def __init__(
        self, phase: str = "", *, command: str = "", patient: bool = False, console: Console | None = None
    ) -> None:
        """Begin with a phase.

        Args:
            phase: name of the first phase.
            command: beginning of the lines of a log; empty: no lines.
            patient: write no line in the first ten seconds, which most calls do not take.
            console: default: standard error.
        """
        self.console = console or Console(stderr=True, markup=False)
        self._command, self._patient, self._phase, self._status = command, patient, "", ""
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
        """Remove the line, before other output."""
        self._live.stop()

    def __call__(self, fraction: float, phase: str = "", status: str = "") -> None:
        """Report progress (`simulation.progress.PhaseProgress`)."""
        new = bool(phase) and phase != self._phase
        self._fraction, self._status = fraction, status
        if new:
            self._phase, self._first, self._began = phase, fraction, time.monotonic()
        if self.console.is_terminal:
            if new and self._live.is_started:
                self._live.refresh()
        elif self._command and new and not self._patient:
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
        """The time left, extrapolated from the time of the phase so far."""
        progress = self._fraction - self._first
        if not progress >= 0.01 or self._fraction >= 1:
            return ""
        seconds = (time.monotonic() - self._began) * (1 - self._fraction) / progress
        return f" · {seconds / 60:.0f} min left" if seconds >= 90 else f" · {seconds:.0f} s left"
