"""Batches of trials as rows of Optuna's tables: what Optuna writes value by value, in one transaction.

Connecting has found out that the database has the tables (`tuning.storage.connection`). A batch is written whole or
not at all.
"""

import json
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from typing import Any

import sqlalchemy as sa
from optuna.distributions import distribution_to_json
from optuna.trial import TrialState

from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.space import Space
from dualwinch.tuning.storage.record import attributes, distributions
from dualwinch.tuning.storage.tables import (
    FINITE,
    HEARTBEATS,
    INTERMEDIATE,
    PARAMETERS,
    SYSTEM_ATTRIBUTES,
    TRIALS,
    USER_ATTRIBUTES,
    VALUES,
    server_time,
)


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
        candidates: what the trials evaluate.
        notes: user attributes of each trial.

    Returns:
        The trials' ids.
    """
    if not candidates:
        return []
    known = distributions(space)
    first = connection.execute(sa.select(sa.func.count()).where(TRIALS.c.study_id == study)).scalar_one()
    fresh = [
        {"number": first + index, "study_id": study, "state": TrialState.RUNNING, "datetime_start": now()}
        for index in range(len(candidates))
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
        for trial, candidate in zip(ids, candidates, strict=True)
        for name, value in candidate.point.items()
    ]
    connection.execute(sa.insert(PARAMETERS), parameters)
    connection.execute(sa.insert(USER_ATTRIBUTES), _attributes(zip(ids, notes, strict=True)))
    beating = sa.insert(HEARTBEATS).values(heartbeat=server_time())
    connection.execute(beating, [{"trial_id": trial} for trial in ids])
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
        connection.execute(
            sa.insert(USER_ATTRIBUTES), _attributes((trial, attributes(evaluation)) for trial, evaluation in done)
        )
        bounds = [
            (trial, {f"constraints:{name}": value for name, value in evaluation.violations.items()})
            for trial, evaluation in done
        ]
        connection.execute(sa.insert(SYSTEM_ATTRIBUTES), _attributes(bounds))
        values = [
            {
                "trial_id": trial,
                "objective": index,
                "value": value,
                "value_type": FINITE,
            }
            for trial, evaluation in done
            for index, value in enumerate(evaluation.objectives)
        ]
        connection.execute(sa.insert(VALUES), values)
        early = [
            {
                "trial_id": trial,
                "step": evaluation.scenarios,
                "intermediate_value": evaluation.objectives[0],
                "intermediate_value_type": FINITE,
            }
            for trial, evaluation in done
            if evaluation.pruned
        ]
        if early:
            connection.execute(sa.insert(INTERMEDIATE), early)
        for state, pruned in ((TrialState.PRUNED, True), (TrialState.COMPLETE, False)):
            ids = [trial for trial, evaluation in done if evaluation.pruned == pruned]
            ending = sa.update(TRIALS).where(TRIALS.c.trial_id.in_(ids))
            connection.execute(ending.values(state=state, datetime_complete=now()))


def beat(engine: sa.Engine, trials: Iterable[int]) -> None:
    """Say that the worker of some trials is alive."""
    with engine.begin() as connection:
        beating = sa.update(HEARTBEATS).where(HEARTBEATS.c.trial_id.in_(list(trials)))
        connection.execute(beating.values(heartbeat=server_time()))


def _attributes(tables: Iterable[tuple[int, dict[str, Any]]]) -> list[dict[str, Any]]:
    return [
        {"trial_id": trial, "key": key, "value_json": json.dumps(value)}
        for trial, table in tables
        for key, value in table.items()
    ]


def now() -> datetime:
    """The time as Optuna's tables hold it: UTC without saying so."""
    return datetime.now(UTC).replace(tzinfo=None)
