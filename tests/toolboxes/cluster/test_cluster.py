"""Many runs on a Dask cluster: a real scheduler and worker processes on loopback, and what happens when one dies."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from dualwinch.cli import main
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.task import WorkerCompileError, WorkerError
from dualwinch.simulation.batch.workers import WorkerWarning, spread
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.toolboxes.cluster.client import ClusterExecutor, cluster_client
from dualwinch.toolboxes.race.race import CHECKPOINTS
from tests.lasting import lasting
from tests.simulation.batch.test_workers import ensemble_with_own_law
from tests.toolboxes.cluster.dask_cluster import DaskProcesses, dask_processes

SHORT = ("--set", "simulation.duration=0.1", "--rollouts", "24", "--scenarios", "2", "--test-scenarios", "4")
RACE = ("race", "--ensemble", "sea", "--estimator", "kalman", "--method", "cmaes", "--seed", "3", *SHORT)
LASTING = 20.0
"""Time in s of runs that take long enough for a worker to be killed meanwhile."""


@pytest.fixture
def dask(tmp_path: Path) -> Iterator[DaskProcesses]:
    """A cluster of two workers."""
    with dask_processes(tmp_path) as processes:
        yield processes


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Interrupts count, even where a shell has tests in the background ignore them."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def command(*words: str) -> "subprocess.Popen[str]":
    """The command line in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "dualwinch", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def ensemble_under_way(dask: DaskProcesses) -> "subprocess.Popen[str]":
    """An ensemble that takes minutes, of which a portion is finished."""
    kept = dask.folder / "kept"
    words = ("--scenarios", "200000", "--set", "simulation.duration=5", "--cluster", dask.address)
    words += ("--checkpoint", str(kept))
    ran = command("simulate", "--ensemble", "sea", *words)
    until(lambda: any(kept.glob("*.result")))
    return ran


def until(happened: Callable[[], bool], seconds: float = 240.0) -> None:
    """Wait until something has happened."""
    end = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < end
        time.sleep(0.05)


def without_time(record: Any) -> Any:
    """A record of a race without how long searches took."""
    if isinstance(record, dict):
        return {key: without_time(value) for key, value in record.items() if key != "seconds"}
    return [without_time(each) for each in record] if isinstance(record, list) else record


def table_of(text: str) -> str:
    """The table of a race, from where it begins."""
    return text[text.index("Race:") :]


