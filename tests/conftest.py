"""Settings of the property tests, and the runs that several tests look at, each done once."""

import gc
import math
import os
import shlex
from collections.abc import Callable, Generator, Iterator
from functools import cache
from time import process_time
from typing import Protocol

import numpy as np
import pytest
from hypothesis import settings
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from dualwinch.model.quantities.part import registries
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.simulate import simulate
from tests.oracle.sampled import Scenario, run
from tests.tiers import COLLECTED, FULL, QUICK, too_long

# Threads of linear algebra take turns with other workers on the cores, and wait by spinning: tests of linear loops took
# twice the processor time. The variable is for libraries that are loaded later, as SciPy's, and for other processes.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
threadpool_limits(1, user_api="blas")

settings.register_profile("quick", derandomize=True, deadline=None, database=None, max_examples=QUICK)
settings.register_profile("full", settings.get_profile("quick"), max_examples=FULL)
settings.load_profile("quick")


def pytest_addoption(parser: pytest.Parser) -> None:
    """``--attack 50``: the tests in ``tests/attack`` try so many times as much; ``--longest 1.5``: see below."""
    parser.addoption("--attack", type=int, default=1, help="how many times as hard tests/attack attacks as by default")
    words = "an unmarked test that takes more processor time than this, compilers not counted, fails"
    parser.addoption("--longest", type=float, default=math.inf, metavar="SECONDS", help=words)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """``--longest 1.5``: a quick test that takes longer fails."""
    limit, begin = float(item.config.getoption("longest") or math.inf), process_time()
    result = yield
    words = too_long(process_time() - begin, limit, (mark.name for mark in item.iter_markers()))
    if words:
        pytest.fail(words, pytrace=False)
    return result


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep what is collected before anything is deselected, for ``tests/test_tiers.py``."""
    config.stash[COLLECTED] = list(items)


def pytest_collection_finish() -> None:
    """Tests and modules stay to the end: the garbage collector does not go through them again and again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def registered_for_this_test_only() -> Iterator[None]:
    """Parts that a test registers are gone after it."""
    before = [(registry, dict(registry)) for registry in registries()]
    yield
    for registry, parts in before:
        registry._parts = parts


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine on which no C compiler is found."""
    monkeypatch.setenv("PATH", "/nonexistent/either")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.delenv("DUALWINCH_CC", raising=False)
    monkeypatch.setattr("dualwinch.codegen.compiler._zig", lambda: None)


def exit_code(*words: object) -> int:
    """Run the command line; its exit code."""
    from dualwinch.cli import main

    try:
        main([str(word) for word in words])
    except SystemExit as ended:
        return int(ended.code or 0)
    return 0


Refused = Callable[..., str]


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Refused:
    """``refused("simulate --case 5")``: the error line of a command that ends with an exit code, by default 2.

    Before that line stands at most what the command says of its phases.
    """
    from dualwinch.cli import main

    def line(words: str, *further: object, code: int = 2) -> str:
        command, *_ = arguments = [*shlex.split(words), *map(str, further)]
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        error = capsys.readouterr().err
        assert ended.value.code == code, error
        *phases, last = error.splitlines()
        assert last.startswith("dualwinch: error: ")
        assert "unforeseen" not in last
        assert len(last) < 1600
        assert all(phase.startswith(f"{command}: ") for phase in phases), error
        return last

    return line


PaperRun = Callable[[int, str], Result]


class OracleRun(Protocol):
    """``oracle_run(case, controller, samples)``: columns of as many samples of it, or of the whole case."""

    def __call__(self, number: int, kind: str, samples: int | None = None) -> dict[str, NDArray[np.float64]]: ...


@pytest.fixture(scope="session")
def paper_run() -> PaperRun:
    """``paper_run(case, controller)``: a paper case as the product runs it by default."""

    @cache
    def result(number: int, kind: str) -> Result:
        return simulate(case(number, kind))

    return result


@pytest.fixture(scope="session")
def oracle_run() -> OracleRun:
    """A paper case as the independent implementation runs it, each once."""

    @cache
    def columns(number: int, kind: str, samples: int) -> dict[str, NDArray[np.float64]]:
        return run(Scenario(kind, number), samples)

    def of_case(number: int, kind: str, samples: int | None = None) -> dict[str, NDArray[np.float64]]:
        return columns(number, kind, samples or (25_000 if number in {1, 3} else 50_000))

    return of_case
