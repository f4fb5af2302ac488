import pytest

from dualwinch.model.quantities.tables import relative


@pytest.mark.parametrize(
    ("deviation", "value", "words"),
    [
        (0.012, 1e3, "0.0012%"),
        (1.234, -1e3, "0.12%"),
        (99.7, 100.0, "100%"),
        (123.4, 1e3, "12%"),
        (2.0, 1.0, ""),
        (1.0, 0.0, ""),
    ],
)
def test_a_relative_deviation_has_two_significant_digits(deviation: float, value: float, words: str) -> None:
    assert relative(deviation, value) == words