FUNCTIONS = """
from distributed import Client

class Closed(Client):
    def __init__(self):
        self.status = "closed"

    def __del__(self):
        pass

def make():
    return 1

def fail():
    return 1 / 0

def leave():
    raise SystemExit(3)

def closed():
    return Closed()
"""


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ("somewhere", "must be the address of a Dask scheduler, tcp://HOST:8786, or FILE.py:FUNCTION"),
        ("nowhere.py:make", r"there is no file nowhere\.py"),
        ("{file}:absent", r"cluster\.py has no function absent"),
        ("{file}:make", r"returned int; must return a distributed\.Client"),
        ("{file}:fail", r"cluster\.py:fail: ZeroDivisionError: division by zero$"),
        ("{file}:leave", r"cluster\.py:leave: SystemExit: 3$"),
        ("{file}:closed", r"cluster\.py:closed: returned a client that is closed; must be one that is connected$"),
        ("tcp://127.0.0.1", r"missing port number .*; must be the address of a Dask scheduler"),
        ("tcp://127.0.0.1:port", r"invalid literal .*; must be the address of a Dask scheduler"),
        ("http://127.0.0.1:8787", r"unknown address scheme 'http' .*; must be the address of a Dask scheduler"),
        ("tls://127.0.0.1:8786", r"^tls://127\.0\.0\.1:8786: needs certificates"),
    ],
)
def test_what_is_no_cluster_is_refused_in_one_line(where: str, message: str, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    file = tmp_path / "cluster.py"
    file.write_text(FUNCTIONS)
    with pytest.raises((ConfigurationError, WorkerError), match=message), cluster_client(where.format(file=file)):
        pass


def test_cluster_belongs_to_ensembles(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """The option; the environment variable is for those commands that can use it."""
    with pytest.raises(SystemExit):
        main(["simulate", "--cluster", "tcp://127.0.0.1:1"])
    assert "--cluster: needs --ensemble" in capsys.readouterr().err
    monkeypatch.setenv("DUALWINCH_CLUSTER", "tcp://127.0.0.1:1")
    main(["simulate", "--set", "simulation.duration=0.1"])


def test_without_the_toolbox_one_line_says_so(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "dualwinch.toolboxes.cluster.client", None)  # as if its folder were deleted
    with pytest.raises(SystemExit):
        main(["simulate", "--ensemble", "sea", "--cluster", "tcp://127.0.0.1:1"])
    error = "dualwinch: error: --cluster: needs the toolbox cluster, which is not installed"
    assert capsys.readouterr().err.splitlines()[-1] == error


class Workers(Executor):
    """A Dask client and its executor: of the workers `a` and `b`, those in `unable` cannot compile."""

    def __init__(self, *unable: str) -> None:
        self.unable, self.asked = unable, list[str]()

    def get_executor(self, **_: bool) -> "Workers":
        return self

    def scheduler_info(self, n_workers: int) -> dict[str, Any]:  # noqa: ARG002
        return {"workers": {"a": None, "b": None}}

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ARG002
        workers = kwargs.get("workers", "ab")
        self.asked.append(workers[0])
        future: Future[Any] = Future()
        if workers[0] in self.unable:
            error = WorkerCompileError(f"worker on {workers[0]}: no C compiler found")
            error.worker = workers[0]
            future.set_exception(error)
        else:
            future.set_result(workers[0])
        return future


def test_a_worker_that_cannot_compile_is_excluded_with_one_warning() -> None:
    workers = Workers("a")
    executor = ClusterExecutor(cast("Any", workers))
    with pytest.warns(
        WorkerWarning, match=r"^worker on a: no C compiler found; its tasks go to other workers$"
    ) as seen:
        assert dict(spread(executor, abs, ((-number,) for number in range(4)), at_once=2)) == dict.fromkeys(
            range(4), "b"
        )
    assert len(seen) == 1
    assert workers.asked == ["a", "a", *"bbbb"]
    with pytest.warns(WorkerWarning), pytest.raises(WorkerCompileError, match=r"^worker on b: no C compiler found$"):
        list(spread(ClusterExecutor(cast("Any", Workers("a", "b"))), abs, [(-1,)]))


@pytest.mark.slow
def test_workers_that_never_saw_a_part_compute_the_same_bits(dask: DaskProcesses, tmp_path: Path) -> None:
    """A law of one's own, from files that are on no search path of theirs."""
    ensemble = ensemble_with_own_law(tmp_path)
    here = run_ensemble(ensemble, 100, 3)
    with cluster_client(dask.address) as client:
        there = run_ensemble(ensemble, 100, 3, workers=client.get_executor(pure=False))
    assert all(np.array_equal(here.metrics[name], values, equal_nan=True) for name, values in there.metrics.items())


@pytest.mark.slow
def test_a_worker_that_is_killed_in_mid_batch_costs_time_and_nothing_else(dask: DaskProcesses) -> None:
    here = run_ensemble(lasting(LASTING), 640, 5)
    killed = list[float]()

    def kill(done: float) -> None:
        if not killed:
            dask.workers[0].kill()
            killed.append(done)

    with cluster_client(dask.address) as client:
        client.wait_for_workers(2, timeout=60)
        there = run_ensemble(lasting(LASTING), 640, 5, workers=ClusterExecutor(client), progress=kill)
    assert killed[0] < 1
    assert dask.workers[0].wait(10) == -signal.SIGKILL
    assert len(there) == 640
    assert there.outcomes.tolist() == here.outcomes.tolist()
    for name, values in here.metrics.items():
        assert np.array_equal(values, there.metrics[name], equal_nan=True)
    for key, values in here.draws.items():
        assert np.array_equal(values, there.draws[key])


@pytest.mark.slow
def test_a_worker_that_cannot_compile_is_named_in_one_line(tmp_path: Path) -> None:
    with dask_processes(tmp_path, workers=0) as dask:
        dask.start_worker(
            environment={"DUALWINCH_CC": "/nowhere/cc", "DUALWINCH_CACHE_DIR": str(tmp_path / "empty-cache")}
        )
        with cluster_client(dask.address) as client:  # else the command may be there first, and waits
            client.wait_for_workers(1, timeout=60)
        ran = command("simulate", "--ensemble", "sea", "--scenarios", "8", "--cluster", dask.address)
        said = ran.communicate(timeout=120)[1]
    assert ran.returncode == 1
    assert "1 workers with 1 threads; dashboard http://" in said
    assert said.splitlines()[-1].startswith("dualwinch: error: worker on ")
    assert "'/nowhere/cc' is no working C compiler" in said.splitlines()[-1]


@pytest.mark.slow
def test_what_a_worker_cannot_compile_another_one_does(tmp_path: Path) -> None:
    words = ["simulate", "--ensemble", "sea", "--scenarios", "200", "--set", "simulation.duration=1", "--json"]
    with dask_processes(tmp_path, workers=1) as dask:
        dask.start_worker(
            environment={"DUALWINCH_CC": "/nowhere/cc", "DUALWINCH_CACHE_DIR": str(tmp_path / "empty-cache")}
        )
        with cluster_client(dask.address) as client:
            client.wait_for_workers(2, timeout=60)
        ran = command(*words, "--cluster", dask.address)
        found, said = ran.communicate(timeout=120)
    assert ran.returncode == 0, said
    (line,) = [each for each in said.splitlines() if each.startswith("dualwinch: warning: worker on ")]
    assert line.endswith("; its tasks go to other workers")
    assert found == command(*words).communicate(timeout=120)[0]


@pytest.mark.slow
def test_an_ensemble_whose_client_was_killed_goes_on_with_what_is_kept(dask: DaskProcesses, tmp_path: Path) -> None:
    words = ["simulate", "--ensemble", "sea", "--scenarios", "2000", "--set", f"simulation.duration={LASTING}"]
    there = [
        *words,
        "--cluster",
        dask.address,
        "--checkpoint",
        str(tmp_path / "kept"),
        "--out",
        str(tmp_path / "there.csv"),
    ]
    ran = command(*there)
    until(lambda: len(list(tmp_path.glob("kept/*.result"))) >= 5)
    ran.kill()
    ran.communicate()
    kept = {file: file.stat().st_mtime_ns for file in tmp_path.glob("kept/*.result")}
    assert 5 <= len(kept) < 2000 // 64
    main(there)
    assert len(list(tmp_path.glob("kept/*.result"))) == -(-2000 // 64)
    assert all(file.stat().st_mtime_ns == time for file, time in kept.items())
    main([*words, "--out", str(tmp_path / "here.csv")])
    assert (tmp_path / "there.csv").read_bytes() == (tmp_path / "here.csv").read_bytes()


@pytest.mark.slow
def test_a_worker_out_of_memory_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its nanny ends it; after another one, by default after three, Dask gives the task up."""
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES", "1")
    with dask_processes(tmp_path, workers=0) as dask:
        dask.start_worker("--memory-limit", "600MB", nanny=True)
        with cluster_client(dask.address) as client, pytest.raises(WorkerError, match="killed, or out of memory"):
            list(spread(ClusterExecutor(client), greedy, [(1,)]))


def greedy(gigabytes: int) -> int:
    """Take memory until the system refuses more."""
    taken = []
    for _ in range(200 * gigabytes):
        taken.append(np.ones(1_000_000))
        time.sleep(0.02)
    return len(taken)


@pytest.mark.slow
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM])
def test_a_scheduler_that_goes_away_is_one_line(end: signal.Signals, dask: DaskProcesses) -> None:
    ran = ensemble_under_way(dask)
    assert dask.scheduler is not None
    dask.scheduler.send_signal(end)
    said = ran.communicate(timeout=120)[1]
    assert ran.returncode == 1
    assert len(said.splitlines()) <= 3, said
    assert said.splitlines()[-1].startswith("dualwinch: error: workers: the scheduler has dropped a task")


@pytest.mark.slow
@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_cancels_on_the_cluster_and_keeps_what_is_finished(dask: DaskProcesses) -> None:
    def interrupt(done: float) -> None:  # noqa: ARG001
        signal.raise_signal(signal.SIGINT)

    with cluster_client(dask.address) as client:
        found = run_ensemble(lasting(LASTING), 20_000, 5, workers=ClusterExecutor(client), progress=interrupt)
        assert len(found) == 320
        assert found.partial
        processing: Any = client.processing()
        for _ in range(100):
            if not any(processing.values()):
                break
            time.sleep(0.1)
            processing = client.processing()
        assert not any(processing.values())
    ran = ensemble_under_way(dask)
    ran.send_signal(signal.SIGINT)
    assert "interrupted" in ran.communicate(timeout=60)[1].splitlines()[-1]
    assert ran.returncode == 130


@pytest.mark.slow
def test_a_race_whose_client_and_worker_were_killed_equals_that_of_one_process_in_every_digit(
    dask: DaskProcesses, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """First the client, as soon as an entry is finished; then, of another client, a worker after the next entry."""
    words = [*RACE, "--law", "adrc", "--law", "pid-cascade", "--searches", "2", "--constraint", "mean.chatter<=1*paper"]
    main([*words, "--out", str(tmp_path / "here")])
    here = table_of(capsys.readouterr().out)
    there = [*words, "--out", str(tmp_path / "there"), "--cluster", dask.address]

    def entries() -> int:
        return len(list((tmp_path / "there" / CHECKPOINTS).glob("*.result")))

    ran = command(*there)
    until(lambda: entries() > 0)
    ran.kill()
    ran.communicate()
    kept = entries()
    assert 0 < kept < 5
    ran = command(*there)
    until(lambda: entries() > kept)
    dask.workers[1].kill()
    out, said = ran.communicate(timeout=1200)
    assert ran.returncode == 0, said
    assert table_of(out) == here
    ours, theirs = (json.loads((tmp_path / name / "race.json").read_text()) for name in ("here", "there"))
    assert entries() == 5  # the paper, and two searches of both laws
    assert without_time(ours) == without_time(theirs)


@pytest.mark.slow
def test_a_tuning_by_an_executor_finds_the_same_gains(dask: DaskProcesses, tmp_path: Path) -> None:
    words = ["tune", "--ensemble", "sea", "--set", "simulation.duration=0.1", "--trials", "48", "--constraint", "none"]
    main([*words, "--out", str(tmp_path / "here")])
    main([*words, "--out", str(tmp_path / "there"), "--cluster", dask.address])
    best = [(tmp_path / name / "best.toml").read_text().splitlines() for name in ("here", "there")]
    ours, theirs = ([line for line in text if not line.startswith("#")] for text in best)
    assert ours == theirs
