"""Where tuning stands, as a `ProgressLine` shows it."""

import time
from typing import TYPE_CHECKING

from dualwinch.commands.progress import ProgressLine

if TYPE_CHECKING:
    from dualwinch.simulation.ensembles.result import Statistic
    from dualwinch.tuning.scoring.progress import SearchStatus


class StatusLine(ProgressLine):
    """Says what is being done, while it is used as a context.

    Attributes:
        objectives: names and units of what is minimised, once they are known.
    """

    def __init__(self, command: str = "tune") -> None:
        super().__init__(command=command)
        self.objectives: tuple[Statistic, ...] = ()

    def phase(self, words: str) -> None:
        """Say what is done from now on, at once."""
        self(0.0, words)

    def progress(self, progress: "SearchStatus", until: float | None, trials: int | None) -> None:
        """Say where the search stands: on a terminal after each batch, in a log now and then."""
        self(progress.share, status=self._search(progress, until, trials))

    def _search(self, now: "SearchStatus", until: float | None, trials: int | None) -> str:
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
