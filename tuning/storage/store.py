"""What a study asks of the storage that keeps its trials."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from dualwinch.tuning.scoring.ranking import Candidate, Evaluation

Propose = Callable[[int, bool], list[Candidate]]
"""``propose(count, first)``: candidates; `first` where the study has no trial yet."""


@dataclass(frozen=True)
class TrialClaim:
    """A candidate that is this process's to evaluate.

    Attributes:
        candidate: what to evaluate.
        trial: its id in the storage; 0 where it appears there only when it is finished.
    """

    candidate: Candidate
    trial: int = 0


@dataclass(frozen=True)
class SearchBudget:
    """When a study is over.

    Attributes:
        trials: number of finished trials; ``None``: no limit.
        until: time in s since the epoch; ``None``: no limit.
        rollouts: number of rollouts of the trials, those that were given up early with what they ran; ``None``: no
            limit.
    """

    trials: int | None = None
    until: float | None = None
    rollouts: int | None = None


class StudyStorage(Protocol):
    """A study's storage, as one process sees it."""

    def finished(self) -> list[Evaluation]:
        """Every finished trial, in the order of their numbers."""
        ...

    def claim(self, count: int, budget: SearchBudget, propose: Propose) -> list[TrialClaim]:
        """Take candidates, none where the budget's trials are all finished or under way."""
        ...

    def finish(self, claims: Sequence[TrialClaim], evaluations: Sequence[Evaluation]) -> None:
        """Keep what candidates came to."""
        ...

    def release(self, claims: Sequence[TrialClaim]) -> None:
        """Give candidates back that will not be evaluated here."""
        ...

    def news(self) -> list[Evaluation]:
        """What other processes have finished since the last call."""
        ...

    def budget(self) -> SearchBudget:
        """The study's budget as it stands."""
        ...

    def set_budget(self, budget: SearchBudget) -> None:
        """Change the study's budget, for all processes."""
        ...

    def count(self) -> int:
        """Number of finished trials."""
        ...

    def complete(self, budget: SearchBudget) -> bool:
        """Whether as many trials are finished as there shall be."""
        ...

    def close(self) -> None:
        """Let go of files and connections."""
        ...
