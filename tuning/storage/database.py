"""A study in a PostgreSQL database: many workers claim candidates, beat while they evaluate them, and finish them.

A candidate is claimed as a running trial under a lock of the database, so that the number of trials is exact whatever
the workers do. A worker that dies stops beating: its running trials are marked as failed and queued again.
"""

import hashlib
import os
import secrets
import socket
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import optuna
from optuna.trial import FrozenTrial, TrialState, create_trial

from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.problem import Problem
from dualwinch.tuning.scoring.evaluation import Candidate, Evaluation
from dualwinch.tuning.space import Space
from dualwinch.tuning.space_record import space_from
from dualwinch.tuning.storage.connection import connected, patient
from dualwinch.tuning.storage.definition import BUDGET, DEFINITION, OBJECTIVES, check_definition, check_resume, titles
from dualwinch.tuning.storage.record import ORIGIN, evaluation_of
from dualwinch.tuning.storage.rows import beat, create_running, finish_running
from dualwinch.tuning.storage.store import Budget, Claim, Propose

if TYPE_CHECKING:
    import sqlalchemy

FINISHED = (TrialState.COMPLETE, TrialState.PRUNED)
WORKER = "worker"
"""User attribute that says who evaluates a trial."""


class Database:
    """The storage of a study in a database, as one worker sees it."""

    def __init__(self, url: str, study: str, storage: optuna.storages.RDBStorage, space: Space) -> None:
        """A worker's view of a study that exists; see `begin` and `join`."""
        self._url, self._storage, self._space = url, storage, space
        self._study = patient(url, lambda: optuna.load_study(study_name=study, storage=storage))
        self._name = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(3)}"
        self._key = int.from_bytes(hashlib.sha256(study.encode()).digest()[:7], "big")
        self._held: set[int] = set()
        self._told: set[int] = set()
        self._ended = threading.Event()
        self._beating = threading.Thread(target=self._beat, daemon=True)
        self._beating.start()

    @classmethod
    def begin(
        cls, url: str, study: str, problem: Problem, definition: Mapping[str, Any], budget: Budget, *, resume: bool
    ) -> "Database":
        """Begin a study or go on with one; for the arguments and errors see `tuning.storage.opening.open_store`."""
        storage = connected(url, requeue)
        known = {there.study_name for there in storage.get_all_studies()}
        if study in known:
            there = optuna.load_study(study_name=study, storage=storage)
            theirs = there.user_attrs.get(DEFINITION)
            space = space_from((theirs or {}).get("space", []))
            check_definition(study, definition, theirs, (problem.space, space))
            check_resume(study, len(there.get_trials(deepcopy=False, states=FINISHED)), resume=resume)
        else:
            directions = [optuna.study.StudyDirection.MINIMIZE] * len(problem.objectives)
            there = optuna.create_study(study_name=study, storage=storage, directions=directions)
            there.set_user_attr(DEFINITION, dict(definition))
            there.set_user_attr(OBJECTIVES, titles(problem.objectives))
        there.set_user_attr(BUDGET, asdict(budget))
        return cls(url, study, storage, problem.space)

    @classmethod
    def join(cls, url: str, study: str) -> "Database":
        """Join a study that exists.

        Raises:
            ConfigurationError: there is no such study, or it is none of this program.
            DualwinchError: the database cannot be reached or used.
        """
        storage = connected(url, requeue)
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

    def claim(self, count: int, budget: Budget, propose: Propose) -> list[Claim]:
        """Take candidates: those of dead workers first, then new ones."""
        claims = patient(self._url, lambda: self._claim(count, budget, propose))
        self._held |= {claim.trial for claim in claims}  # only now: a broken claim's trials are found again as lost
        return claims

    def _claim(self, count: int, budget: Budget, propose: Propose) -> list[Claim]:
        with self._alone() as connection:
            self._bury()
            taken = [trial for trial in self._trials(TrialState.RUNNING) if self._lost(trial)]
            for trial in self._trials(TrialState.WAITING)[: max(count - len(taken), 0)]:
                self._storage.record_heartbeat(trial._trial_id)  # noqa: SLF001
                self._storage.set_trial_user_attr(trial._trial_id, WORKER, self._name)  # noqa: SLF001
                self._storage.set_trial_state_values(trial._trial_id, TrialState.RUNNING)  # noqa: SLF001
                taken.append(trial)
            claims = [Claim(_candidate(trial), trial._trial_id) for trial in taken]  # noqa: SLF001
            existing = len(self._trials(*FINISHED, TrialState.RUNNING, TrialState.WAITING))
            room = count - len(claims) if budget.trials is None else min(count - len(claims), budget.trials - existing)
            fresh = propose(room, not existing)[:room] if room > 0 else []
            notes = [{ORIGIN: candidate.origin, WORKER: self._name} for candidate in fresh]
            ids = create_running(connection, self._study._study_id, self._space, fresh, notes)  # noqa: SLF001
            claims += [Claim(candidate, trial) for candidate, trial in zip(fresh, ids, strict=True)]
        return claims

    def finish(self, claims: Sequence[Claim], evaluations: Sequence[Evaluation]) -> None:
        """Write results, all in one transaction."""
        trials = [claim.trial for claim in claims]
        patient(self._url, lambda: finish_running(self._storage.engine, trials, evaluations))
        self._held.difference_update(trials)

    def release(self, claims: Sequence[Claim]) -> None:
        """Queue candidates again that will not be evaluated here."""
        for claim in claims:
            if claim.trial in self._held:
                self._held.discard(claim.trial)
                self._fail(claim.trial)

    def budget(self) -> Budget:
        """The study's budget as it stands in the database."""
        return Budget(**patient(self._url, lambda: self._study.user_attrs[BUDGET]))

    def set_budget(self, budget: Budget) -> None:
        """Change the study's budget, for all workers."""
        patient(self._url, lambda: self._study.set_user_attr(BUDGET, asdict(budget)))

    def count(self) -> int:
        """Number of finished trials."""
        return len(self._trials(*FINISHED))

    def complete(self, budget: Budget) -> bool:
        """Whether as many trials are finished as there shall be."""
        return budget.trials is not None and self.count() >= budget.trials

    def close(self) -> None:
        """Stop beating, and let go of the connections."""
        self._ended.set()
        self._beating.join(timeout=5)
        self._storage.engine.dispose()

    def _trials(self, *states: TrialState) -> list[FrozenTrial]:
        return patient(self._url, lambda: self._study.get_trials(deepcopy=False, states=states))

    def _lost(self, trial: FrozenTrial) -> bool:
        """Whether a trial is this worker's own, made while a connection broke, so that it never knew of it."""
        return trial.user_attrs.get(WORKER) == self._name and trial._trial_id not in self._held  # noqa: SLF001

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

    def _bury(self) -> None:
        """Queue the running trials of workers again that have stopped beating."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            optuna.storages.fail_stale_trials(self._study)

    def _fail(self, trial: int) -> None:
        def queue_again() -> None:
            if self._storage.set_trial_state_values(trial, TrialState.FAIL):
                requeue(self._study, self._storage.get_trial(trial))

        patient(self._url, queue_again)

    def _beat(self) -> None:
        interval = self._storage.get_heartbeat_interval() or 1
        while not self._ended.wait(interval):
            with suppress(Exception):  # the database is restarting; the next beat may reach it
                beat(self._storage.engine, tuple(self._held))


def definition_in_database(url: str, study: str) -> dict[str, Any] | None:
    """What a study in a database was begun with; ``None`` where there is no such study."""
    storage = connected(url, requeue)
    try:
        known = {there.study_name: there.user_attrs for there in storage.get_all_studies()}
    finally:
        storage.engine.dispose()
    return known.get(study, {}).get(DEFINITION)


def requeue(study: optuna.Study, trial: FrozenTrial) -> None:
    """Queue a trial again whose worker is gone."""
    study.add_trial(
        create_trial(
            state=TrialState.WAITING,
            params=trial.params,
            distributions=trial.distributions,
            user_attrs={ORIGIN: trial.user_attrs.get(ORIGIN, ""), "retry of trial": trial.number},
        )
    )


def _candidate(trial: FrozenTrial) -> Candidate:
    return Candidate(dict(trial.params), trial.user_attrs.get(ORIGIN, ""))
