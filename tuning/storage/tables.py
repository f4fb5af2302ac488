"""The tables of Optuna's database that batches of trials are written to, as far as this program writes them.

Optuna writes value by value. What it has no public function for is written here as SQL, in the tables as they are
declared below; `missing` finds out what a database lacks of them.
"""

import sqlalchemy as sa
from optuna.trial import TrialState

FINITE = "FINITE"
"""Type of a value that is neither infinite nor missing."""


def _table(name: str, *columns: sa.Column) -> sa.Table:
    return sa.Table(name, sa.MetaData(), *columns)


def _attributes(name: str) -> sa.Table:
    return _table(
        name,
        sa.Column("trial_id", sa.Integer),
        sa.Column("key", sa.String),
        sa.Column("value_json", sa.Text),
    )


TRIALS = _table(
    "trials",
    sa.Column("trial_id", sa.Integer, primary_key=True),
    sa.Column("number", sa.Integer),
    sa.Column("study_id", sa.Integer),
    sa.Column("state", sa.Enum(TrialState)),
    sa.Column("datetime_start", sa.DateTime),
    sa.Column("datetime_complete", sa.DateTime),
)
PARAMETERS = _table(
    "trial_params",
    sa.Column("trial_id", sa.Integer),
    sa.Column("param_name", sa.String),
    sa.Column("param_value", sa.Double),
    sa.Column("distribution_json", sa.Text),
)
VALUES = _table(
    "trial_values",
    sa.Column("trial_id", sa.Integer),
    sa.Column("objective", sa.Integer),
    sa.Column("value", sa.Double),
    sa.Column("value_type", sa.Enum(FINITE, name="trialvaluetype")),
)
INTERMEDIATE = _table(
    "trial_intermediate_values",
    sa.Column("trial_id", sa.Integer),
    sa.Column("step", sa.Integer),
    sa.Column("intermediate_value", sa.Double),
    sa.Column("intermediate_value_type", sa.Enum(FINITE, name="trialintermediatevaluetype")),
)
USER_ATTRIBUTES = _attributes("trial_user_attributes")
SYSTEM_ATTRIBUTES = _attributes("trial_system_attributes")
HEARTBEATS = _table(
    "trial_heartbeats",
    sa.Column("trial_id", sa.Integer),
    sa.Column("heartbeat", sa.DateTime),
)
TABLES = (TRIALS, PARAMETERS, VALUES, INTERMEDIATE, USER_ATTRIBUTES, SYSTEM_ATTRIBUTES, HEARTBEATS)


def server_time() -> sa.ColumnElement:
    """The time of PostgreSQL's server in UTC, whatever the zones of its clients; it goes on during a transaction."""
    return sa.func.timezone("UTC", sa.func.clock_timestamp())


def missing(engine: sa.Engine) -> list[str]:
    """What a database lacks of these tables, such as ``trials.number``; empty where it has them all."""
    inspector = sa.inspect(engine)
    there = set(inspector.get_table_names())
    lacking: list[str] = []
    for table in TABLES:
        known = {column["name"] for column in inspector.get_columns(table.name)} if table.name in there else set()
        lacking += [f"{table.name}.{column.name}" for column in table.columns if column.name not in known]
    return lacking
