from dataclasses import dataclass, field
from typing import Annotated, Literal

import annotated_types as at
import pytest

from dualwinch.model.quantity import Quantity, behind_number
from dualwinch.model.tree import describe, leaves, numbers, with_leaves


@dataclass(frozen=True)
class Inner:
    size: Annotated[float, at.Gt(0), at.Le(2), Quantity("m", "size", "Table 1")] = 1.0
    count: Annotated[int | None, at.Ge(1), Quantity("1", "count")] = None


@dataclass(frozen=True)
class Outer:
    kind: Annotated[Literal["a", "b"], Quantity("", "kind")] = "a"
    on: Annotated[bool, Quantity("", "switch")] = False
    inner: Inner = field(default_factory=Inner)


def test_every_scalar_is_described_by_its_dotted_key() -> None:
    assert list(describe(Outer)) == ["kind", "on", "inner.size", "inner.count"]
    size = describe(Outer)["inner.size"]
    assert (size.quantity.unit, size.kind, size.optional) == ("m", float, False)
    assert describe(Outer)["inner.count"].optional


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("kind", '"a" or "b"'),
        ("on", "true or false"),
        ("inner.size", "> 0 and <= 2"),
        ("inner.count", ">= 1"),
    ],
)
def test_allowed_range_in_words(key: str, words: str) -> None:
    assert describe(Outer)[key].allowed == words


def test_taken_apart_and_put_together_again() -> None:
    changed = Outer("b", on=True, inner=Inner(0.5, 3))
    assert with_leaves(Outer(), leaves(changed)) == changed


def test_only_the_named_scalars_change() -> None:
    assert with_leaves(Outer(), {"x.inner.size": 2.0}, "x.") == Outer(inner=Inner(2.0))
    assert with_leaves(Outer(), {"no.such": 2.0}) == Outer()


def test_numbers_leave_out_choices_and_what_is_not_given() -> None:
    assert numbers(Outer(), "p.") == {"p.inner.size": 1.0}


def test_a_scalar_without_a_quantity_is_an_error() -> None:
    @dataclass(frozen=True)
    class Bare:
        size: float = 1.0

    with pytest.raises(TypeError, match=r"Bare\.size has no Quantity"):
        describe(Bare)


def test_a_pure_number_has_nothing_behind_it() -> None:
    assert f"3{behind_number('1')} 3{behind_number('N m')}" == "3 3 N m"
