"""A study in a PostgreSQL database: many workers claim candidates, beat while they evaluate them, and finish them.

A candidate is claimed as a running trial under a lock of the database, so that the number of trials is exact whatever
the workers do. A worker that dies stops beating: its running trials are marked as failed and queued again.
"""

import hashlib
import os
import secrets
import socket
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import optuna
from optuna.trial import FrozenTrial, TrialState

from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.space import Space, space_from
from dualwinch.tuning.storage.claims import WORKER, counts, requeue, stale, take_waiting, taken_by
from dualwinch.tuning.storage.connection import GRACE, connected, patient
from dualwinch.tuning.storage.definition import BUDGET, DEFINITION, begun, check_resume
from dualwinch.tuning.storage.record import ORIGIN, evaluation_of
from dualwinch.tuning.storage.rows import beat, create_running, finish_running
from dualwinch.tuning.storage.store import Propose, SearchBudget, TrialClaim

if TYPE_CHECKING:
    import sqlalchemy

FINISHED = (TrialState.COMPLETE, TrialState.PRUNED)


class DatabaseStudy:
    """The storage of a study in a database, as one worker sees it."""

    def __init__(self, url: str, study: str, storage: optuna.storages.RDBStorage, space: Space) -> None:
        """A worker's view of a study that exists; see `begin` and `join`."""
        self._url, self._storage, self._space = url, storage, space
        self._study = patient(url, lambda: optuna.load_study(study_name=study, storage=storage))
        self._name = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(3)}"
        self._key = int.from_bytes(hashlib.sha256(study.encode()).digest()[:7], "big")
        self._grace = storage.grace_period or GRACE
        self._held: set[int] = set()
        self._told: set[int] = set()
        self._ended = threading.Event()
        self._beating = threading.Thread(target=self._beat, daemon=True)
        self._beating.start()

    @classmethod
    def begin(
        cls,
        url: str,
        study: str,
        problem: TuningProblem,
        definition: Mapping[str, Any],
        budget: SearchBudget,
        *,
        resume: bool,
    ) -> "DatabaseStudy":
        """Begin a study or go on with one; for the arguments and errors see `tuning.storage.opening.open_store`."""
        storage = connected(url)
        try:
            there = begun(study, storage, problem, definition, budget)
            check_resume(study, len(there.get_trials(deepcopy=False, states=FINISHED)), resume=resume)
        except BaseException:
            storage.engine.dispose()
            raise
        there.set_user_attr(BUDGET, asdict(budget))
        return cls(url, study, storage, problem.space)

    @classmethod
    def join(cls, url: str, study: str) -> "DatabaseStudy":
        """Join a study that exists.

        Raises:
            ConfigurationError: there is no such study, or it is none of this program.
            DualwinchError: the database cannot be reached or used.
        """
        storage = connected(url)
        known = sorted(there.study_name for there in storage.get_all_studies())
        if study not in known:
            storage.engine.dispose()
            raise ConfigurationError(f"--study {study}: is not there; there are: {', '.join(known) or 'none'}")
        definition = optuna.load_study(study_name=study, storage=storage).user_attrs.get(DEFINITION)
        if definition is None:
            storage.engine.dispose()
            raise ConfigurationError(f"--study {study}: is none of this program")
        return cls(url, study, storage, space_from(definition["space"]))

    @property
    def definition(self) -> dict[str, Any]:
        """What is tuned."""
        return self._study.user_attrs[DEFINITION]

    def finished(self) -> list[Evaluation]:
        """Every finished trial; `news` does not repeat them."""
        trials = self._trials(*FINISHED)
        self._told |= {trial.number for trial in trials}
        return [evaluation_of(trial) for trial in trials]

    def news(self) -> list[Evaluation]:
        """What other workers have finished since the last call."""
        trials = [trial for trial in self._trials(*FINISHED) if trial.number not in self._told]
        self._told |= {trial.number for trial in trials}
        return [evaluation_of(trial) for trial in trials if trial.user_attrs.get(WORKER) != self._name]

    def claim(self, count: int, budget: SearchBudget, propose: Propose) -> list[TrialClaim]:
        """Take candidates: those of dead workers first, then new ones."""
        claims = patient(self._url, lambda: self._claim(count, budget, propose))
        self._held |= {claim.trial for claim in claims}  # only now: a broken claim's trials are found again as lost
        return claims

    def _claim(self, count: int, budget: SearchBudget, propose: Propose) -> list[TrialClaim]:
        study = self._study._study_id  # noqa: SLF001
        with self._alone() as connection:
            requeue(connection, study, stale(connection, study, self._grace))
            lost = [trial for trial in taken_by(connection, study, self._name) if trial not in self._held]
            there = counts(connection, study)
            begun = sum(there[state] for state in (*FINISHED, TrialState.RUNNING))
            left = count if budget.trials is None else budget.trials - begun
            waiting = take_waiting(connection, study, self._name, max(min(count - len(lost), left), 0))
            room = min(count - len(lost) - len(waiting), left - there[TrialState.WAITING])
            first = begun + there[TrialState.WAITING] == 0
            fresh = propose(room, first)[:room] if room > 0 else []
            notes = [{ORIGIN: candidate.origin, WORKER: self._name} for candidate in fresh]
            ids = create_running(connection, study, self._space, fresh, notes)
        claims = [TrialClaim(_candidate(self._storage.get_trial(trial)), trial) for trial in (*lost, *waiting)]
        return claims + [TrialClaim(candidate, trial) for candidate, trial in zip(fresh, ids, strict=True)]

    def finish(self, claims: Sequence[TrialClaim], evaluations: Sequence[Evaluation]) -> None:
        """Write results, all in one transaction."""
        trials = [claim.trial for claim in claims]
        patient(self._url, lambda: finish_running(self._storage.engine, trials, evaluations))
        self._held.difference_update(trials)

    def release(self, claims: Sequence[TrialClaim]) -> None:
        """Queue candidates again that will not be evaluated here; not those that were finished after all."""
        trials = {claim.trial for claim in claims}
        patient(self._url, lambda: self._requeue(trials))
        self._held -= trials

    def _requeue(self, trials: set[int]) -> None:
        with self._alone() as connection:
            requeue(connection, self._study._study_id, trials)  # noqa: SLF001

    def budget(self) -> SearchBudget:
        """The study's budget as it stands in the database."""
        return SearchBudget(**patient(self._url, lambda: self._study.user_attrs[BUDGET]))

    def set_budget(self, budget: SearchBudget) -> None:
        """Change the study's budget, for all workers."""
        patient(self._url, lambda: self._study.set_user_attr(BUDGET, asdict(budget)))

    def count(self) -> int:
        """Number of finished trials."""
        return len(self._trials(*FINISHED))

    def complete(self, budget: SearchBudget) -> bool:
        """Whether as many trials are finished as there shall be."""
        return budget.trials is not None and self.count() >= budget.trials

    def close(self) -> None:
        """Stop beating, and let go of the connections."""
        self._ended.set()
        self._beating.join(timeout=5)
        self._storage.engine.dispose()

    def _trials(self, *states: TrialState) -> list[FrozenTrial]:
        return patient(self._url, lambda: self._study.get_trials(deepcopy=False, states=states))

    @contextmanager
    def _alone(self) -> Iterator["sqlalchemy.Connection"]:
        """While no other worker of this study is in here: a transaction that holds the lock.

        What must not happen twice is written in this transaction. Where the database restarts meanwhile, the lock is
        lost, and so is the transaction.
        """
        import sqlalchemy

        with self._storage.engine.connect() as connection, connection.begin():
            connection.execute(sqlalchemy.text("SELECT pg_advisory_xact_lock(:key)"), {"key": self._key})
            yield connection

    def _beat(self) -> None:
        interval = self._storage.get_heartbeat_interval() or 1
        while not self._ended.wait(interval):
            with suppress(Exception):  # the database is restarting; the next beat may reach it
                beat(self._storage.engine, tuple(self._held))


def definition_in_database(url: str, study: str) -> dict[str, Any] | None:
    """What a study in a database was begun with; ``None`` where there is no such study."""
    storage = connected(url)
    try:
        known = {there.study_name: there.user_attrs for there in storage.get_all_studies()}
    finally:
        storage.engine.dispose()
    return known.get(study, {}).get(DEFINITION)


def _candidate(trial: FrozenTrial) -> Candidate:
    return Candidate(dict(trial.params), trial.user_attrs.get(ORIGIN, ""))
