import casadi as ca
import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Elements, Mark, Quantity, elements, is_array, rebuilt

MATRIX = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])


@pytest.mark.parametrize(
    "value", [np.zeros(2), np.zeros(1), MATRIX, ca.SX.sym("z", 2), ca.MX.sym("z", 1, 2), ca.DM(MATRIX)]
)
def test_vectors_and_matrices_are_arrays(value: object) -> None:
    assert is_array(value)


@pytest.mark.parametrize("value", [1.0, np.float64(1.0), np.array(1.0), ca.SX.sym("z"), ca.DM(1.0), None, "word"])
def test_scalars_are_not(value: object) -> None:
    assert not is_array(value)


def test_elements_are_named_by_their_places_row_by_row() -> None:
    assert elements(np.array([7.0, 8.0])) == {".0": 7, ".1": 8}
    assert elements(MATRIX) == {".0.0": 1, ".0.1": 2, ".0.2": 3, ".1.0": 4, ".1.1": 5, ".1.2": 6}
    assert elements(np.array([[7.0, 8.0]])) == {".0.0": 7, ".0.1": 8}
    assert elements(np.array([7.0])) == elements(np.array([[7.0]])) == {"": 7}


@pytest.mark.parametrize("value", [MATRIX, MATRIX.T, MATRIX[0], MATRIX[:1], MATRIX[:, :1], MATRIX[0, :1]])
def test_numbers_and_symbols_have_the_same_elements_and_come_together_again(value: np.ndarray) -> None:
    found = elements(value)
    again = rebuilt(value, found.__getitem__)
    assert again.shape == value.shape
    assert np.array_equal(again, value)
    symbols = ca.SX.sym("z", *value.reshape(value.shape[0], -1).shape)
    if value.size > 1:
        assert list(elements(symbols)) == list(found)
    symbolic = rebuilt(value, {end: symbols[place] for end, place in zip(found, places(symbols), strict=True)}.get)
    assert ca.is_equal(symbolic, symbols)


def places(symbols: ca.SX) -> list[tuple[int, int]]:
    return [(row, column) for row in range(symbols.rows()) for column in range(symbols.columns())]


def test_elements_that_are_not_alike_are_told_apart() -> None:
    x, v = Quantity("m", "position"), Quantity("m/s", "speed")
    each = Elements((x, Mark.POSITION), v)
    assert (each.quantities, each.marks) == ((x, v), (frozenset({Mark.POSITION}), frozenset()))
    assert each == Elements((x, Mark.POSITION), (v,))
    assert hash(each) == hash(Elements((x, Mark.POSITION), (v,)))
    for wrong in [(), ((Mark.POSITION,), v), ((x, v),), ("m",)]:
        with pytest.raises(
            ConfigurationError, match=r"^Elements: must be one Quantity for each element, or a tuple of"
        ):
            Elements(*wrong)  # pyright: ignore[reportArgumentType]


def test_a_single_symbol_among_numbers_makes_the_array_symbolic() -> None:
    z = ca.SX.sym("z")
    mixed = rebuilt(MATRIX, (elements(MATRIX) | {".1.2": z}).__getitem__)
    assert mixed.shape == (2, 3)
    assert ca.is_equal(mixed[1, 2], z)
    assert float(mixed[1, 0]) == 4
