"""What is built of expressions: once, and on one thread at a time, for CasADi keeps no two apart."""

import time
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

from dualwinch.codegen.source.expressions import as_written, built_once

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
