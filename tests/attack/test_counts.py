"""Workers interrupted and killed at random moments: a study has as many trials as were asked for, not one more."""

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
from optuna.storages import RetryHeartbeatStaleTrialCallback
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, TrialState

from tests import postgres
from tests.attack.workers import GRACE, STUDY, TRIALS, begin, work_in_database, work_in_file

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="signals"),
    pytest.mark.filterwarnings("ignore::optuna.exceptions.ExperimentalWarning"),
]

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


def check_successors(trials: list[FrozenTrial]) -> None:
    """Retries are the failed trials: each that failed is finished once at its place, with its point where it had one.

    Where another trial of that place was earlier, a worker failed its own before it evaluated it.
    """
    finished = {
        trial.user_attrs["place"]: trial for trial in trials if trial.state in FINISHED and "place" in trial.user_attrs
    }
    failed = [trial for trial in trials if trial.state == TrialState.FAIL]
    assert not finished or sorted(finished) == list(range(TRIALS)), "each place is finished, none twice"
    for trial in failed:
        if "place" not in trial.user_attrs:
            assert "origin" not in trial.user_attrs, "asked for in vain: the queue was empty"
            continue
        place = trial.user_attrs["place"]
        assert [each.number for each in trials if each.state in FINISHED and each.user_attrs["place"] == place] == [
            finished[place].number
        ]
    retried = {
        origin
        for trial in trials
        if (origin := RetryHeartbeatStaleTrialCallback.retried_trial_number(trial)) is not None
    }
    assert retried <= {trial.number for trial in failed}
    first: dict[int, FrozenTrial] = {}
    for trial in trials:
        if "place" in trial.user_attrs:
            first.setdefault(trial.user_attrs["place"], trial)
    for place, trial in first.items():
        if trial.state == TrialState.FAIL:
            assert trial.number in retried
            points = [each.params for each in failed if each.user_attrs.get("place") == place]
            assert finished[place].params in points, "it is tried again with its point"
        else:
            assert finished[place] is trial, "what is finished is not done again"


def check(trials: list[FrozenTrial]) -> None:
    states = Counter(trial.state for trial in trials)
    assert states[TrialState.COMPLETE] + states[TrialState.PRUNED] == TRIALS
    assert states[TrialState.RUNNING] == states[TrialState.WAITING] == 0
    assert [trial.number for trial in trials] == list(range(len(trials)))
    check_successors(trials)
    origins = [trial.user_attrs["origin"] for trial in trials if trial.state in FINISHED]
    assert sorted(origins) == ["paper"] + ["random"] * (TRIALS - 1)


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
        check(optuna.load_study(study_name=STUDY, storage=kept).trials)


@pytest.mark.external
def test_a_study_in_a_database(attack: int, processes: ForkServerContext, url: str) -> None:
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    for seed in range(attack):
        chance = random.Random(seed)  # noqa: S311
        begin(url).close()
        workers = [started(processes, work_in_database, url) for _ in range(WORKERS)]
        for _ in range(BLOWS):
            time.sleep(chance.uniform(0, 0.4))
            index = chance.randrange(WORKERS)
            hit(workers[index], chance)
            ended(workers[index])
            workers[index] = started(processes, work_in_database, url)
        assert [ended(worker) for worker in workers] == [0] * WORKERS
        storage = optuna.storages.RDBStorage(url)
        check(optuna.load_study(study_name=STUDY, storage=storage).trials)
        optuna.delete_study(study_name=STUDY, storage=storage)
        storage.engine.dispose()


@pytest.mark.external
def test_trials_that_wait_beyond_what_was_asked_for_are_left(url: str) -> None:
    store = begin(url, "surplus")
    budget = store.budget()

    def propose(count: int, _: bool) -> list[Any]:
        from dualwinch.tuning.scoring.ranking import Candidate

        return [Candidate({"controller.nftsm.beta": 0.1}, "random")] * count

    claims = store.claim(TRIALS, budget, propose)
    store.release(claims[:3])
    store.set_budget(type(budget)(TRIALS - 2))
    assert len(store.claim(TRIALS, store.budget(), propose)) == 1
    store.close()


@pytest.mark.external
@pytest.mark.parametrize("moment", ["set_user_attr", "create_study"])
def test_a_study_killed_while_it_is_begun_is_begun_anew(moment: str, url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    class Killed(BaseException):
        pass

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
            begin(url, f"begun {moment}")
    store = begin(url, f"begun {moment}")
    assert store.definition["method"] == "random"
    assert store.budget().trials == TRIALS
    store.close()


@pytest.mark.external
def test_a_worker_that_was_only_asleep_finishes_nothing_twice(processes: ForkServerContext, url: str) -> None:
    begin(url).close()
    sleeper = started(processes, work_in_database, url)
    time.sleep(0.3)
    assert sleeper.pid is not None
    os.kill(sleeper.pid, signal.SIGSTOP)
    time.sleep(GRACE + 1)
    other = started(processes, work_in_database, url)
    assert ended(other) == 0
    os.kill(sleeper.pid, signal.SIGCONT)
    assert ended(sleeper) == 0
    storage = optuna.storages.RDBStorage(url)
    check(optuna.load_study(study_name=STUDY, storage=storage).trials)
    optuna.delete_study(study_name=STUDY, storage=storage)
    storage.engine.dispose()
