"""A study in a PostgreSQL database that many workers share, by Optuna's public functions alone.

The number of trials is exact by construction: waiting trials are queued, each with a place of its own (`PLACE`) among
as many as there shall be. Workers pop them by `ask`, record heartbeats while they evaluate them, and finish them by
`tell`. Where a worker dies its running trial is failed and queued again (`fail_stale_trials`,
`RetryHeartbeatStaleTrialCallback`), with its place. Of the trials of a place that have not failed only the first
counts: a worker that pops a later one fails it, so that nothing that is done twice is counted twice.

What the public functions lack: `ask` records no heartbeat, so that a trial whose worker dies right behind it would run
forever; other workers record one for it (`_revive`). To fail a trial and to queue it again are two transactions;
between them its place is empty, and is queued again (`_open_places`). There is no way to write a batch of results at
once: 16 trials of 16 gains took about 10 s to claim and 10 s to finish on a busy machine with PostgreSQL beside it.
"""

import os
import secrets
import socket
import threading
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from datetime import datetime, timedelta
from typing import Any

import optuna
from optuna.distributions import BaseDistribution
from optuna.storages import fail_stale_trials
from optuna.trial import FrozenTrial, TrialState

from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.space import ContinuousDimension, Space, space_from
from dualwinch.tuning.storage.connection import GRACE, connected, patient
from dualwinch.tuning.storage.definition import BUDGET, DEFINITION, begun, check_resume
from dualwinch.tuning.storage.record import ORIGIN, distributions, evaluation_of, finish, first_candidates
from dualwinch.tuning.storage.store import Propose, SearchBudget, TrialClaim

FINISHED = (TrialState.COMPLETE, TrialState.PRUNED)

PLACE, WORKER = "place", "worker"
"""User attributes of a trial: which of the trials that there shall be it is, and which process evaluates it."""

QUEUED = 64
"""Trials that are queued ahead: Optuna reads all of them whenever it pops one."""

NOT_FIRST = False
"""Of `Propose`: the first candidates are queued when the study is made."""


class ProposedSampler(optuna.samplers.BaseSampler):
    """Gives a trial the point that is proposed next; a trial that is queued with a point of its own keeps that."""

    def __init__(self) -> None:
        self.point: Mapping[str, Any] = {}

    def infer_relative_search_space(self, study: Any, trial: FrozenTrial) -> dict[str, BaseDistribution]:  # noqa: ARG002
        """Nothing: every value is sampled by itself."""
        return {}

    def sample_relative(self, study: Any, trial: FrozenTrial, search_space: Any) -> dict[str, Any]:  # noqa: ARG002
        """Nothing."""
        return {}

    def sample_independent(
        self,
        study: Any,  # noqa: ARG002
        trial: FrozenTrial,  # noqa: ARG002
        param_name: str,
        param_distribution: BaseDistribution,  # noqa: ARG002
    ) -> Any:
        """The value of the point."""
        return self.point[param_name]


