"""Who evaluates which trial, as rows of Optuna's tables: trials taken, lost by workers that died, and queued again.

Everything here is done in a transaction of the caller's that holds the study's lock, so that nobody sees a trial given
back and not yet queued again, and takes its room.
"""

import json
from collections import Counter
from collections.abc import Collection, Sequence

import sqlalchemy as sa
from optuna.trial import TrialState

from dualwinch.tuning.storage.record import ORIGIN
from dualwinch.tuning.storage.rows import now
from dualwinch.tuning.storage.tables import HEARTBEATS, PARAMETERS, TRIALS, USER_ATTRIBUTES, server_time

WORKER, RETRY = "worker", "retry of trial"
"""User attributes: who evaluates a trial, and the number of the one that it is queued again for."""


def counts(connection: sa.Connection, study: int) -> Counter[TrialState]:
    """Number of trials in each state."""
    counting = sa.select(TRIALS.c.state, sa.func.count()).where(TRIALS.c.study_id == study).group_by(TRIALS.c.state)
    return Counter({row[0]: row[1] for row in connection.execute(counting)})


def stale(connection: sa.Connection, study: int, grace: float) -> list[int]:
    """Running trials whose workers have not beaten for some time in s."""
    silent = HEARTBEATS.c.heartbeat < server_time() - sa.func.make_interval(0, 0, 0, 0, 0, 0, grace)
    joined = TRIALS.join(HEARTBEATS, HEARTBEATS.c.trial_id == TRIALS.c.trial_id)
    return _ids(connection, sa.select(TRIALS.c.trial_id).select_from(joined).where(silent), study, TrialState.RUNNING)


def taken_by(connection: sa.Connection, study: int, worker: str) -> list[int]:
    """Running trials of a worker, by what they say themselves."""
    joined = TRIALS.join(USER_ATTRIBUTES, USER_ATTRIBUTES.c.trial_id == TRIALS.c.trial_id)
    theirs = sa.and_(USER_ATTRIBUTES.c.key == WORKER, USER_ATTRIBUTES.c.value_json == json.dumps(worker))
    return _ids(connection, sa.select(TRIALS.c.trial_id).select_from(joined).where(theirs), study, TrialState.RUNNING)


def take_waiting(connection: sa.Connection, study: int, worker: str, count: int) -> list[int]:
    """Take some of the trials that wait, the oldest first."""
    ids = _ids(connection, sa.select(TRIALS.c.trial_id), study, TrialState.WAITING)[:count]
    if ids:
        _forget(connection, ids)
        notes = [{"trial_id": trial, "key": WORKER, "value_json": json.dumps(worker)} for trial in ids]
        connection.execute(sa.insert(USER_ATTRIBUTES), notes)
        connection.execute(
            sa.insert(HEARTBEATS).values(heartbeat=server_time()), [{"trial_id": trial} for trial in ids]
        )
        running = {"state": TrialState.RUNNING, "datetime_start": now()}
        connection.execute(sa.update(TRIALS).where(TRIALS.c.trial_id.in_(ids)).values(running))
    return ids


def requeue(connection: sa.Connection, study: int, trials: Collection[int]) -> None:
    """Have those of some trials that are still running count as failed, and queue what they were to evaluate again."""
    running = sa.select(TRIALS.c.trial_id, TRIALS.c.number).where(
        TRIALS.c.trial_id.in_(trials), TRIALS.c.state == TrialState.RUNNING
    )
    for trial, number in connection.execute(running.order_by(TRIALS.c.trial_id).with_for_update()).all():
        ending = sa.update(TRIALS).where(TRIALS.c.trial_id == trial)
        connection.execute(ending.values(state=TrialState.FAIL, datetime_complete=now()))
        fresh = {"number": counts(connection, study).total(), "study_id": study, "state": TrialState.WAITING}
        copy = connection.execute(sa.insert(TRIALS).values(fresh).returning(TRIALS.c.trial_id)).scalar_one()
        _copy(connection, PARAMETERS, trial, copy)
        _copy(connection, USER_ATTRIBUTES, trial, copy, USER_ATTRIBUTES.c.key == ORIGIN)
        note = {"trial_id": copy, "key": RETRY, "value_json": json.dumps(number)}
        connection.execute(sa.insert(USER_ATTRIBUTES), [note])


def _ids(connection: sa.Connection, selecting: sa.Select, study: int, state: TrialState) -> list[int]:
    those = selecting.where(TRIALS.c.study_id == study, TRIALS.c.state == state).order_by(TRIALS.c.trial_id)
    return list(connection.execute(those).scalars())


def _forget(connection: sa.Connection, trials: Sequence[int]) -> None:
    """Remove who had some trials before, and their beats."""
    mine = sa.and_(USER_ATTRIBUTES.c.trial_id.in_(trials), USER_ATTRIBUTES.c.key == WORKER)
    connection.execute(sa.delete(USER_ATTRIBUTES).where(mine))
    connection.execute(sa.delete(HEARTBEATS).where(HEARTBEATS.c.trial_id.in_(trials)))


def _copy(connection: sa.Connection, table: sa.Table, trial: int, copy: int, *further: sa.ColumnElement[bool]) -> None:
    names = [column.name for column in table.columns if column.name != "trial_id"]
    columns = [sa.literal(copy), *(table.c[name] for name in names)]
    rows = sa.select(*columns).where(table.c.trial_id == trial, *further)
    connection.execute(sa.insert(table).from_select(["trial_id", *names], rows))
