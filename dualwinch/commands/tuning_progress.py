"""Where tuning stands: one line on a terminal that is there at once, or a line now and then in a log.

Nothing is imported here that takes long, so that the first line is there before the rest of the program is.
"""

import time
from types import TracebackType
from typing import TYPE_CHECKING, Self

from rich.console import Console
from rich.live import Live
from rich.spinner import Spinner
from rich.text import Text

if TYPE_CHECKING:
    from dualwinch.simulation.ensembles.result import Statistic
    from dualwinch.tuning.scoring.progress import SearchStatus

EVERY = 10.0
"""Time in s between two lines of a search where there is no terminal."""


class StatusLine:
    """Says what is being done, while it is used as a context.

    Attributes:
        name: of the command; it begins the lines of a log.
        console: standard error.
        objectives: names and units of what is minimised, once they are known.
    """

    def __init__(self, name: str = "tune", console: Console | None = None) -> None:
        self.name, self.console = name, console or Console(stderr=True, markup=False)
        self.objectives: tuple[Statistic, ...] = ()
        self._spinner = Spinner("dots")
        self._live = Live(self._spinner, console=self.console, transient=True) if self.console.is_terminal else None
        self._said = time.monotonic()

    def __enter__(self) -> Self:
        if self._live:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def stop(self) -> None:
        """Take the line away, for what is printed from now on."""
        if self._live:
            self._live.stop()

    def phase(self, words: str) -> None:
        """Say what is done from now on, at once."""
        if self._live:
            self._update(words)
        else:
            self.say(f"{self.name}: {words}")

    def progress(self, progress: "SearchStatus", until: float | None, trials: int | None) -> None:
        """Say where the search stands: on a terminal after each batch, in a log now and then."""
        if self._live:
            self._update(self._line(progress, until, trials))
        elif time.monotonic() - self._said > EVERY:
            self.say(f"{self.name}: {self._line(progress, until, trials)}")

    def say(self, words: str) -> None:
        """A line that stays."""
        self._said = time.monotonic()
        self.console.print(words, highlight=False, markup=False, soft_wrap=True)

    def _update(self, words: str) -> None:
        self._spinner.update(text=Text(words, no_wrap=True, overflow="ellipsis"))
        if self._live:
            self._live.refresh()

    def _line(self, now: "SearchStatus", until: float | None, trials: int | None) -> str:
        of = f" of {trials}" if trials else ""
        words = [f"{_left(now, until, trials):.0f} s left"]
        words.append(f"{now.trials}{of} trials, {100 * now.feasible / max(now.trials, 1):.0f} % feasible")
        if now.best:
            values = ", ".join(
                f"{statistic.name} {value:.4g} {'' if statistic.unit == '1' else statistic.unit}".rstrip()
                for statistic, value in zip(self.objectives, now.best.objectives, strict=False)
            )
            words.append(f"best {values}" + ("" if now.best.feasible else " (not feasible)"))
        if now.rollout_seconds:
            words.append(f"{now.rollouts / now.rollout_seconds:.0f} rollouts/s")
        return " · ".join(words)


def _left(now: "SearchStatus", until: float | None, trials: int | None) -> float:
    """Time in s that the search will take, by the budget that ends first."""
    left: list[float] = []
    if until is not None:
        left.append(until - time.time())
    if trials is not None and now.trials:
        left.append(now.seconds * (trials / now.trials - 1))
    if now.share:
        left.append(now.seconds * (1 / now.share - 1))
    return max(min(left, default=0.0), 0.0)
