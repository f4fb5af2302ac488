"""A study on a real PostgreSQL server: processes that join in, one killed, the server restarted midway."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import optuna
import pytest

from dualwinch.cli import main
from dualwinch.codegen.errors import DualwinchError
from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.optimisers import optimiser
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.storage import connection
from dualwinch.tuning.storage.opening import open_store, stored_definition
from dualwinch.tuning.study import Search, SearchBudget
from dualwinch.tuning.tuning_problem import definition_of
from tests import postgres
from tests.spring_law import SPRING, changed
from tests.studies import MakeProblem

pytestmark = pytest.mark.external

SEARCH = ["tune", "--case", "4", "--set", "simulation.duration=0.05", "--constraint", "none", "--method", "random"]
TRIALS = 160
"""Trials of each process; more than a batch of the slowest is finished before the fastest ends."""


@pytest.fixture(scope="module")
def server() -> Iterator[Any]:
    with postgres.server() as running:
        yield running


@pytest.fixture
def url(server: Any) -> str:
    return postgres.url_of(server)


def light(make_problem: MakeProblem) -> TuningProblem:
    """A problem that a process is quick to set up."""
    return make_problem(ensemble=None, case=4, constraints=["worst.peak_tension<=6000"])


def trials_in(url: str, study: str) -> list[optuna.trial.FrozenTrial]:
    storage = optuna.storages.RDBStorage(url)
    try:
        return optuna.load_study(study_name=study, storage=storage).trials
    except KeyError:
        return []
    finally:
        storage.engine.dispose()


def tuning(url: str, folder: Path) -> "subprocess.Popen[str]":
    """A process that joins a study, its URL in the environment."""
    words = [*SEARCH, "--study", "joined", "--trials", str(TRIALS), "--out", str(folder)]
    environment = os.environ | {"DUALWINCH_STORAGE": url}
    command = [sys.executable, "-m", "dualwinch", *words]
    return subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def test_processes_join_a_study_and_a_kill_and_a_restart_lose_no_finished_trial(
    server: Any, url: str, tmp_path: Path
) -> None:
    processes = [tuning(url, tmp_path / str(index)) for index in range(3)]
    deadline = time.monotonic() + 240
    while len(before := trials_in(url, "joined")) < 32:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    processes[0].send_signal(signal.SIGKILL)
    server.stop()
    server.start()
    endings = [process.communicate(timeout=240)[1] for process in processes]
    assert [process.returncode for process in processes] == [-signal.SIGKILL, 0, 0], endings
    trials = trials_in(url, "joined")
    assert [(trial.number, trial.params) for trial in trials[: len(before)]] == [
        (trial.number, trial.params) for trial in before
    ]
    assert all(trial.state.is_finished() for trial in trials)
    budgets = [[trial.user_attrs["stream"] for trial in trials].count(stream) for stream in streams_of(trials)]
    assert len(budgets) == 3
    assert budgets.count(TRIALS) >= 2
    assert max(budgets) == TRIALS
    assert all((tmp_path / str(index) / "best.toml").is_file() for index in (1, 2))


def streams_of(trials: list[optuna.trial.FrozenTrial]) -> set[str]:
    return {trial.user_attrs["stream"] for trial in trials}


def test_a_study_in_the_database_is_that_of_the_journal(url: str, make_problem: MakeProblem, tmp_path: Path) -> None:
    problem, studies = light(make_problem), []
    training = prepare(problem)
    for storage in (url, str(tmp_path / "journal")):
        store = open_store(storage, "same", problem, definition_of(problem, "cmaes"), resume=False)
        Search("cmaes", optimiser("cmaes", training, 0), store, Evaluator(training)).run(SearchBudget(40))
        studies.append(store.finished())
        store.close()
    assert len(studies[0]) == 40
    assert studies[0] == studies[1]


def test_what_is_wrong_with_a_database_is_one_line_without_the_password(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    with pytest.raises(DualwinchError) as caught:
        stored_definition("postgresql+psycopg://me:secret@127.0.0.1:9/none", "sea")
    assert "me:***@127.0.0.1:9" in str(caught.value)
    assert "secret" not in str(caught.value)
    for url, message in (
        ("mysql://me:secret@host/x", "the driver of the database is missing"),
        ("nosql://me:secret@host/x", "no database that SQLAlchemy knows"),
    ):
        with pytest.raises(SystemExit):
            main([*SEARCH, "--storage", url, "--out", str(tmp_path)])
        printed = capsys.readouterr().err
        assert message in printed
        assert "secret" not in printed


def test_a_study_goes_on_with_the_parts_it_rests_on(
    url: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "law.py"
    file.write_text(SPRING)
    words = [
        *SEARCH,
        "--set",
        "controller.kind=spring",
        "--plugin",
        str(file),
        "--space",
        "controller.spring.stiffness",
    ]
    words += ["--storage", url, "--study", "springs", "--out", str(tmp_path / "out"), "--trials"]
    main([*words, "3"])
    main([*words, "5", "--resume"])
    assert len(trials_in(url, "springs")) == 5
    main([*words, "2"])
    assert len(trials_in(url, "springs")) == 7
    with pytest.raises(ConfigurationError, match="unknown study 'spring'; did you mean 'springs'"):
        stored_definition(url, "spring")
    capsys.readouterr()
    file.write_text(changed(("= 2e4", "= 3e4")))
    with pytest.raises(SystemExit):
        main([*words, "2"])
    assert "error: --study springs: was begun with another position law 'spring'" in capsys.readouterr().err


def test_a_schema_of_another_optuna_is_refused(url: str) -> None:
    import sqlalchemy as sa

    engine = sa.create_engine(url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection_:
        connection_.execute(sa.text("CREATE DATABASE older"))
    engine.dispose()
    older = url.replace("/postgres?", "/older?")
    connection.connected(older).engine.dispose()
    engine = sa.create_engine(older)
    with engine.begin() as connection_:
        connection_.execute(sa.text("UPDATE alembic_version SET version_num = 'v2.6.0.a'"))
    engine.dispose()
    with pytest.raises(connection.StorageError, match="is of another version of Optuna"):
        connection.connected(older)
