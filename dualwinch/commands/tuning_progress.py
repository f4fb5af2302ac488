"""Where a study stands, as one line on a terminal, or a line now and then in a log."""

import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.live import Live
from rich.text import Text

from dualwinch.tuning.problem import Problem
from dualwinch.tuning.storage.store import Budget
from dualwinch.tuning.study import Progress

EVERY = 10.0
"""Time in s between two lines where there is no terminal."""


class Watch:
    """Shows a study's progress while it is used as a context.

    Attributes:
        progress: the last that was shown.
    """

    def __init__(self, console: Console, problem: Problem, budget: Budget) -> None:
        self.progress = Progress()
        self._console, self._problem, self._budget = console, problem, budget
        self._live = Live(console=console, transient=True) if console.is_terminal else None
        self._said = time.monotonic()

    def __enter__(self) -> Self:
        if self._live:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live:
            self._live.stop()

    def show(self, progress: Progress) -> None:
        """Show where a study stands."""
        self.progress = progress
        if self._live:
            self._live.update(Text(self._line()))
        elif time.monotonic() - self._said > EVERY:
            self._said = time.monotonic()
            self._console.print(self._line(), highlight=False, soft_wrap=True)

    def _line(self) -> str:
        now, words = self.progress, []
        of = f" of {self._budget.trials}" if self._budget.trials else ""
        words.append(f"{now.trials}{of} trials, {100 * now.feasible / max(now.trials, 1):.0f} % feasible")
        if now.best:
            values = ", ".join(
                f"{one.name} {value:.4g} {'' if one.unit == '1' else one.unit}".rstrip()
                for one, value in zip(self._problem.minimised, now.best.objectives, strict=True)
            )
            words.append(f"best {values}" + ("" if now.best.feasible else " (not feasible)"))
        if now.rollout_seconds:
            words.append(f"{now.rollouts / now.rollout_seconds:.0f} rollouts/s")
        words.append(f"{self._remaining():.0f} s left")
        return " · ".join(words)

    def _remaining(self) -> float:
        left = []
        if self._budget.until is not None:
            left.append(self._budget.until - time.time())
        if self._budget.trials is not None and self.progress.trials:
            share = self.progress.trials / self._budget.trials
            left.append(self.progress.seconds * (1 / share - 1))
        return max(min(left, default=0.0), 0.0)
