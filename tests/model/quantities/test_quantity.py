from dataclasses import replace
from typing import Any

import annotated_types as at
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.model.quantities.quantity import (
    MOST_LISTED,
    Leaf,
    Mark,
    Quantity,
    behind_number,
    nearest,
    suggestion,
    unknown,
)
from dualwinch.simulation.settings import known_keys

SIZE = Leaf("inner.size", Quantity("m", "size", "Table 1"), float, constraints=(at.Gt(0), at.Le(2)))
COUNT = Leaf("inner.count", Quantity("1", "count"), int, optional=True, constraints=(at.Ge(1),))
KIND = Leaf("kind", Quantity("", "kind"), str, choices=("a", "b"))
ON = Leaf("on", Quantity("", "switch"), bool)


@pytest.mark.parametrize(
    ("leaf", "words"), [(KIND, '"a" or "b"'), (ON, "true or false"), (SIZE, "> 0 and <= 2"), (COUNT, ">= 1")]
)
def test_allowed_range_in_words(leaf: Leaf, words: str) -> None:
    assert leaf.allowed == words


@pytest.mark.parametrize(
    ("leaf", "words"),
    [
        (KIND, '"a" or "b"'),
        (ON, "true or false"),
        (SIZE, "a finite number > 0 and <= 2 m"),
        (COUNT, "a whole number >= 1"),
        (Leaf("free", Quantity("1", "anything"), float), "a finite number"),
    ],
)
def test_what_a_value_must_be_in_words(leaf: Leaf, words: str) -> None:
    assert leaf.wanted == words


@pytest.mark.parametrize(
    ("leaf", "allowed", "refused"),
    [
        (SIZE, [2, 2.0, 5e-324], [0, 2.0000001, -1.0, True, "1", None, float("nan"), [1.0]]),
        (COUNT, [1, 10**30, None], [0, 1.0, True, "1"]),
        (KIND, ["a", "b"], ["c", "", None, 1, ["a"]]),
        (ON, [True, False], [0, 1, None, "true"]),
        (Leaf("strict", Quantity("1", "open"), float, constraints=(at.Ge(-1), at.Lt(1))), [-1, 0.999], [-1.1, 1]),
    ],
)
def test_bounds_and_type_admit_a_value(leaf: Leaf, allowed: list[Any], refused: list[Any]) -> None:
    assert [value for value in allowed if not leaf.admits(value)] == []
    assert [value for value in refused if leaf.admits(value)] == []


def test_ends_of_the_range() -> None:
    assert (SIZE.bounds, COUNT.bounds, ON.bounds) == ((0, 2), (1, float("inf")), (0, 1))
    assert Leaf("free", Quantity("1", "anything"), float).bounds == (-float("inf"), float("inf"))


@given(st.floats(-100, 100), st.floats(1e-3, 100), st.sampled_from([at.Gt, at.Ge]), st.sampled_from([at.Lt, at.Le]))
def test_some_value_is_allowed(lower: float, width: float, above: Any, below: Any) -> None:
    leaf = replace(SIZE, constraints=(above(lower), below(lower + width)))
    assert leaf.admits(leaf.some_value)
    assert leaf.some_value == replace(leaf, key="other").some_value


@pytest.mark.parametrize("least", [-3, 0, 7])
def test_some_whole_number_is_allowed(least: int) -> None:
    for constraint in (at.Ge(least), at.Gt(least)):
        leaf = replace(COUNT, constraints=(constraint,))
        assert leaf.admits(leaf.some_value)


def test_where_no_number_is_allowed_there_is_none_to_take() -> None:
    with pytest.raises(ValueError, match="no simple number is > 1 and < 1"):
        _ = replace(SIZE, constraints=(at.Gt(1), at.Lt(1))).some_value


@pytest.mark.parametrize(
    ("leaf", "is_number", "shapes_code"),
    [
        (SIZE, True, False),
        (COUNT, True, False),
        (KIND, False, True),
        (ON, False, True),
        (replace(ON, marks=frozenset({Mark.SWITCH})), True, False),
        (replace(COUNT, marks=frozenset({Mark.SHAPES_CODE})), False, True),
        (replace(SIZE, marks=frozenset({Mark.DRAWN_AHEAD})), False, False),
        (replace(SIZE, marks=frozenset({Mark.TIMING})), True, False),
    ],
)
def test_what_is_a_number_at_run_time_and_what_shapes_the_code(leaf: Leaf, is_number: bool, shapes_code: bool) -> None:
    assert (leaf.is_number, leaf.shapes_code) == (is_number, shapes_code)


def test_the_nearest_key_is_near_as_a_whole_or_in_its_last_part() -> None:
    keys = ["plant.vehicle.mass", "controller.nftsm.beta", "simulation.sample_time"]
    assert nearest("plant.vehicle.mas", keys) == ["plant.vehicle.mass"]
    assert nearest("btea", keys) == ["controller.nftsm.beta"]
    assert nearest("controller.beta", keys, 2) == ["controller.nftsm.beta", "plant.vehicle.mass"]


def test_the_nearest_key_is_one_of_the_same_section() -> None:
    keys = [*known_keys()]
    assert nearest("reference.path", keys) == ["reference.points"]
    assert nearest("disturbance.amplitude", keys) == ["disturbance.vortex_amplitude"]
    assert nearest("plant.vehicle.modulus", keys)[0].startswith("plant.rope_")


def test_a_pure_number_has_nothing_behind_it() -> None:
    assert f"3{behind_number('1')} 3{behind_number('N m')}" == "3 3 N m"


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
