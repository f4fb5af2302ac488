from itertools import combinations, product

import pytest

from tests.pairwise import covering_array

FACTORS = [range(12), range(5), range(3), range(2)]


@pytest.mark.parametrize("factors", [FACTORS, FACTORS[:2], FACTORS[::-1]], ids=len)
def test_every_pair_of_values_occurs(factors: list[range]) -> None:
    array = covering_array(*factors)
    for i, j in combinations(range(len(factors)), 2):
        assert {(row[i], row[j]) for row in array} == set(product(factors[i], factors[j]))


def test_it_is_much_smaller_than_the_product() -> None:
    array = covering_array(*FACTORS)
    assert len(array) < 1.2 * 12 * 5 < 12 * 5 * 3 * 2 / 4
    assert len(set(array)) == len(array)


def test_what_is_not_allowed_is_in_no_row_and_every_other_pair_is() -> None:
    def allowed(first: int, second: int, third: int) -> bool:
        return (first, second) != (0, 0) and first + third < 12

    array = covering_array(range(12), range(5), range(3), allowed=allowed)
    every = [row for row in product(range(12), range(5), range(3)) if allowed(*row)]
    assert all(allowed(*row) for row in array)
    for i, j in combinations(range(3), 2):
        assert {(row[i], row[j]) for row in array} == {(row[i], row[j]) for row in every}
