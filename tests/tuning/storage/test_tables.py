"""The tables that are written as SQL are those that Optuna makes; the day they change, this says so."""

from pathlib import Path

import optuna
import sqlalchemy as sa

from dualwinch.tuning.storage.tables import FINITE, INTERMEDIATE, TABLES, TRIALS, VALUES, missing


def made_by_optuna(file: Path) -> sa.Engine:
    optuna.storages.RDBStorage(f"sqlite:///{file}").engine.dispose()
    return sa.create_engine(f"sqlite:///{file}")


def test_optuna_makes_every_table_with_every_column(tmp_path: Path) -> None:
    engine = made_by_optuna(tmp_path / "a")
    assert missing(engine) == []
    reflected = sa.MetaData()
    reflected.reflect(engine)
    states = reflected.tables[TRIALS.name].c.state.type
    assert isinstance(states, sa.Enum | sa.VARCHAR)
    for table in TABLES:
        there = reflected.tables[table.name]
        ours = {column.name for column in table.columns}
        needed = {c.name for c in there.columns if not c.nullable and c.server_default is None and not c.primary_key}
        assert needed <= ours, table.name
    engine.dispose()


def test_what_a_database_lacks_is_named(tmp_path: Path) -> None:
    engine = made_by_optuna(tmp_path / "a")
    with engine.begin() as connection:
        connection.execute(sa.text("ALTER TABLE trials RENAME COLUMN number TO place"))
        connection.execute(sa.text("DROP TABLE trial_heartbeats"))
    assert missing(engine) == ["trials.number", "trial_heartbeats.trial_id", "trial_heartbeats.heartbeat"]
    engine.dispose()


def test_a_value_that_optuna_writes_has_the_type_that_is_written_here(tmp_path: Path) -> None:
    storage = optuna.storages.RDBStorage(f"sqlite:///{tmp_path / 'a'}")
    study = optuna.create_study(storage=storage)
    trial = study.ask()
    trial.report(1.0, 1)
    study.tell(trial, 2.0)
    with storage.engine.connect() as connection:
        for table, column in ((VALUES, "value_type"), (INTERMEDIATE, "intermediate_value_type")):
            assert connection.execute(sa.text(f"SELECT {column} FROM {table.name}")).scalars().all() == [FINITE]  # noqa: S608
    storage.engine.dispose()
