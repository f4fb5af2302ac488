"""Tables of searches, from made-up scores."""

from benchmarks.document import times
from benchmarks.scored import Point, Score

SCORE = Score(
    paper=Point(
        "paper", 60.0, mse=1e-7, within_authority=5e-8, median=4e-8, largest=6100.0, smallest=0.0, slack="9 of 9"
    ),
    tuned=(
        Point(
            "0.1", 6.0, mse=2e-9, within_authority=5e-10, median=4e-10, largest=5900.4, smallest=250.0, slack="0 of 9"
        ),
        Point(
            "0.25", 15.0, mse=1e-9, within_authority=1e-10, median=8e-11, largest=5901.0, smallest=240.0, slack="1 of 9"
        ),
    ),
    least=4e-10,
)


def test_ratios_have_three_digits_and_no_exponent() -> None:
    assert [times(ratio) for ratio in (0.0123456, 48.123, 999.9, 1416.0, 40_900.0)] == [
        "0.0123 ×",
        "48.1 ×",
        "1 000 ×",
        "1 420 ×",
        "40 900 ×",
    ]


def test_the_table_gives_ratios_to_the_papers_gains() -> None:
    head, _, first, second = SCORE.table("allowed").splitlines()
    assert head.startswith("| allowed | chatter over the paper's |")
    assert first == "| 0.1 | 0.10 | 50 × | 250 × | 100 × | 100 × | 5900 | 250 | 0 of 9 |"
    assert second == "| 0.25 | 0.25 | 100 × | 250 × | 500 × | 500 × | 5901 | 240 | 1 of 9 |"
