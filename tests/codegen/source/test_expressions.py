"""What is built of expressions: once, on one thread at a time, and kept within a number of bytes."""

import os
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import casadi as ca
import numpy as np
import pytest

from dualwinch.codegen.source.expressions import GRAPHS, GraphCache, as_written, built_once
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.laws.nftsm import Nftsm
from dualwinch.controllers.laws.pid_cascade import PidCascade
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.simulate import simulate

THREADS = 4


def test_threads_that_ask_at_once_get_the_same_which_one_of_them_has_built() -> None:
    inside, most, built = 0, 0, 0

    @built_once
    def build(number: int, *, name: str = "x") -> tuple[int, str]:
        nonlocal inside, most, built
        inside, built = inside + 1, built + 1
        most = max(most, inside)
        time.sleep(0.02)  # without a lock another thread has its turn here
        inside -= 1
        return number, name

    start = Barrier(THREADS)

    def ask(index: int) -> tuple[int, str]:
        start.wait()
        return build(index % 2, name="a")

    with ThreadPoolExecutor(THREADS) as pool:
        found = list(pool.map(ask, range(THREADS)))
    assert (built, most) == (2, 1)
    assert found[0] is found[2]
    assert found[1] == (1, "a")


def test_what_is_built_as_written_may_build_more() -> None:
    @built_once
    def inner() -> str:
        with as_written():
            return "inner"

    @built_once
    def outer() -> str:
        return inner()

    assert outer() == "inner"


def graph_of(instructions: int) -> ca.Function:
    """A function of about so many instructions."""
    x = ca.SX.sym("x")
    value = x
    for _ in range(instructions // 2):
        value = ca.sin(value) + x
    return ca.Function("graph", [x], [value])


def test_what_was_used_longest_ago_goes_where_the_bytes_do_not_suffice() -> None:
    graphs, built = GraphCache(limit=250_000, per_instruction=100), []

    @graphs.cached
    def build(number: int) -> ca.Function:
        built.append(number)
        return graph_of(1000)

    first = build(0)
    build(1)
    assert build(0) is first
    assert 200_000 < graphs.size < 250_000
    build(2)  # in the place of 1
    assert build(0) is first
    assert len(graphs) == 2
    assert graphs.size < 250_000
    assert build(1)(0.5) == first(0.5)
    assert built == [0, 1, 2, 1]


def test_the_last_result_stays_however_large_it_is() -> None:
    graphs = GraphCache(limit=1000)
    build = graphs.cached(graph_of)
    build(100)
    assert build(200) is build(200)
    assert len(graphs) == 1
    assert graphs.size > graphs.limit


def test_a_function_that_several_results_have_counts_once() -> None:
    graphs = GraphCache(per_instruction=1000)
    build = graphs.cached(graph_of)
    pair = graphs.cached(lambda function: {"same": (function, function)})
    function = build(1000)
    alone = graphs.size
    pair(function)
    assert alone <= graphs.size < 1.01 * alone
    graphs.limit = alone  # the pair stays, and the function with it
    pair(graph_of(10))
    assert len(graphs) == 1
    assert graphs.size < 0.1 * alone


def test_a_solver_counts_with_the_derivatives_of_its_problem() -> None:
    graphs, x = GraphCache(per_instruction=100), ca.SX.sym("x", 50)
    cost = ca.sum1(ca.sin(x) ** 2)

    @graphs.cached
    def solver() -> ca.Function:
        return ca.nlpsol("solver", "ipopt", {"x": x, "f": cost, "g": ca.cos(x)}, {"print_time": False})

    derivatives = [solver().get_function(name) for name in ("nlp_grad_f", "nlp_jac_g", "nlp_hess_l")]
    assert graphs.size > 100 * sum(function.n_instructions() for function in derivatives)


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="no /proc")
def test_the_estimate_is_not_below_what_the_process_grows_by() -> None:
    def resident() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    graphs = GraphCache()
    before = resident()
    graphs.cached(graph_of)(100_000)
    assert resident() - before < graphs.size


def test_runs_of_many_structures_keep_the_graphs_of_the_latest(monkeypatch: pytest.MonkeyPatch) -> None:
    """And those that are built anew give the same run."""
    laws = [FandoNftsm(), Nftsm(), PidCascade(), FandoNftsm()]
    runs, kept = [], []
    monkeypatch.setattr(GRAPHS, "limit", 20_000_000)  # of one structure and a half
    GRAPHS.clear()  # of what other tests built
    for law in laws:
        runs.append(simulate(Experiment(controller=Controller(law=law), simulation=Simulation(duration=0.1))))
        kept.append(GRAPHS.size)
    assert max(kept) <= GRAPHS.limit
    for name, column in runs[0].columns.items():
        np.testing.assert_array_equal(column, runs[-1].columns[name])