class DatabaseStudy:
    """The storage of a study in a database, as one worker sees it."""

    def __init__(self, url: str, study: str, storage: optuna.storages.RDBStorage, space: Space) -> None:
        """A worker's view of a study that exists; see `begin` and `join`."""
        self._url, self._storage, self._space = url, storage, space
        self._sampler = ProposedSampler()
        self._study = patient(url, lambda: optuna.load_study(study_name=study, storage=storage, sampler=self._sampler))
        self._id = storage.get_study_id_from_name(study)
        self._name = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(3)}"
        self._grace = storage.grace_period or GRACE
        self._held: dict[int, optuna.Trial] = {}
        self._reported: set[int] = set()
        self._adopted: set[int] = set()
        self._ended = threading.Event()
        self._beating = threading.Thread(target=self._beat_on, daemon=True)
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
        store = cls(url, study, storage, problem.space)
        patient(url, lambda: store._open_places(budget, first_candidates(problem)))
        return store

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
        self._reported |= {trial.number for trial in trials}
        return [evaluation_of(trial) for trial in trials]

    def news(self) -> list[Evaluation]:
        """Trials that other workers have finished since the last call."""
        trials = [trial for trial in self._trials(*FINISHED) if trial.number not in self._reported]
        self._reported |= {trial.number for trial in trials}
        return [evaluation_of(trial) for trial in trials if trial.user_attrs.get(WORKER) != self._name]

    def claim(self, count: int, budget: SearchBudget, propose: Propose) -> list[TrialClaim]:
        """Take trials: those that have points, of dead workers and the first ones, and others with proposed points."""
        patient(self._url, self._revive)
        if budget.trials is not None:
            patient(self._url, lambda: self._open_places(budget))
            states = [trial.state for trial in self._trials()]
            begun = sum(state in {*FINISHED, TrialState.RUNNING} for state in states)
            count = min(count, budget.trials - begun, states.count(TrialState.WAITING))
        popped = [patient(self._url, self._pop) for _ in range(count)]
        try:
            return self._claims(self._first_of_their_places(popped, budget), propose)
        except BaseException:
            self.release([TrialClaim(Candidate({}, ""), trial.number) for trial in popped])
            raise

    def _pop(self) -> optuna.Trial:
        """A waiting trial, or a new one, that is running now."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about heartbeats, which are recorded here
            trial = self._study.ask()
        self._held[trial.number] = trial
        self._beat(trial.number)
        return trial

    def _first_of_their_places(self, popped: Sequence[optuna.Trial], budget: SearchBudget) -> list[optuna.Trial]:
        """The trials that count; the others, of places where an earlier one has not failed, are failed."""
        if budget.trials is None or not popped:
            return list(popped)
        first: dict[int, int] = {}
        for there in self._trials(*FINISHED, TrialState.RUNNING, TrialState.WAITING):
            if (place := there.user_attrs.get(PLACE)) is not None:
                first.setdefault(place, there.number)
        kept = list[optuna.Trial]()
        for trial in popped:
            if first.get(trial.user_attrs.get(PLACE, -1)) == trial.number:
                kept.append(trial)
            else:
                self._held.pop(trial.number)
                patient(self._url, lambda trial=trial: self._study.tell(trial, state=TrialState.FAIL))
        return kept

    def _claims(self, trials: Sequence[optuna.Trial], propose: Propose) -> list[TrialClaim]:
        """Trials with their points; those for which nothing is proposed are queued again."""
        wanted = sum(ORIGIN not in trial.user_attrs for trial in trials)
        proposed, claims = propose(wanted, NOT_FIRST) if wanted else [], list[TrialClaim]()
        for trial in trials:
            candidate = None
            if ORIGIN not in trial.user_attrs:
                if not proposed:
                    self.release([TrialClaim(Candidate({}, ""), trial.number)])
                    continue
                candidate = proposed.pop(0)
            claims.append(patient(self._url, lambda trial=trial, candidate=candidate: self._claim(trial, candidate)))
        return claims

    def _claim(self, trial: optuna.Trial, candidate: Candidate | None) -> TrialClaim:
        """Give a trial its point; without a candidate it has one."""
        self._sampler.point = candidate.point if candidate else {}
        point = {
            each.name: trial.suggest_float(each.name, each.lower, each.upper, log=each.log)
            if isinstance(each, ContinuousDimension)
            else trial.suggest_categorical(each.name, each.choices)
            for each in self._space.dimensions
        }
        origin = candidate.origin if candidate else trial.user_attrs[ORIGIN]
        for name, value in ((ORIGIN, origin), (WORKER, self._name)):
            trial.set_user_attr(name, value)
        return TrialClaim(Candidate(point, origin), trial.number)

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

    def _open_places(self, budget: SearchBudget, first: Sequence[Candidate] = ()) -> None:
        """Queue a trial for each of the next places without one that has not failed, the first candidates first."""
        if budget.trials is None:
            if first and not self._trials():
                self._study.add_trials([self._waiting(candidate=candidate) for candidate in first])
            return
        every = self._trials()
        live = {trial.user_attrs.get(PLACE) for trial in every if trial.state != TrialState.FAIL}
        failed = {trial.user_attrs.get(PLACE): trial for trial in every if trial.state == TrialState.FAIL}
        begun = sum(trial.state in {*FINISHED, TrialState.RUNNING} for trial in every)
        for place in range(min(budget.trials, begun + QUEUED)):
            if place in live:
                continue
            if place in failed and ORIGIN in failed[place].user_attrs:
                self._retry(failed[place])
            else:
                self._study.add_trial(self._waiting(place, first[place] if place < len(first) else None))

    def _retry(self, failed: FrozenTrial) -> None:
        """Queue a failed trial again, with its point, its place and its origin."""
        if callback := self._storage.get_heartbeat_stale_trial_callback():
            callback(self._study, failed)

    def _waiting(self, place: int | None = None, candidate: Candidate | None = None) -> FrozenTrial:
        attrs = ({} if place is None else {PLACE: place}) | ({ORIGIN: candidate.origin} if candidate else {})
        return optuna.trial.create_trial(
            state=TrialState.WAITING,
            params=dict(candidate.point) if candidate else None,
            distributions=distributions(self._space) if candidate else None,
            user_attrs=attrs,
        )

    def finish(self, claims: Sequence[TrialClaim], evaluations: Sequence[Evaluation]) -> None:
        """Write results, trial by trial; those of trials that were taken for dead are left out."""
        for claim, evaluation in zip(claims, evaluations, strict=True):
            trial = self._held[claim.trial]
            with suppress(optuna.exceptions.UpdateFinishedTrialError):
                patient(self._url, lambda trial=trial, evaluation=evaluation: finish(self._study, trial, evaluation))
            del self._held[claim.trial]

    def release(self, claims: Sequence[TrialClaim]) -> None:
        """Queue trials again that will not be evaluated here; not those that were finished after all."""
        for claim in claims:
            if self._held.pop(claim.trial, None):
                patient(self._url, lambda number=claim.trial: self._queue_again(number))

    def _queue_again(self, number: int) -> None:
        ended = self._study.tell(number, state=TrialState.FAIL, skip_if_finished=True)
        if ended.state == TrialState.FAIL:
            self._retry(ended)

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
        """End heartbeats and connections."""
        self._ended.set()
        self._beating.join(timeout=5)
        self._storage.engine.dispose()

    def _trials(self, *states: TrialState) -> list[FrozenTrial]:
        return patient(self._url, lambda: self._study.get_trials(deepcopy=False, states=states or None))

    def _beat(self, number: int) -> None:
        self._storage.record_heartbeat(self._storage.get_trial_id_from_study_id_trial_number(self._id, number))

    def _beat_on(self) -> None:
        interval = self._storage.get_heartbeat_interval() or 1
        while not self._ended.wait(interval):
            for number in tuple(self._held):
                with suppress(Exception):  # the database is restarting; the next beat may reach it
                    self._beat(number)


def definition_in_database(url: str, study: str) -> dict[str, Any] | None:
    """What a study in a database was begun with; ``None`` where there is no such study."""
    storage = connected(url)
    try:
        known = {there.study_name: there.user_attrs for there in storage.get_all_studies()}
    finally:
        storage.engine.dispose()
    return known.get(study, {}).get(DEFINITION)
