"""A study that is kept nowhere: its trials live as long as the search."""

from collections.abc import Sequence
from dataclasses import replace

from tuning.evaluation import Evaluation
from tuning.storage import Budget, Claim, Propose


class Memory:
    """The storage of a study in this process alone."""

    def __init__(self, budget: Budget) -> None:
        self._budget = budget
        self._trials: list[Evaluation] = []

    def finished(self) -> list[Evaluation]:
        """Every finished trial, in the order of their numbers."""
        return list(self._trials)

    def claim(self, count: int, budget: Budget, propose: Propose) -> list[Claim]:
        """Take candidates, as many as the budget has trials left."""
        left = count if budget.trials is None else min(count, budget.trials - len(self._trials))
        return [Claim(one) for one in propose(left, not self._trials)] if left > 0 else []

    def finish(self, claims: Sequence[Claim], evaluations: Sequence[Evaluation]) -> None:  # noqa: ARG002
        """Keep what candidates came to."""
        first = len(self._trials)
        self._trials += [replace(one, number=first + place) for place, one in enumerate(evaluations)]

    def release(self, claims: Sequence[Claim]) -> None:
        """Nothing was taken that anybody else could want."""

    def news(self) -> list[Evaluation]:
        """Nobody else works on this study."""
        return []

    def budget(self) -> Budget:
        """The study's budget."""
        return self._budget

    def set_budget(self, budget: Budget) -> None:
        """Change the study's budget."""
        self._budget = budget

    def count(self) -> int:
        """Number of finished trials."""
        return len(self._trials)

    def complete(self, budget: Budget) -> bool:
        """Whether as many trials are finished as there shall be."""
        return budget.trials is not None and len(self._trials) >= budget.trials

    def close(self) -> None:
        """Nothing to let go of."""
