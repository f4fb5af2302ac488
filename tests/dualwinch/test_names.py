"""An error about a name that there is not says which is the nearest, and what there is: the same for every kind."""

import pytest

from dualwinch.model.quantities.quantity import MOST_LISTED, suggestion, unknown


def test_long_lists_are_cut_to_the_nearest() -> None:
    many = [f"name_{number}" for number in range(MOST_LISTED + 1)]
    assert unknown("name", "nam_3", many).startswith(
        "unknown name 'nam_3'; did you mean 'name_3'? The nearest of 25 are"
    )
    assert suggestion("nam_3", many[:2]) == "did you mean 'name_1'? Must be one of name_0, name_1"
    assert suggestion("anything", []) == "there is none"


@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("foo", ["controller.observer.kf", "plant.vehicle.mass"]),
        ("controller.observer.l0", ["plant.track.tilt", "plant.vehicle.mass"]),
        ("nope", ["fando-nftsm", "rbf-sliding-mode"]),
        ("5", ["1", "2", "3", "4"]),
        ("name", ["plant.rope_2.diameter"]),
        ("", ["x"]),
    ],
)
def test_a_name_that_is_far_from_all_is_not_guessed(name: str, known: list[str]) -> None:
    assert suggestion(name, known) == f"must be one of {', '.join(known)}"
    many = known + [f"key_{number}" for number in range(100, 200)]
    assert suggestion(name, many, "; see the list").startswith(f"the nearest of {len(many)} are ")
