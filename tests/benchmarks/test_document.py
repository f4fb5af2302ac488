"""What tables in documents are made of."""

from benchmarks.document import times


def test_ratios_have_three_digits_and_no_exponent() -> None:
    assert [times(ratio) for ratio in (0.0123456, 48.123, 999.9, 1416.0, 40_900.0)] == [
        "0.0123 ×",
        "48.1 ×",
        "1 000 ×",
        "1 420 ×",
        "40 900 ×",
    ]
