"""What a study asks of the storage that keeps its trials; storages of one process, and one in memory alone."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
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


NO_LIMIT = SearchBudget()


class SingleProcessStorage(ABC):
    """A storage that holds finished trials alone, so that what is under way needs no record."""

    def __init__(self, budget: SearchBudget = NO_LIMIT) -> None:
        """A storage of a study that is over when `budget` says so."""
        self._budget = budget

    @abstractmethod
    def count(self) -> int:
        """Number of finished trials."""

    def claim(self, count: int, budget: SearchBudget, propose: Propose) -> list[TrialClaim]:
        """Take candidates, as many as the budget has trials left."""
        finished = self.count()
        left = count if budget.trials is None else min(count, budget.trials - finished)
        return [TrialClaim(candidate) for candidate in propose(left, not finished)] if left > 0 else []

    def release(self, claims: Sequence[TrialClaim]) -> None:  # noqa: B027  # empty for every one of them
        """Nothing to do: nothing was taken that anybody else could want."""

    def news(self) -> list[Evaluation]:
        """Nothing: nobody else works on this study."""
        return []

    def budget(self) -> SearchBudget:
        """The study's budget."""
        return self._budget

    def set_budget(self, budget: SearchBudget) -> None:
        """Change the study's budget."""
        self._budget = budget

    def complete(self, budget: SearchBudget) -> bool:
        """Whether as many trials are finished as there shall be."""
        return budget.trials is not None and self.count() >= budget.trials


class MemoryStorage(SingleProcessStorage):
    """The storage of a study in this process alone."""

    def __init__(self, budget: SearchBudget = NO_LIMIT) -> None:
        super().__init__(budget)
        self._trials: list[Evaluation] = []

    def finished(self) -> list[Evaluation]:
        """Every finished trial, in the order of their numbers."""
        return list(self._trials)

    def finish(self, claims: Sequence[TrialClaim], evaluations: Sequence[Evaluation]) -> None:  # noqa: ARG002
        """Keep what candidates came to."""
        first = len(self._trials)
        self._trials += [replace(evaluation, number=first + index) for index, evaluation in enumerate(evaluations)]

    def count(self) -> int:
        """Number of finished trials."""
        return len(self._trials)

    def close(self) -> None:
        """Nothing to let go of."""
