"""The storage of a study: what a search asks of it, and one in memory."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

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
        rollouts: number of rollouts of the trials, of trials that were given up early what they ran; ``None``: no
            limit.
    """

    trials: int | None = None
    until: float | None = None
    rollouts: int | None = None


NO_LIMIT = SearchBudget()


class StudyStorage(ABC):
    """A study's storage, as one process sees it.

    What is no abstract method is that of a study on which no other process works: finished trials alone are kept, and
    what is under way needs no record.
    """

    def __init__(self, budget: SearchBudget = NO_LIMIT) -> None:
        """The storage of a study that is over when `budget` says so."""
        self._budget = budget

    @abstractmethod
    def finished(self) -> list[Evaluation]:
        """Every finished trial, in the order of their numbers."""

    @abstractmethod
    def finish(self, claims: Sequence[TrialClaim], evaluations: Sequence[Evaluation]) -> None:
        """Keep the evaluations of candidates."""

    @abstractmethod
    def count(self) -> int:
        """Number of finished trials."""

    def claim(self, count: int, budget: SearchBudget, propose: Propose) -> list[TrialClaim]:
        """Take candidates, none where the budget's trials are all finished or under way."""
        finished = self.count()
        left = count if budget.trials is None else min(count, budget.trials - finished)
        return [TrialClaim(candidate) for candidate in propose(left, not finished)] if left > 0 else []

    def release(self, claims: Sequence[TrialClaim]) -> None:  # noqa: B027  # empty where nothing is recorded
        """Give candidates back that will not be evaluated here."""

    def news(self) -> list[Evaluation]:
        """Trials that other processes have finished since the last call."""
        return []

    def budget(self) -> SearchBudget:
        """The study's budget as it stands."""
        return self._budget

    def set_budget(self, budget: SearchBudget) -> None:
        """Change the study's budget, for all processes."""
        self._budget = budget

    def complete(self, budget: SearchBudget) -> bool:
        """Whether as many trials are finished as there shall be."""
        return budget.trials is not None and self.count() >= budget.trials

    def close(self) -> None:  # noqa: B027  # empty in memory
        """Close files and connections."""


class MemoryStorage(StudyStorage):
    """The storage of a study in this process alone."""

    def __init__(self, budget: SearchBudget = NO_LIMIT) -> None:
        super().__init__(budget)
        self._trials: list[Evaluation] = []

    def finished(self) -> list[Evaluation]:
        """Every finished trial, in the order of their numbers."""
        return list(self._trials)

    def finish(self, claims: Sequence[TrialClaim], evaluations: Sequence[Evaluation]) -> None:  # noqa: ARG002
        """Keep the evaluations of candidates."""
        first = len(self._trials)
        self._trials += [replace(evaluation, number=first + index) for index, evaluation in enumerate(evaluations)]

    def count(self) -> int:
        """Number of finished trials."""
        return len(self._trials)
