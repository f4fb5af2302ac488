"""A study that is kept nowhere: its trials live as long as the search."""

from collections.abc import Sequence
from dataclasses import replace

from dualwinch.tuning.scoring.ranking import Evaluation
from dualwinch.tuning.storage.one_process import NO_LIMIT, SingleProcessStorage
from dualwinch.tuning.storage.store import SearchBudget, TrialClaim


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
