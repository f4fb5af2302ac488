"""A study of several processes, as seen by one of them: what journal files and databases have in common."""

import os
import secrets
import socket
from collections.abc import Callable
from dataclasses import asdict
from typing import Any, TypeVar

import optuna
from optuna.trial import FrozenTrial, TrialState

from dualwinch.tuning.scoring.ranking import Evaluation
from dualwinch.tuning.space import Space
from dualwinch.tuning.storage.record import BUDGET, DEFINITION, evaluation_of
from dualwinch.tuning.storage.store import SearchBudget, StudyStorage

FINISHED = (TrialState.COMPLETE, TrialState.PRUNED)

WORKER = "worker"
"""User attribute of a trial: name of the process that evaluates it."""

Returned = TypeVar("Returned")


class SharedStudy(StudyStorage):
    """Storage of an existing study that several processes work on."""

    def __init__(self, study: optuna.Study, space: Space) -> None:
        super().__init__()
        self._study, self._space = study, space
        self._name = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(3)}"
        self._reported = set[int]()

    def _attempt(self, action: Callable[[], Returned]) -> Returned:
        """Carry out an action on the storage."""
        return action()

    @property
    def definition(self) -> dict[str, Any]:
        """The stored definition of the problem."""
        return self._study.user_attrs[DEFINITION]

    def finished(self) -> list[Evaluation]:
        """Every finished trial; `news` does not repeat them."""
        trials = self._trials(*FINISHED)
        self._reported |= {trial.number for trial in trials}
        return [evaluation_of(trial) for trial in trials]

    def news(self) -> list[Evaluation]:
        """Trials finished by other processes since the last call."""
        trials = [trial for trial in self._trials(*FINISHED) if trial.number not in self._reported]
        self._reported |= {trial.number for trial in trials}
        return [evaluation_of(trial) for trial in trials if trial.user_attrs.get(WORKER) != self._name]

    def count(self) -> int:
        """Number of finished trials."""
        return len(self._trials(*FINISHED))

    def budget(self) -> SearchBudget:
        """The study's current budget in the storage."""
        return SearchBudget(**self._attempt(lambda: self._study.user_attrs[BUDGET]))

    def set_budget(self, budget: SearchBudget) -> None:
        """Change the study's budget, for all processes."""
        self._attempt(lambda: self._study.set_user_attr(BUDGET, asdict(budget)))

    def _trials(self, *states: TrialState) -> list[FrozenTrial]:
        return self._attempt(lambda: self._study.get_trials(deepcopy=False, states=states or None))
