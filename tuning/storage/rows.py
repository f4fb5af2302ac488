"""Batches of trials as rows of Optuna's tables: what Optuna writes value by value, in one transaction.

The tables are those of the version of Optuna that is installed; connecting has found out that the database has them
(`tuning.storage.connection`). A batch is written whole or not at all.
"""

import json
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from typing import Any

import sqlalchemy as sa
from optuna.distributions import distribution_to_json
from optuna.storages._rdb import models
from optuna.trial import TrialState

from dualwinch.tuning.scoring.evaluation import Candidate, Evaluation
from dualwinch.tuning.space import Space
from dualwinch.tuning.storage.record import attributes, distributions

TRIALS = models.BaseModel.metadata.tables["trials"]
PARAMETERS = models.BaseModel.metadata.tables["trial_params"]
VALUES = models.BaseModel.metadata.tables["trial_values"]
INTERMEDIATE = models.BaseModel.metadata.tables["trial_intermediate_values"]
USER_ATTRIBUTES = models.BaseModel.metadata.tables["trial_user_attributes"]
SYSTEM_ATTRIBUTES = models.BaseModel.metadata.tables["trial_system_attributes"]
HEARTBEATS = models.BaseModel.metadata.tables["trial_heartbeats"]


def create_running(
    connection: sa.Connection,
    study: int,
    space: Space,
    candidates: Sequence[Candidate],
    notes: Sequence[dict[str, Any]],
) -> list[int]:
    """Add running trials that have just beaten, in a transaction during which nobody else adds any.

    Args:
        connection: with that transaction, which the caller ends.
        study: id of the study.
        space: of the candidates.
        candidates: one a trial.
        notes: user attributes of each trial.

    Returns:
        The trials' ids.
    """
    if not candidates:
        return []
    known = distributions(space)
    first = connection.execute(sa.select(sa.func.count()).where(TRIALS.c.study_id == study)).scalar_one()
    fresh = [
        {"number": first + place, "study_id": study, "state": TrialState.RUNNING, "datetime_start": _now()}
        for place in range(len(candidates))
    ]
    adding = sa.insert(TRIALS).returning(TRIALS.c.trial_id, sort_by_parameter_order=True)
    ids = list(connection.execute(adding, fresh).scalars())
    parameters = [
        {
            "trial_id": trial,
            "param_name": name,
            "param_value": known[name].to_internal_repr(value),
            "distribution_json": distribution_to_json(known[name]),
        }
        for trial, one in zip(ids, candidates, strict=True)
        for name, value in one.point.items()
    ]
    connection.execute(sa.insert(PARAMETERS), parameters)
    connection.execute(sa.insert(USER_ATTRIBUTES), _attributes(zip(ids, notes, strict=True)))
    connection.execute(sa.insert(HEARTBEATS), [{"trial_id": trial} for trial in ids])
    return ids


def finish_running(engine: sa.Engine, trials: Sequence[int], evaluations: Sequence[Evaluation]) -> None:
    """Finish those of some trials that are still running; the others were taken for dead, and are done elsewhere."""
    with engine.begin() as connection:
        running = sa.select(TRIALS.c.trial_id).where(
            TRIALS.c.trial_id.in_(trials), TRIALS.c.state == TrialState.RUNNING
        )
        open_ones = set(connection.execute(running.with_for_update()).scalars())
        done = [pair for pair in zip(trials, evaluations, strict=True) if pair[0] in open_ones]
        if not done:
            return
        connection.execute(
            sa.delete(USER_ATTRIBUTES).where(
                USER_ATTRIBUTES.c.trial_id.in_(open_ones), USER_ATTRIBUTES.c.key.in_(attributes(done[0][1]))
            )
        )
        connection.execute(sa.insert(USER_ATTRIBUTES), _attributes((trial, attributes(one)) for trial, one in done))
        bounds = [(trial, {f"constraints:{name}": v for name, v in one.violations.items()}) for trial, one in done]
        connection.execute(sa.insert(SYSTEM_ATTRIBUTES), _attributes(bounds))
        values = [
            {
                "trial_id": trial,
                "objective": place,
                "value": value,
                "value_type": models.TrialValueModel.TrialValueType.FINITE,
            }
            for trial, one in done
            for place, value in enumerate(one.objectives)
        ]
        connection.execute(sa.insert(VALUES), values)
        early = [
            {
                "trial_id": trial,
                "step": one.scenarios,
                "intermediate_value": one.objectives[0],
                "intermediate_value_type": models.TrialIntermediateValueModel.TrialIntermediateValueType.FINITE,
            }
            for trial, one in done
            if one.pruned
        ]
        if early:
            connection.execute(sa.insert(INTERMEDIATE), early)
        for state, pruned in ((TrialState.PRUNED, True), (TrialState.COMPLETE, False)):
            ids = [trial for trial, one in done if one.pruned == pruned]
            ending = sa.update(TRIALS).where(TRIALS.c.trial_id.in_(ids))
            connection.execute(ending.values(state=state, datetime_complete=_now()))


def beat(engine: sa.Engine, trials: Iterable[int]) -> None:
    """Say that the worker of some trials is alive."""
    with engine.begin() as connection:
        beating = sa.update(HEARTBEATS).where(HEARTBEATS.c.trial_id.in_(list(trials)))
        connection.execute(beating.values(heartbeat=sa.func.current_timestamp()))


def _attributes(tables: Iterable[tuple[int, dict[str, Any]]]) -> list[dict[str, Any]]:
    return [
        {"trial_id": trial, "key": key, "value_json": json.dumps(value)}
        for trial, table in tables
        for key, value in table.items()
    ]


def _now() -> datetime:
    """The time as Optuna's tables hold it: UTC without saying so."""
    return datetime.now(UTC).replace(tzinfo=None)
