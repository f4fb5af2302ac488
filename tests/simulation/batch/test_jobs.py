"""Work on threads: every item once, in order; what goes wrong is not lost."""

import threading

import pytest

from dualwinch.simulation.batch import workers
from dualwinch.simulation.batch.workers import map_all


def test_outcomes_are_in_the_order_of_the_items_whoever_finishes_first() -> None:
    second_done = threading.Event()

    def work(item: int) -> int:
        if item == 0:
            assert second_done.wait(10)
        if item == 1:
            second_done.set()
        return item**2

    assert map_all(work, range(5), threads=2) == [0, 1, 4, 9, 16]
    assert map_all(work, [], threads=2) == []


def test_errors_and_interrupts_come_through(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ZeroDivisionError):
        map_all(lambda item: 1 / item, [1, 0])
    monkeypatch.setattr(workers, "run_all", lambda *_: False)
    with pytest.raises(KeyboardInterrupt):
        map_all(str, [1])
