"""Storage of a study's trials: the interface for searches, and an implementation in memory."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace

from dualwinch.tuning.problem import SEARCH
from dualwinch.tuning.scoring.ranking import Evaluation


class StudyStorage(ABC):
    """A study's finished trials, as seen by one process.

    Attributes:
        continued: whether trials that are there at the beginning count in the budget of this process's search.
    """

    continued = True

    @abstractmethod
    def finished(self) -> list[Evaluation]:
        """Every finished trial, in the order of their numbers; `news` does not repeat them."""

    @abstractmethod
    def add(self, evaluations: Sequence[Evaluation]) -> None:
        """Store the finished trials of this process."""

    @abstractmethod
    def count(self) -> int:
        """Number of finished trials."""

    @property
    def stream(self) -> str:
        """Name of the random stream of this process's search (`TuningProblem.stream`)."""
        return f"{SEARCH} after {self.count()} trials"

    def news(self) -> list[Evaluation]:
        """Trials finished by other processes since the last call."""
        return []

    def close(self) -> None:  # noqa: B027  # empty in memory
        """Close files and connections."""


class MemoryStorage(StudyStorage):
    """Storage of a study in the memory of this process."""

    def __init__(self) -> None:
        self._trials: list[Evaluation] = []

    def finished(self) -> list[Evaluation]:
        """Every finished trial, in the order of their numbers."""
        return list(self._trials)

    def add(self, evaluations: Sequence[Evaluation]) -> None:
        """Store the finished trials of this process."""
        count = len(self._trials)
        self._trials += [replace(evaluation, number=count + index) for index, evaluation in enumerate(evaluations)]

    def count(self) -> int:
        """Number of finished trials."""
        return len(self._trials)
