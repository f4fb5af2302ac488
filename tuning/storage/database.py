"""A study in a PostgreSQL database shared by many workers, with Optuna's public functions only.

The number of trials is exact: each trial of the budget has a place (`PLACE`). A worker adds a running trial, with its
point, at a free place, records heartbeats while it evaluates the trial, and finishes it by `tell`. The first candidates
and the trials of dead workers (`fail_stale_trials`, `RetryHeartbeatStaleTrialCallback`) are queued with their points
and places, and popped by `ask` before new trials are added. Of the trials at a place that have not failed, only the
first counts: a worker whose own trial is a later one fails it before evaluation, so that nothing is counted twice.
Trials are numbered in the order of their commits, so every worker sees the same first one.

Why places, instead of enqueueing the budget's number of waiting trials with the study: no public function sets the
point of a waiting trial. Either it is enqueued with its point, which is not known then, or a sampler provides the point
after `ask`, gain by gain in a transaction each: nearly twice the transactions per batch (`benchmarks.storages`). And a
budget in time or rollouts has no such number.

Limits of the public functions: neither `ask` nor `add_trial` records a heartbeat, so a trial whose worker dies right
after it would run forever; other workers record one for it (`_revive`). Failing a trial and queueing it again are two
transactions; between them its place is empty, and the next worker queues it again (`_requeue`). A batch cannot be added
or finished at once, and each attribute of a trial is a transaction; so a trial is added with everything known in one
transaction, and its entire result is one attribute (`EVALUATION`).
"""

import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from datetime import datetime, timedelta
from types import MappingProxyType
from typing import Any

import optuna
from optuna.storages import RetryHeartbeatStaleTrialCallback, fail_stale_trials
from optuna.trial import FrozenTrial, TrialState

from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.space import Space, space_from
from dualwinch.tuning.storage.connection import GRACE, connected, patient
from dualwinch.tuning.storage.record import (
    ORIGIN,
    begun,
    definitions,
    distributions,
    finish,
    first_candidates,
    joined_definition,
)
from dualwinch.tuning.storage.shared import FINISHED, WORKER, Returned, SharedStudy
from dualwinch.tuning.storage.store import Propose, SearchBudget, TrialClaim

NOT_FIRST = False
"""Argument of `Propose`: the first candidates are queued when the study is created."""

NOTHING: Mapping[str, Any] = MappingProxyType({})

PLACE = "place"
"""User attribute of a trial: its place among the budget's trials."""


