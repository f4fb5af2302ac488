"""A study on a real PostgreSQL server: three workers, one killed, the server restarted midway, and an exact count."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import optuna
import pytest
from optuna.storages import RetryHeartbeatStaleTrialCallback
from optuna.trial import TrialState

from dualwinch.cli import main
from dualwinch.codegen.errors import DualwinchError
from dualwinch.config.plugins import load_plugin
from dualwinch.controllers.registry import POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.optimisers import optimiser
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.storage import connection
from dualwinch.tuning.storage.database import FINISHED, DatabaseStudy
from dualwinch.tuning.storage.opening import kept_definition
from dualwinch.tuning.storage.store import SearchBudget
from dualwinch.tuning.study import search
from dualwinch.tuning.tuning_problem import definition_of, tuning_problem
from tests import postgres
from tests.spring_law import SPRING, changed
from tests.studies import MakeProblem

pytestmark = pytest.mark.external

TRIALS = 112

WORKER = """
import sys, time
import dualwinch.tuning.storage.connection as connection
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate

connection.HEARTBEAT, connection.GRACE = 1, 2
evaluate = Evaluator.evaluate

def slowly(self, candidates):
    print("evaluating", flush=True)
    time.sleep(1e9 if "hangs" in sys.argv else 0.2)
    return evaluate(self, candidates)

