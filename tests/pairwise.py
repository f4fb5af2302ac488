"""Pairwise covering arrays: few combinations in which every pair of values occurs.

Most faults that depend on a combination depend on two values of it (Kuhn, Wallace and Gallo, "Software fault
interactions and implications for software testing", IEEE Trans. Software Engineering 30(6), 2004).
"""

from collections.abc import Callable, Iterable
from itertools import combinations, product
from typing import Any

Row = tuple[Any, ...]


def pairs(row: Row) -> set[tuple[int, int, Any, Any]]:
    """The pairs of values in a combination, with the two factors that each is of."""
    return {(i, j, row[i], row[j]) for i, j in combinations(range(len(row)), 2)}


def covering_array(*factors: Iterable[Any], allowed: Callable[..., bool] = lambda *_: True) -> list[Row]:
    """Combinations, one value of each factor, that contain every pair of values that an allowed combination has.

    Greedy: the combination with most pairs that no earlier one has comes next, the first of several.
    """
    rows = {row: pairs(row) for row in product(*factors) if allowed(*row)}
    uncovered = set().union(*rows.values())
    chosen = []
    while uncovered:
        best = max(rows, key=lambda row: len(rows[row] & uncovered))
        chosen.append(best)
        uncovered -= rows[best]
    return chosen
