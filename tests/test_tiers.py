from collections.abc import Iterable
from itertools import product
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.tiers import COLLECTED, FULL, QUICK, choice_of_pairs, each_choice, examples, pairwise, too_long


def test_a_file_with_slow_tests_has_a_quick_one(request: pytest.FixtureRequest) -> None:
    slow, quick = set[Path](), set[Path]()
    for item in request.config.stash[COLLECTED]:
        if not item.get_closest_marker("external"):
            (slow if item.get_closest_marker("slow") else quick).add(item.path)
    assert quick
    assert not slow - quick


def test_slow_combinations_are_those_beyond_the_covering_array() -> None:
    parameters = pairwise("abcd", "pqr", "xyz")
    assert [each.values for each in parameters] == [(a, b, c) for a in "abcd" for b in "pqr" for c in "xyz"]
    quick = [each.values for each in parameters if not each.marks]
    assert 12 <= len(quick) <= 14
    assert {values[:2] for values in quick} == {(a, b) for a in "abcd" for b in "pqr"}


def test_a_choice_of_pairs_has_every_pair_and_every_value_is_quick() -> None:
    parameters = choice_of_pairs("abcd", "pqr", "xy")
    assert {row.values[:2] for row in parameters} == set(product("abcd", "pqr"))
    quick = [row.values for row in parameters if not row.marks]
    assert [set(values) for values in zip(*quick, strict=True)] == [set("abcd"), set("pqr"), set("xy")]
    assert len(quick) < len(parameters)


def test_each_choice_has_every_value_once_or_more() -> None:
    parameters = each_choice("abcd", "pqr")
    assert len(parameters) == 12
    assert [each.values for each in parameters if not each.marks] == [("a", "p"), ("b", "q"), ("c", "r"), ("d", "p")]


@pytest.mark.parametrize(("full", "quick"), [(10, 10), (60, QUICK), (FULL, QUICK), (3 * FULL, QUICK)])
def test_quick_examples_are_fewer(full: int, quick: int) -> None:
    expected = full if settings().max_examples == FULL else quick
    tried = []

    @examples(full)
    @given(st.integers())
    def counted(number: int) -> None:
        tried.append(number)

    counted()
    assert len(tried) == expected


@pytest.mark.parametrize(
    ("seconds", "markers", "wrong"),
    [
        (1.4, (), False),
        (1.6, (), True),
        (1.6, ("parametrize",), True),
        (1.6, ("slow",), False),
        (9.0, ["external"], False),
    ],
)
def test_a_quick_test_that_takes_long_fails(seconds: float, markers: Iterable[str], wrong: bool) -> None:
    assert bool(too_long(seconds, 1.5, markers)) is wrong