Evaluator.evaluate = slowly
from dualwinch.cli import main
main(["worker", "--study", sys.argv[1], "--threads", "1"])
"""


@pytest.fixture(scope="module")
def server() -> Iterator[Any]:
    with postgres.server() as running:
        yield running


@pytest.fixture
def url(server: Any, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(connection, "HEARTBEAT", 1)
    monkeypatch.setattr(connection, "GRACE", 2)
    return postgres.url_of(server)


def light(make_problem: MakeProblem) -> TuningProblem:
    """A problem that a process is quick to set up."""
    return make_problem(ensemble=None, case=4, constraints=["worst.peak_tension<=6000"])


def states(url: str, study: str) -> Counter[TrialState]:
    storage = optuna.storages.RDBStorage(url)
    found = Counter(trial.state for trial in optuna.load_study(study_name=study, storage=storage).trials)
    storage.engine.dispose()
    return found


def waited_for(condition: Any, seconds: float = 240) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.filterwarnings("ignore::optuna.exceptions.ExperimentalWarning")
def test_a_killed_worker_and_a_restart_lose_nothing(server: Any, url: str, make_problem: MakeProblem) -> None:
    problem = light(make_problem)
    store = DatabaseStudy.begin(
        url, "sea", problem, definition_of(problem, "cmaes"), SearchBudget(TRIALS), resume=False
    )
    environment = os.environ | {"DUALWINCH_STORAGE": url, "PYTHONPATH": str(Path.cwd())}
    words, pipe = [sys.executable, "-c", WORKER, "sea"], subprocess.PIPE
    hanging = subprocess.Popen([*words, "hangs"], env=environment, stdout=pipe, text=True)
    workers = [subprocess.Popen(words, env=environment, stdout=pipe, stderr=pipe) for _ in range(2)]
    watching = optuna.storages.RDBStorage(url, engine_kwargs={"pool_pre_ping": True})
    study = optuna.load_study(study_name="sea", storage=watching)

    def running(process: int) -> list[int]:
        trials = study.get_trials(deepcopy=False, states=(TrialState.RUNNING,))
        return [trial.number for trial in trials if f"-{process}-" in trial.user_attrs.get("worker", "")]

    assert hanging.stdout is not None
    while "evaluating" not in hanging.stdout.readline():
        assert hanging.poll() is None
    hanging.send_signal(signal.SIGKILL)
    hanging.communicate()
    lost = running(hanging.pid)
    assert lost
    before = {trial.number: trial.values for trial in study.get_trials(states=FINISHED)}
    waited_for(lambda: store.count() > TRIALS // 3)
    watching.engine.dispose()
    server.stop()
    server.start()
    endings = [worker.communicate(timeout=240)[1].decode() for worker in workers]
    assert [worker.returncode for worker in workers] == [0, 0], endings
    trials = study.get_trials()
    assert Counter(trial.state in FINISHED for trial in trials)[True] == TRIALS
    assert {trial.number: trial.values for trial in trials if trial.number in before} == before
    retried = [
        number
        for trial in trials
        if (number := RetryHeartbeatStaleTrialCallback.retried_trial_number(trial)) is not None
    ]
    assert set(lost) <= set(retried)
    failed = [trial for trial in trials if trial.state == TrialState.FAIL]
    done = {trial.user_attrs["place"]: trial.number for trial in trials if trial.state in FINISHED}
    assert sorted(done) == list(range(TRIALS)), "each place is finished, none twice"
    assert set(retried) <= {trial.number for trial in failed}
    places = [(trial, trial.user_attrs["place"]) for trial in failed if "origin" in trial.user_attrs]
    assert all(
        trial.number in retried
        or done[place] < trial.number
        or any(each.number < trial.number and where == place and each.number in retried for each, where in places)
        for trial, place in places
    ), "retries are the failed trials, but for those that gave way to an earlier one at their place"
    assert len(store.finished()) == store.count() == TRIALS
    assert [trial.user_attrs["origin"] for trial in trials[:1]] == ["paper"]
    store.close()
    watching.engine.dispose()


def test_a_study_in_the_database_is_that_of_the_journal(url: str, make_problem: MakeProblem, tmp_path: Path) -> None:
    from dualwinch.tuning.storage.opening import open_store

    problem, found = light(make_problem), []
    prepared = prepare(problem)
    for storage in (url, str(tmp_path / "journal")):
        store = open_store(storage, "same", problem, definition_of(problem, "cmaes"), SearchBudget(40), resume=False)
        search("cmaes", optimiser("cmaes", prepared, 0), store, Evaluator(prepared))
        found.append(store.finished())
        assert store.claim(16, SearchBudget(40), lambda count, first: []) == []  # noqa: ARG005
        store.close()
    assert len(found[0]) == 40
    assert found[0] == found[1]


def test_workers_side_by_side_take_no_more_trials_than_there_shall_be(url: str, make_problem: MakeProblem) -> None:
    """Each pops waiting trials while the others do; whatever of a place is there twice is failed."""
    problem, budget = light(make_problem), SearchBudget(16)
    store = DatabaseStudy.begin(url, "side", problem, definition_of(problem, "random"), budget, resume=False)
    workers = [store, *(DatabaseStudy.join(url, "side") for _ in range(3))]

    def propose(count: int, first: bool) -> list[Candidate]:  # noqa: ARG001
        return [Candidate(problem.start, "random")] * count

    with ThreadPoolExecutor() as pool:
        claims = [claim for found in pool.map(lambda each: each.claim(9, budget, propose), workers) for claim in found]
    while more := [claim for worker in workers for claim in worker.claim(9, budget, propose)]:
        claims += more
    assert len({claim.trial for claim in claims}) == len(claims) == 16
    assert states(url, "side")[TrialState.RUNNING] == 16
    storage = optuna.storages.RDBStorage(url)
    study = optuna.load_study(study_name="side", storage=storage)
    study.add_trial(optuna.trial.create_trial(state=TrialState.WAITING, user_attrs={"place": 3}))
    storage.engine.dispose()
    assert store.claim(1, SearchBudget(17), propose) == [], "the place is taken"
    for worker in workers:
        worker.close()


@pytest.mark.filterwarnings("ignore")
def test_a_worker_that_dies_as_it_asks_costs_no_trial(url: str, make_problem: MakeProblem) -> None:
    """With the first candidate in its hands, and with a new trial that has no place yet."""
    problem, budget = light(make_problem), SearchBudget(6)
    prepared = prepare(problem)
    store = DatabaseStudy.begin(url, "asked", problem, definition_of(problem, "random"), budget, resume=False)
    storage = optuna.storages.RDBStorage(url)
    dying = optuna.load_study(study_name="asked", storage=storage)
    assert ["place" in dying.ask().user_attrs for _ in range(2)] == [True, False]
    storage.engine.dispose()
    search("random", optimiser("random", prepared, 0), store, Evaluator(prepared))
    assert states(url, "asked")[TrialState.COMPLETE] == 6
    assert states(url, "asked")[TrialState.RUNNING] == 0
    assert [each.candidate.origin for each in store.finished()].count("paper") == 1
    store.close()


@pytest.mark.filterwarnings("ignore")
def test_what_the_public_functions_of_optuna_lack(tmp_path: Path) -> None:
    """Fails on the day that Optuna records a heartbeat as it is asked for a trial, or finishes several at once."""
    storage = optuna.storages.RDBStorage(f"sqlite:///{tmp_path / 'study'}", heartbeat_interval=1, grace_period=1)
    study = optuna.create_study(storage=storage)
    trial = study.ask()
    time.sleep(2.5)
    optuna.storages.fail_stale_trials(study)
    assert study.trials[trial.number].state == TrialState.RUNNING, "database.py need not beat behind each ask"
    assert not [name for name in dir(study) if name.startswith("tell") and name != "tell"], "batches can be finished"


def test_an_interrupted_batch_is_queued_again(url: str, make_problem: MakeProblem) -> None:
    problem = light(make_problem)
    prepared = prepare(problem)
    store = DatabaseStudy.begin(
        url, "interrupted", problem, definition_of(problem, "random"), SearchBudget(20), resume=False
    )

    class Interrupted(Evaluator):
        def evaluate(self, candidates: Any) -> Any:
            raise KeyboardInterrupt(candidates)

    with pytest.raises(KeyboardInterrupt):
        search("random", optimiser("random", prepared, 0), store, Interrupted(prepared))
    assert states(url, "interrupted") == {TrialState.FAIL: 16, TrialState.WAITING: 16}
    search("random", optimiser("random", prepared, 0), store, Evaluator(prepared))
    assert states(url, "interrupted") == {TrialState.FAIL: 16, TrialState.COMPLETE: 20}
    store.close()


def test_what_is_wrong_with_a_database_is_one_line_without_the_password(
    url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(DualwinchError) as caught:
        DatabaseStudy.join("postgresql+psycopg://me:secret@127.0.0.1:9/none", "sea")
    assert "me:***@127.0.0.1:9" in str(caught.value)
    assert "secret" not in str(caught.value)
    with pytest.raises(ConfigurationError, match="--study: unknown study 'nothing'; "):
        DatabaseStudy.join(url, "nothing")
    with pytest.raises(SystemExit):
        main(["worker", "--storage", "mysql://me:secret@host/x"])
    said = capsys.readouterr().err
    assert "must be a file, or postgresql+psycopg://" in said
    assert "secret" not in said


def test_a_worker_imports_the_parts_that_the_study_rests_on(
    url: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "law.py"
    file.write_text(SPRING)
    load_plugin(str(file))
    problem = tuning_problem(
        case=4,
        settings=["simulation.duration=0.05", "controller.kind=spring"],
        space=["controller.spring.stiffness"],
        constraints=[],
    )
    definition = definition_of(problem, "cmaes")
    DatabaseStudy.begin(url, "springs", problem, definition, SearchBudget(3), resume=False).close()
    assert kept_definition(url, "springs") == definition
    assert kept_definition(url, "no springs") is None

    def joined() -> str:
        POSITION_LAWS._parts.pop("spring", None)
        with suppress(SystemExit):
            main(["worker", "--storage", url, "--study", "springs", "--threads", "1"])
        return capsys.readouterr().err.splitlines()[-1]

    file.write_text(changed(("= 2e4", "= 3e4")))
    assert "error: --study springs: was begun with another position law 'spring'" in joined()
    file.unlink()
    assert "error: --study springs: needs the position law 'spring'" in joined()
    assert states(url, "springs") == {TrialState.WAITING: 1}, "the start"
    file.write_text(SPRING)
    assert "the study is over: 3 trials" in joined()
    assert states(url, "springs") == {TrialState.COMPLETE: 3}


def test_a_schema_of_another_optuna_is_refused(url: str) -> None:
    import sqlalchemy as sa

    engine = sa.create_engine(url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection_:
        connection_.execute(sa.text("CREATE DATABASE older"))
    engine.dispose()
    other = url.replace("/postgres?", "/older?")
    connection.connected(other).engine.dispose()
    engine = sa.create_engine(other)
    with engine.begin() as connection_:
        connection_.execute(sa.text("UPDATE alembic_version SET version_num = 'v2.6.0.a'"))
    engine.dispose()
    with pytest.raises(connection.StorageError, match="is of another version of Optuna"):
        DatabaseStudy.join(other, "sea")
