from hypothesis import given
from hypothesis import strategies as st

from dualwinch.toolboxes.stress.sizes import HIGHEST, LOWEST, STEPS, Bisection, decades, size


def finished(search: Bisection, breaks) -> Bisection:
    for _ in range(100):
        wanted = search.wanted()
        if not wanted:
            return search
        assert not set(wanted) & set(search.outcomes)
        search.outcomes |= {step: breaks(step) for step in wanted}
    raise AssertionError("the search never ends")


def test_sizes() -> None:
    assert [size(step) for step in (LOWEST, -STEPS, 0, HIGHEST)] == [1e-3, 0.1, 1.0, 100.0]
    assert decades(LOWEST, HIGHEST) == [-24, -16, -8, 0, 8, 16]
    assert decades(LOWEST, 3) == [-24, -16, -8, 0, 3]
    assert decades(0, 0) == [0]
    assert decades(LOWEST, LOWEST - 1) == []


@given(threshold=st.integers(LOWEST, HIGHEST + 1), top=st.integers(LOWEST, HIGHEST))
def test_a_monotone_break_is_found_to_a_rung(threshold: int, top: int) -> None:
    search = finished(Bisection(LOWEST, top), lambda step: step >= threshold)
    if threshold > top:
        assert (search.breakdown, search.held) == (None, top)
    else:
        assert search.breakdown == threshold
        assert search.held == (threshold - 1 if threshold > LOWEST else None)
    assert search.monotone
    assert len(search.outcomes) <= 6 + 3


@given(breakdowns=st.sets(st.integers(LOWEST, HIGHEST)))
def test_of_other_breakdowns_the_smallest_tried_is_told(breakdowns: set[int]) -> None:
    search = finished(Bisection(LOWEST, HIGHEST), breakdowns.__contains__)
    tried = [step for step in search.outcomes if step in breakdowns]
    assert search.breakdown == (min(tried) if tried else None)
    if tried:
        larger = [step for step in search.outcomes if step > min(tried)]
        assert search.monotone == all(step in breakdowns for step in larger)


def test_nothing_is_tried_where_nothing_is_allowed() -> None:
    search = finished(Bisection(LOWEST, LOWEST - 1), lambda _: True)
    assert (search.breakdown, search.held, search.outcomes) == (None, None, {})
