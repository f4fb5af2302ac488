"""Processes interrupted and killed at random moments: no trial is lost, and every budget is spent to the trial."""

import multiprocessing
import os
import random
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing.context import ForkServerContext, ForkServerProcess
from pathlib import Path
from typing import Any

import optuna
import pytest
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, TrialState

from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.storage.opening import open_store
from dualwinch.tuning.tuning_problem import definition_of
from tests import postgres
from tests.attack.workers import STUDY, TRIALS, problem, work_in_database, work_in_file

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals")

FINISHED = (TrialState.COMPLETE, TrialState.PRUNED)

WORKERS, BLOWS = 3, 4
"""Processes at work at once in a database, and how many of them are hit in a try."""

LONGEST = 120.0
"""Time in s after which a study counts as stuck."""


@pytest.fixture(scope="module")
def processes() -> ForkServerContext:
    """Forks processes that have imported everything, so that signals meet them at work and not at their imports."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tests.attack.workers"])
    return context


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    with postgres.server() as running:
        yield postgres.url_of(running)


def started(processes: ForkServerContext, work: Callable[[str, Any], None], storage: str) -> ForkServerProcess:
    """A process that has just begun to work."""
    ready = processes.Semaphore(0)
    process = processes.Process(target=work, args=(storage, ready))
    process.start()
    assert ready.acquire(timeout=LONGEST)
    return process


def hit(process: ForkServerProcess, chance: random.Random) -> None:
    with suppress(ProcessLookupError):
        assert process.pid is not None
        os.kill(process.pid, chance.choice([signal.SIGINT, signal.SIGINT, signal.SIGKILL]))


def ended(process: ForkServerProcess) -> int:
    process.join(LONGEST)
    assert process.exitcode is not None, "hangs"
    return process.exitcode


def check(trials: list[FrozenTrial]) -> None:
    assert {trial.state for trial in trials} <= set(FINISHED)
    assert [trial.number for trial in trials] == list(range(len(trials)))
    assert {trial.user_attrs["origin"] for trial in trials} == {"paper", "random"}


@pytest.mark.parametrize("blows", [1, pytest.param(BLOWS, marks=pytest.mark.slow)])
def test_a_study_in_a_file(blows: int, attack: int, processes: ForkServerContext, tmp_path: Path) -> None:
    for seed in range(attack):
        chance = random.Random(seed)  # noqa: S311
        storage = str(tmp_path / f"{seed}.journal")
        for _ in range(blows):
            process = started(processes, work_in_file, storage)
            time.sleep(chance.uniform(0, 0.5))
            hit(process, chance)
            ended(process)
        assert ended(started(processes, work_in_file, storage)) == 0
        kept = optuna.storages.JournalStorage(JournalFileBackend(storage))
        trials = optuna.load_study(study_name=STUDY, storage=kept).trials
        check(trials)
        assert len(trials) == TRIALS
        assert [trial.user_attrs["origin"] for trial in trials].count("paper") == 1


@pytest.mark.external
def test_a_study_in_a_database(attack: int, processes: ForkServerContext, url: str) -> None:
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    for seed in range(attack):
        chance = random.Random(seed)  # noqa: S311
        workers = [started(processes, work_in_database, url) for _ in range(WORKERS)]
        for _ in range(BLOWS):
            time.sleep(chance.uniform(0, 0.4))
            index = chance.randrange(WORKERS)
            hit(workers[index], chance)
            ended(workers[index])
            workers[index] = started(processes, work_in_database, url)
        assert [ended(worker) for worker in workers] == [0] * WORKERS
        storage = optuna.storages.RDBStorage(url)
        trials = optuna.load_study(study_name=STUDY, storage=storage).trials
        check(trials)
        budgets = Counter(trial.user_attrs["stream"] for trial in trials)
        assert max(budgets.values()) == TRIALS
        assert list(budgets.values()).count(TRIALS) >= WORKERS
        optuna.delete_study(study_name=STUDY, storage=storage)
        storage.engine.dispose()


@pytest.mark.external
@pytest.mark.parametrize("moment", ["set_user_attr", "create_study"])
def test_a_study_killed_while_it_is_begun_is_begun_anew(moment: str, url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    class Killed(BaseException):
        pass

    task = problem()
    owner = optuna.Study if moment == "set_user_attr" else optuna
    whole, calls = getattr(owner, moment), []

    def killed(*words: Any, **named: Any) -> Any:
        calls.append(words)
        if len(calls) == 2 or moment == "create_study":
            whole(*words, **named)
            raise Killed
        return whole(*words, **named)

    with monkeypatch.context() as patch:
        patch.setattr(owner, moment, killed)
        with pytest.raises(Killed):
            open_store(url, f"begun {moment}", task, definition_of(task, "random"), resume=False)
    open_store(url, f"begun {moment}", task, definition_of(task, "random"), resume=False).close()
    with pytest.raises(ConfigurationError, match="was begun with another method"):
        open_store(url, f"begun {moment}", task, definition_of(task, "cmaes"), resume=False)
