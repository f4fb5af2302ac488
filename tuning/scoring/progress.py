"""Where a study stands, and who is told of it: the phases of tuning in words, and the search batch by batch."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from dualwinch.tuning.scoring.ranking import Evaluation, best_first

DRAWING = "drawing scenarios"
REFERENCES = "compiling; scoring the paper's gains and the start"
SEARCHING = "searching"
CHOOSING = "choosing among the finalists"
SCORING = "scoring the best, the start and the paper's gains"
PHASES = (DRAWING, REFERENCES, SEARCHING, CHOOSING, SCORING)
"""What `tuning.tune.tune` does, in this order."""


@dataclass
class SearchStatus:
    """Where a study stands.

    Attributes:
        trials: finished trials, of all workers.
        feasible: how many of them keep to every constraint.
        best: the best so far, by `tuning.scoring.ranking`; ``None`` before the first.
        rollouts: rollouts of this process.
        rollout_seconds: wall time they took.
        seconds: wall time of the search in this process.
        spent: rollouts of the finished trials, of all workers, and of this process's gradients.
        share: of the rollouts that there may be; 0 where the budget does not say.
    """

    trials: int = 0
    feasible: int = 0
    best: Evaluation | None = None
    rollouts: int = 0
    rollout_seconds: float = 0.0
    seconds: float = 0.0
    spent: int = 0
    share: float = 0.0

    def add(self, evaluations: Sequence[Evaluation]) -> None:
        """Count further finished trials."""
        self.trials += len(evaluations)
        self.feasible += sum(evaluation.feasible for evaluation in evaluations)
        self.spent += sum(evaluation.scenarios for evaluation in evaluations)
        for evaluation in evaluations:
            if self.best is None or best_first([self.best, evaluation])[0]:
                self.best = evaluation

    @property
    def overhead(self) -> float:
        """Share of the wall time that was not spent in rollouts."""
        return 1 - self.rollout_seconds / self.seconds if self.seconds else 0.0


class TuningProgress(Protocol):
    """Whoever is told how far tuning is."""

    def phase(self, words: str) -> None:
        """A phase begins; `words` say what is done in it."""
        ...

    def progress(self, progress: SearchStatus, until: float | None, trials: int | None) -> None:
        """A batch of the search is finished; it ends at the time `until` in s since the epoch, or after `trials`."""
        ...


class NoTuningProgress:
    """Tells nobody."""

    def phase(self, words: str) -> None:
        """Say nothing."""

    def progress(self, progress: SearchStatus, until: float | None, trials: int | None) -> None:
        """Say nothing."""


SILENT = NoTuningProgress()
