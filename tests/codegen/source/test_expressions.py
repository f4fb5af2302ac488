"""What is built of expressions: once, on one thread at a time, and kept within a number of instructions."""

import time
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import casadi as ca

from dualwinch.codegen.source.expressions import GraphCache, as_written, built_once

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


def test_what_was_used_longest_ago_goes_where_it_is_too_much() -> None:
    graphs, built = GraphCache(limit=2500), []

    @graphs.cached
    def build(number: int) -> ca.Function:
        built.append(number)
        return graph_of(1000)

    first = build(0)
    build(1)
    assert build(0) is first
    assert 2000 <= graphs.size < 2500
    build(2)  # in the place of 1
    assert build(0) is first
    assert graphs.size < 2500
    assert build(1)(0.5) == first(0.5)
    assert built == [0, 1, 2, 1]