class DatabaseStudy(SharedStudy):
    """Storage of a study in a database, as seen by one worker."""

    def __init__(self, url: str, study: str, storage: optuna.storages.RDBStorage, space: Space) -> None:
        """Open an existing study; see `begin` and `join`."""
        self._url, self._storage = url, storage
        sampler = optuna.samplers.RandomSampler()  # every trial has its point; none is sampled
        there = self._attempt(lambda: optuna.load_study(study_name=study, storage=storage, sampler=sampler))
        super().__init__(there, space)
        self._id = storage.get_study_id_from_name(study)
        self._grace = storage.grace_period or GRACE
        self._held, self._popped, self._adopted = set[int](), set[int](), set[int]()
        self._ended = threading.Event()
        self._beating = threading.Thread(target=self._beat_on, daemon=True)
        self._beating.start()

    def _attempt(self, action: Callable[[], Returned]) -> Returned:
        """Carry out an action on the database, with retries while it is unavailable."""
        return patient(self._url, action)

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
        """Begin or continue a study; arguments and errors as in `tuning.storage.opening.open_store`."""
        storage = connected(url)
        try:
            begun(study, storage, problem, definition, budget, resume=resume)
        except BaseException:
            storage.engine.dispose()
            raise
        store = cls(url, study, storage, problem.space)
        store.set_budget(budget)
        store._attempt(lambda: store._queue(first_candidates(problem), budget))
        return store

    @classmethod
    def join(cls, url: str, study: str) -> "DatabaseStudy":
        """Join an existing study.

        Raises:
            ConfigurationError: there is no such study, or it is not one of this program.
            DualwinchError: the database cannot be reached or used.
        """
        storage = connected(url)
        try:
            definition = joined_definition(study, storage)
        except BaseException:
            storage.engine.dispose()
            raise
        return cls(url, study, storage, space_from(definition["space"]))

    def claim(self, count: int, budget: SearchBudget, propose: Propose) -> list[TrialClaim]:
        """Claim trials: first the queued ones (first candidates and those of dead workers), then proposed ones."""
        self._attempt(self._revive)
        if budget.trials is not None:
            self._attempt(self._requeue)
        states = [trial.state for trial in self._trials()]
        if budget.trials is not None:
            begun = sum(state in {*FINISHED, TrialState.RUNNING} for state in states)
            count = min(count, budget.trials - begun)
        try:
            for _ in range(min(count, states.count(TrialState.WAITING))):
                self._attempt(self._pop)
            free = count - len(self._own())
            for candidate in propose(free, NOT_FIRST) if free > 0 else ():
                self._attempt(lambda candidate=candidate: self._add(candidate, budget))
            return self._first_of_their_places()
        except BaseException:
            self.release([TrialClaim(Candidate({}, ""), trial.number) for trial in self._own()])
            raise

    def _own(self) -> list[FrozenTrial]:
        """This worker's running trials that are not claimed yet."""
        return [
            trial
            for trial in self._trials(TrialState.RUNNING)
            if trial.number in self._popped
            or (
                trial.number not in self._held
                and trial.user_attrs.get(WORKER) == self._name
                and not _queued_again(trial)  # else another worker is popping it
            )
        ]

    def _pop(self) -> None:
        """Pop a queued trial; if other workers were faster, it is a new one without a place."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about heartbeats; this class records them
            trial = self._study.ask()
        self._popped.add(trial.number)
        trial.set_user_attr(WORKER, self._name)

    def _add(self, candidate: Candidate, budget: SearchBudget) -> None:
        """Add a running trial at the first free place, if there is one."""
        place = None
        if budget.trials is not None:
            taken = {trial.user_attrs.get(PLACE) for trial in self._trials() if trial.state != TrialState.FAIL}
            place = next((each for each in range(budget.trials) if each not in taken), None)
            if place is None:
                return
        self._study.add_trial(self._trial(TrialState.RUNNING, candidate, place, {WORKER: self._name}))

    def _first_of_their_places(self) -> list[TrialClaim]:
        """Claim own trials that are the first of their places without failure; fail the others."""
        first: dict[int, int] = {}
        for there in self._trials(*FINISHED, TrialState.RUNNING, TrialState.WAITING):
            if (place := there.user_attrs.get(PLACE)) is not None:
                first.setdefault(place, there.number)
        claims = list[TrialClaim]()
        for trial in self._own():
            place = trial.user_attrs.get(PLACE)
            if ORIGIN in trial.user_attrs and (place is None or first[place] == trial.number):
                self._held.add(trial.number)
                claims.append(TrialClaim(Candidate(dict(trial.params), trial.user_attrs[ORIGIN]), trial.number))
            else:
                self._attempt(
                    lambda number=trial.number: self._study.tell(number, state=TrialState.FAIL, skip_if_finished=True)
                )
        self._popped.clear()
        return claims

    def _revive(self) -> None:
        """Fail the running trials of dead workers, and queue them again."""
        late = datetime.now() - timedelta(seconds=self._grace)  # noqa: DTZ005  # as Optuna has it
        for trial in self._trials(TrialState.RUNNING):
            known = trial.number in self._held or trial.number in self._adopted
            if not known and trial.datetime_start and trial.datetime_start < late:
                self._adopted.add(trial.number)
                self._beat(trial.number)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            fail_stale_trials(self._study)

    def _queue(self, first: Sequence[Candidate], budget: SearchBudget) -> None:
        """Queue the missing first candidates, at most the budget's number of trials."""
        every = self._trials()
        if budget.trials is None:
            if not every:
                self._study.add_trials([self._trial(TrialState.WAITING, candidate) for candidate in first])
            return
        taken = {trial.user_attrs.get(PLACE) for trial in every}
        for place, candidate in enumerate(first[: budget.trials]):
            if place not in taken:
                self._study.add_trial(self._trial(TrialState.WAITING, candidate, place))

    def _requeue(self) -> None:
        """Queue again the first trial of each place where all trials have failed."""
        failed: dict[int, FrozenTrial] = {}
        live = set[int | None]()
        for trial in self._trials():
            place = trial.user_attrs.get(PLACE)
            if trial.state != TrialState.FAIL:
                live.add(place)
            elif place is not None:
                failed.setdefault(place, trial)
        for place, trial in failed.items():
            if place not in live:
                self._retry(trial)

    def _retry(self, failed: FrozenTrial) -> None:
        """Queue a failed trial again, with its point, place and origin."""
        if callback := self._storage.get_heartbeat_stale_trial_callback():
            callback(self._study, failed)

    def _trial(
        self, state: TrialState, candidate: Candidate, place: int | None = None, further: Mapping[str, Any] = NOTHING
    ) -> FrozenTrial:
        return optuna.trial.create_trial(
            state=state,
            params=dict(candidate.point),
            distributions=distributions(self._space),
            user_attrs={ORIGIN: candidate.origin, **({} if place is None else {PLACE: place}), **further},
        )

    def finish(self, claims: Sequence[TrialClaim], evaluations: Sequence[Evaluation]) -> None:
        """Write results, trial by trial; trials that other workers have failed as dead are skipped."""
        for claim, evaluation in zip(claims, evaluations, strict=True):
            with suppress(optuna.exceptions.UpdateFinishedTrialError):
                self._attempt(lambda claim=claim, evaluation=evaluation: self._finish(claim.trial, evaluation))
            self._held.discard(claim.trial)

    def _finish(self, number: int, evaluation: Evaluation) -> None:
        finish(self._study, optuna.Trial(self._study, self._id_of(number)), evaluation)

    def release(self, claims: Sequence[TrialClaim]) -> None:
        """Queue unfinished trials again that will not be evaluated here."""
        for claim in claims:
            self._held.discard(claim.trial)
            self._attempt(lambda number=claim.trial: self._queue_again(number))

    def _queue_again(self, number: int) -> None:
        ended = self._trials()[number]
        if ended.state.is_finished():
            return
        self._study.tell(number, state=TrialState.FAIL)
        if ORIGIN in ended.user_attrs:
            self._retry(ended)

    def close(self) -> None:
        """End heartbeats and connections."""
        self._ended.set()
        self._beating.join(timeout=5)
        self._storage.engine.dispose()

    def _beat(self, number: int) -> None:
        self._storage.record_heartbeat(self._id_of(number))

    def _id_of(self, number: int) -> int:
        return self._storage.get_trial_id_from_study_id_trial_number(self._id, number)

    def _beat_on(self) -> None:
        interval = self._storage.get_heartbeat_interval() or 1
        while not self._ended.wait(interval):
            for number in tuple(self._held):
                with suppress(Exception):  # the database may be restarting; the next heartbeat may reach it
                    self._beat(number)


def _queued_again(trial: FrozenTrial) -> bool:
    """Whether a trial is a retry of another."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        return RetryHeartbeatStaleTrialCallback.retried_trial_number(trial) is not None


def definition_in_database(url: str, study: str) -> dict[str, Any] | None:
    """The stored definition of a study in a database; ``None`` if there is no such study."""
    storage = connected(url)
    try:
        return definitions(storage).get(study)
    finally:
        storage.engine.dispose()
