"""Studies of one process, where no other takes candidates or finishes trials; one that is kept in memory alone."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace

from dualwinch.tuning.scoring.ranking import Evaluation
from dualwinch.tuning.storage.store import Propose, SearchBudget, TrialClaim

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
