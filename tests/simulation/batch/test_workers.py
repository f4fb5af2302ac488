"""Many runs on an executor's workers: the same bits as on threads here, and one line where a worker is another."""

import multiprocessing
import pickle
import platform
import sys
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dualwinch.codegen.errors import CompilerNotFoundError
from dualwinch.config.ensemble_file import load_ensemble, reset
from dualwinch.config.plugins import load_plugin
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.part import PLUGIN
from dualwinch.simulation.batch import task as tasks
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.batch.sensitivities import sensitivities
from dualwinch.simulation.batch.task import WorkerCompileError, WorkerError, WorkerTask, run_task
from dualwinch.simulation.batch.workers import CheckpointingExecutor, SerialExecutor, in_order, portion_of, spread
from dualwinch.simulation.ensembles.comparison import compare
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.sweep import sweep
from tests.lasting import lasting

EXAMPLES = Path(__file__).parents[3] / "examples"


class Remote(Executor):
    """Runs everything at once, in this thread, with arguments and results that have been through pickle."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.sent.append(pickle.dumps((fn, args, kwargs)))
        work, arguments, named = pickle.loads(self.sent[-1])  # noqa: S301
        try:
            future.set_result(pickle.loads(pickle.dumps(work(*arguments, **named))))  # noqa: S301
        except Exception as error:  # noqa: BLE001  as executors do
            future.set_exception(error)
        return future


class FirstOnly(Executor):
    """Runs nothing; of the first task alone the result is there."""

    def __init__(self) -> None:
        self.futures: list[Future[Any]] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ARG002
        self.futures.append(Future())
        if len(self.futures) == 1:
            self.futures[0].set_result(5)
        return self.futures[-1]


def runs(duration: float = 0.2) -> list[Experiment]:
    return [override(case(number), {"simulation.duration": duration}) for number in (4, 3, 4)]


def equal(ours: Any, theirs: Any) -> bool:
    """Whether two results are the same to the last bit, tables and parts included."""
    if isinstance(ours, np.ndarray):
        return np.array_equal(ours, theirs, equal_nan=ours.dtype.kind == "f")
    if isinstance(ours, dict):
        return ours.keys() == theirs.keys() and all(equal(ours[key], theirs[key]) for key in ours)
    if hasattr(ours, "__dataclass_fields__"):
        return equal(vars(ours), vars(theirs))
    return ours == theirs


@pytest.mark.parametrize("executor", [Remote(), ThreadPoolExecutor(2)], ids=["remote", "threads"])
def test_an_ensemble_is_the_same_bits_by_an_executor(executor: Executor) -> None:
    here, there = (run_ensemble(lasting(0.2), 100, 7, workers=workers) for workers in (1, executor))
    assert len(there) == 100
    assert equal(replace(there, ensemble=here.ensemble), here)
    if isinstance(executor, Remote):
        assert len(executor.sent) == 2


def test_controllers_are_compared_by_an_executor() -> None:
    contenders = {"paper": paper_controller(), "adrc": override(Experiment(), {"controller.kind": "adrc"}).controller}
    here, there = (compare(contenders, lasting(0.1), 70, 1, workers=workers) for workers in (2, Remote()))
    for name in contenders:
        assert equal(here.contenders[name].metrics, there.contenders[name].metrics)


def test_a_grid_of_gains_and_scenarios_is_the_same_bits_by_an_executor() -> None:
    """Portions that lack what other ones have run the same compiled code all the same."""
    names, gains = ["controller.observer.l0"], np.linspace(1.0, 20.0, 70)[:, np.newaxis]
    for scenarios in ([each for each in runs() if each != runs()[1]], lasting(0.2, "rig").chosen(range(3), 1)):
        here, there = (rollout(names, gains, scenarios, stride=50, workers=workers) for workers in (2, Remote()))
        assert equal(here, there)
    here, there = (
        sweep(runs()[0], {"controller.kind": ["nftsm", "adrc"]}, workers=workers) for workers in (2, Remote())
    )
    assert equal(here.metrics, there.metrics)


def test_sensitivities_are_the_same_bits_by_an_executor() -> None:
    names, values = ["plant.vehicle.mass"], [[1e4], [1.1e4]]
    scenarios = [runs()[0], runs()[2]]
    here, there = (
        sensitivities(names, values, scenarios, columns=["F1"], stride=20, workers=workers) for workers in (2, Remote())
    )
    assert equal(here, there)


def test_portions_suit_many_workers_and_are_worth_sending() -> None:
    assert [portion_of(runs) for runs in (1, 64, 1000, 20_000, 1_000_000)] == [64, 64, 64, 320, 512]


def test_results_come_in_order_and_an_interrupt_cancels_the_rest() -> None:
    assert list(in_order(iter([(2, "c"), (0, "a"), (1, "b")]))) == ["a", "b", "c"]
    executor = FirstOnly()
    found = spread(executor, abs, ((number,) for number in range(9)), at_once=3)
    assert next(found) == (0, 5)
    assert len(executor.futures) == 3
    found.close()
    assert [future.cancelled() for future in executor.futures] == [False, True, True]


def test_what_was_finished_is_kept_and_the_rest_is_computed(tmp_path: Path) -> None:
    """The same bits, on any worker and at any time; what differs in a seed, and what is damaged, is computed."""
    here = run_ensemble(lasting(0.1), 200, 4, workers=2)
    first, second, third = Remote(), Remote(), Remote()
    executor = CheckpointingExecutor(first, tmp_path / "kept")

    def end(done: float) -> None:
        if done > 0.5:
            raise ConnectionError

    with pytest.raises(ConnectionError):
        run_ensemble(lasting(0.1), 200, 4, workers=executor, progress=end)
    assert len(first.sent) == 4
    files = sorted((tmp_path / "kept").iterdir())
    assert len(files) == 2
    files[0].write_bytes(b"damaged")
    there = run_ensemble(lasting(0.1), 200, 4, workers=CheckpointingExecutor(second, tmp_path / "kept"))
    assert len(second.sent) == 3
    assert equal(here.metrics, there.metrics)
    assert equal(here.draws, there.draws)
    again = run_ensemble(lasting(0.1), 200, 4, workers=CheckpointingExecutor(third, str(tmp_path / "kept")))
    assert third.sent == []
    assert equal(here.metrics, again.metrics)
    run_ensemble(lasting(0.1), 64, 5, workers=CheckpointingExecutor(third, tmp_path / "kept"))
    assert len(third.sent) == 1
    (tmp_path / "file").touch()
    with pytest.raises(ConfigurationError, match="file: cannot be made"):
        CheckpointingExecutor(third, tmp_path / "file")


def test_the_key_of_a_task_is_that_of_equal_arguments_in_every_process() -> None:
    """Whatever the order of a set, and whichever strings are one object."""
    word = "plant.vehicle.mass"
    copy = "".join(list(word))
    first, second = frozenset([1, 9, 17]), frozenset([17, 9, 1])
    assert list(first) != list(second)
    calls = [(first, (word, word)), (second, (word, copy))]
    keys = {WorkerTask.of(max, *arguments).key(max, *arguments) for arguments in calls}
    assert len(keys) == 1
    task = WorkerTask.of(max, *calls[0])
    assert task.key(min, *calls[0]) not in keys
    assert replace(task, exact=True).key(max, *calls[0]) not in keys
    assert replace(task, versions={**task.versions, "numpy": "1.0"}).key(max, *calls[0]) not in keys


class Excluding(Executor):
    """Workers by their names, some of which cannot compile; these are asked first, until they are excluded."""

    def __init__(self, **can_compile: bool) -> None:
        self.can_compile, self.asked = can_compile, list[str]()

    def exclude(self, error: WorkerCompileError) -> None:
        del self.can_compile[error.worker]
        if not self.can_compile:
            raise error

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ARG002
        future: Future[Any] = Future()
        worker = min(self.can_compile, key=lambda name: self.can_compile[name])
        self.asked.append(worker)
        if self.can_compile[worker]:
            future.set_result(fn(*args))
        else:
            error = WorkerCompileError(f"worker on {worker}: no C compiler found")
            error.worker = worker
            future.set_exception(pickle.loads(pickle.dumps(error)))  # noqa: S301
        return future


def test_what_a_worker_cannot_compile_goes_to_another() -> None:
    executor = Excluding(a=False, b=True)
    assert dict(spread(executor, abs, ((-number,) for number in range(4)), at_once=1)) == {0: 0, 1: 1, 2: 2, 3: 3}
    assert list(spread(executor, abs, [(-9,)])) == [(0, 9)]
    assert executor.asked == ["a", *"bbbbb"]
    with pytest.raises(WorkerCompileError, match=r"^worker on d: no C compiler found$"):
        list(spread(Excluding(c=False, d=False), abs, [(-1,)], at_once=1))


def test_tasks_in_the_calling_thread_are_computed_and_stored_one_after_the_other(tmp_path: Path) -> None:
    """So that an error, or an interrupt, loses nothing that is finished."""
    executor = CheckpointingExecutor(SerialExecutor(), tmp_path)
    with pytest.raises(TypeError):
        list(spread(executor, abs, [(-1,), (-2,), ("three",)]))  # pyright: ignore[reportArgumentType]
    assert len(list(tmp_path.iterdir())) == 2
    assert list(spread(executor, abs, [(-2,), (-1,), (-4,)])) == [(0, 2), (1, 1), (2, 4)]


def test_another_version_of_the_product_or_of_a_part_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    sent = WorkerTask.of(abs, -1)
    assert run_task(sent) == 1
    with pytest.raises(WorkerError, match=r"worker on .*: has numpy .*, must be 1\.0; install the same"):
        run_task(replace(sent, versions={**sent.versions, "numpy": "1.0"}))
    plugin = tmp_path / "mine.py"
    plugin.write_text((EXAMPLES / "lqi_law.py").read_text().replace('"my-lqi"', '"lqi-travelling"'))
    load_plugin(str(plugin))
    name = next(name for name in sys.modules if name.startswith(f"{PLUGIN}mine"))
    carried = WorkerTask.of(abs, -1)
    assert name in [source.name for source in carried.sources]
    assert carried.key(abs, -1) == sent.key(abs, -1), "it has no part in the call"
    assert carried.key(len, "lqi-travelling") != sent.key(len, "lqi-travelling")
    assert run_task(carried) == 1
    changed = [replace(source, text=source.text + "\n") for source in carried.sources]
    with pytest.raises(WorkerError, match=r"has another version of mine\.py; restart the workers"):
        run_task(replace(carried, sources=tuple(changed)))
    monkeypatch.delitem(sys.modules, name)  # as on a worker that has never seen it
    assert run_task(carried) == 1
    assert sys.modules[name].__file__ == str(plugin)


def test_what_a_worker_cannot_do_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> None:
        raise CompilerNotFoundError("no C compiler found")

    monkeypatch.setattr("dualwinch.simulation.ensembles.run._run_portion", fail)
    with pytest.raises(WorkerError, match=r"^worker on \S+: no C compiler found$"):
        run_ensemble(lasting(0.1), 3, 0, workers=Remote())

    class Local:
        pass

    with pytest.raises(WorkerError, match=r"^workers: .*must be defined in a file$"):
        WorkerTask.of(abs, Local())
    task = WorkerTask.of(abs, 1)
    with pytest.raises(WorkerError, match=r"has no tests\.nowhere\.Law"):
        run_task(replace(task, digests=(("tests.nowhere", "Law", ""),)))
    assert tasks.versions() == task.versions


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="instruction sets of x86-64")
def test_processors_differ_in_no_bit_where_that_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without fused products where they are asked for; AVX2 and AVX-512 give the same bits in any case."""
    found = {}
    for processor in ("native", "haswell", "x86-64-v2"):
        monkeypatch.setenv("DUALWINCH_CC", f"gcc -march={processor}")
        for exact in ("0", "1"):
            monkeypatch.setenv("DUALWINCH_EXACT", exact)
            found[processor, exact] = run_ensemble(lasting(2.0, "rig"), 32, 3, traces=False).metrics
    assert equal(found["native", "0"], found["haswell", "0"])
    assert equal(found["native", "1"], found["haswell", "1"])
    assert equal(found["native", "1"], found["x86-64-v2", "1"])
    assert not equal(found["native", "0"], found["x86-64-v2", "0"])
    for name, values in found["native", "0"].items():
        np.testing.assert_allclose(found["x86-64-v2", "0"][name], values, rtol=1e-7)


