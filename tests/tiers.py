"""What of a test runs in which tier.

The quick tier is what ``pytest`` runs by itself; the others have the markers ``slow`` and ``external``.
"""

from collections.abc import Callable, Iterable
from itertools import product
from typing import Any

import pytest
from hypothesis import settings

from tests.pairwise import covering_array

QUICK, FULL = 15, 100
"""Examples of a property test, by the Hypothesis profiles of these names."""

COLLECTED = pytest.StashKey[list[pytest.Item]]()
"""All tests that were collected, before those of other tiers are deselected."""


def too_long(seconds: float, limit: float, markers: Iterable[str]) -> str:
    """What is wrong with a quick test that takes so much processor time; empty for those in another tier."""
    if seconds <= limit or {"slow", "external"} & {*markers}:
        return ""
    return f"{seconds:.1f} s of processor time, more than {limit:g} s: make it shorter, or mark it slow"


def in_full() -> bool:
    """Whether property tests try all of their examples (profile ``full``); to be asked outside of them."""
    return settings().max_examples == FULL


def examples(full: int, **words: Any) -> settings:
    """``@examples(60)``: so many in the profile ``full``; in ``quick`` not more than its number there.

    The words are those of `hypothesis.settings`.
    """
    return settings(max_examples=full if in_full() else min(full, settings().max_examples), **words)


def pairwise(*factors: Iterable[Any], allowed: Callable[..., bool] = lambda *_: True) -> list[Any]:
    """Parameters of a test for every combination of the factors; those beyond a pairwise covering array are slow."""
    quick = covering_array(*factors, allowed=allowed)
    return mostly_slow((row for row in product(*factors) if allowed(*row)), quick.__contains__)


def each_choice(*factors: Iterable[Any]) -> list[Any]:
    """Parameters of a test for every combination; as many as the longest factor has, with every value, are quick.

    The *each choice* of combinatorial testing, where a combination is costly and another test has the pairs.
    """
    values = [list(factor) for factor in factors]
    quick = {tuple(factor[turn % len(factor)] for factor in values) for turn in range(max(map(len, values)))}
    return mostly_slow(product(*values), quick.__contains__)


def choice_of_pairs(*factors: Iterable[Any]) -> list[Any]:
    """Parameters of a test for a pairwise covering array; few rows of it that have every value once are quick.

    Where a combination is costly and nothing asks for all of them. The row with most values that no earlier one has
    comes next; of several, that whose values come first among theirs, as registries begin with what is simple.
    """
    values = [list(factor) for factor in factors]
    rows, quick = covering_array(*values), list[tuple[Any, ...]]()
    unseen = {each for row in rows for each in enumerate(row)}

    def worth(row: tuple[Any, ...]) -> tuple[int, int]:
        return len(unseen.intersection(enumerate(row))), -sum(map(list.index, values, row))

    while unseen:
        quick.append(max(rows, key=worth))
        unseen.difference_update(enumerate(quick[-1]))
    return mostly_slow(rows, quick.__contains__)


def all_but(quick: Iterable[Any], values: Iterable[Any]) -> list[Any]:
    """Parameters of a test of one argument; slow are all but the quick ones."""
    chosen = list(quick)
    return [value if value in chosen else pytest.param(value, marks=pytest.mark.slow) for value in values]


def mostly_slow(rows: Iterable[tuple[Any, ...]], quick: Callable[[tuple[Any, ...]], bool]) -> list[Any]:
    """Parameters of a test, of which all but the quick ones are slow."""
    return [pytest.param(*row, marks=[] if quick(row) else pytest.mark.slow) for row in rows]
