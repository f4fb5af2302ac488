"""Storage of a study: the interface for searches, and an implementation in memory."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from dualwinch.tuning.scoring.ranking import Candidate, Evaluation

Propose = Callable[[int, bool], list[Candidate]]
"""``propose(count, first)``: candidates; `first`: the study has no trial yet."""


@dataclass(frozen=True)
class TrialClaim:
    """A candidate claimed by this process for evaluation.

    Attributes:
        candidate: to evaluate.
        trial: its id in the storage; 0 if only finished trials are stored.
    """

    candidate: Candidate
    trial: int = 0


@dataclass(frozen=True)
class SearchBudget:
    """Limits of a search; it ends at the first.

    Attributes:
        trials: number of finished trials; ``None``: no limit.
        until: time in s since the epoch; ``None``: no limit.
        rollouts: number of rollouts of the trials; pruned ones count those they ran; ``None``: no limit.
    """

    trials: int | None = None
    until: float | None = None
    rollouts: int | None = None


NO_LIMIT = SearchBudget()


class StudyStorage(ABC):
    """A study's storage, as seen by one process.

    The implemented methods are for a study of a single process: only finished trials are stored, not those under way.
    """

    def __init__(self, budget: SearchBudget = NO_LIMIT) -> None:
        self._budget = budget

    @abstractmethod
    def finished(self) -> list[Evaluation]:
        """Every finished trial, in the order of their numbers."""

    @abstractmethod
    def finish(self, claims: Sequence[TrialClaim], evaluations: Sequence[Evaluation]) -> None:
        """Store the evaluations of claimed candidates."""

    @abstractmethod
    def count(self) -> int:
        """Number of finished trials."""

    def claim(self, count: int, budget: SearchBudget, propose: Propose) -> list[TrialClaim]:
        """Claim up to `count` candidates; none if the budget's trials are all finished or under way."""
        finished = self.count()
        left = count if budget.trials is None else min(count, budget.trials - finished)
        return [TrialClaim(candidate) for candidate in propose(left, not finished)] if left > 0 else []

    def release(self, claims: Sequence[TrialClaim]) -> None:  # noqa: B027  # empty where nothing is recorded
        """Release claimed candidates that will not be evaluated here."""

    def news(self) -> list[Evaluation]:
        """Trials finished by other processes since the last call."""
        return []

    def budget(self) -> SearchBudget:
        """The study's current budget."""
        return self._budget

    def set_budget(self, budget: SearchBudget) -> None:
        """Change the study's budget, for all processes."""
        self._budget = budget

    def complete(self, budget: SearchBudget) -> bool:
        """Whether the budget's number of trials is finished."""
        return budget.trials is not None and self.count() >= budget.trials

    def close(self) -> None:  # noqa: B027  # empty in memory
        """Close files and connections."""


class MemoryStorage(StudyStorage):
    """Storage of a study in the memory of this process."""

    def __init__(self, budget: SearchBudget = NO_LIMIT) -> None:
        super().__init__(budget)
        self._trials: list[Evaluation] = []

    def finished(self) -> list[Evaluation]:
        """Every finished trial, in the order of their numbers."""
        return list(self._trials)

    def finish(self, claims: Sequence[TrialClaim], evaluations: Sequence[Evaluation]) -> None:  # noqa: ARG002
        """Store the evaluations of claimed candidates."""
        first = len(self._trials)
        self._trials += [replace(evaluation, number=first + index) for index, evaluation in enumerate(evaluations)]

    def count(self) -> int:
        """Number of finished trials."""
        return len(self._trials)