SURROUNDINGS = """from __future__ import annotations
from functools import cache
import casadi as ca
import gains_beside_the_law

s = ca.SX.sym("s")
SQUARE = ca.Function("square", [s], [s**2])

@cache
def integral_gain():
    return float(SQUARE(gains_beside_the_law.ROOT))
"""
"""What a module of one's own may hold: text as annotations, expressions and caches, which no pickle can carry."""


def ensemble_with_own_law(folder: Path) -> Ensemble:
    """An ensemble with a law of one's own, from a file with another beside it."""
    plugin = folder / "own_law.py"
    (folder / "gains_beside_the_law.py").write_text("ROOT = 1.5\n")
    sys.modules.pop("gains_beside_the_law", None)  # that of another test is beside another file
    plugin.write_text(SURROUNDINGS + (EXAMPLES / "lqi_law.py").read_text().replace('"my-lqi"', '"lqi-carried"'))
    load_plugin(str(plugin))
    return reset(load_ensemble("sea"), {"controller.kind": "lqi-carried", "simulation.duration": 1.0})


@pytest.mark.slow
def test_processes_that_never_saw_a_part_compute_the_same_bits(tmp_path: Path) -> None:
    """A law of one's own, from files that no search path has, on two processes that begin with nothing."""
    ensemble = ensemble_with_own_law(tmp_path)
    here = run_ensemble(ensemble, 300, 3)
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        there = run_ensemble(ensemble, 300, 3, workers=pool)
    assert equal(here, there)
