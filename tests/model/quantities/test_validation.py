from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

import annotated_types as at
import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.part import Part, PartChoice, Registry
from dualwinch.model.quantities.quantity import Quantity, Rule
from dualwinch.model.quantities.tree import check_rules, check_values, shown, validated


@dataclass(frozen=True)
class Range:
    lower: Annotated[float, at.Ge(0), Quantity("N", "lower end")] = 1.0
    upper: Annotated[float, Quantity("N", "upper end")] = 2.0
    steps: Annotated[int | None, at.Ge(1), Quantity("1", "steps in between")] = None

    rules: ClassVar = (
        Rule(
            ("lower", "upper"),
            lambda group: group.lower < group.upper,
            lambda group, table: f"must be < {table}upper = {group.upper:g} N",
        ),
    )


@dataclass(frozen=True)
class Gauge(Part):
    scale: Annotated[float, at.Gt(0), Quantity("1", "scale")] = 1.0
    range: Range = field(default_factory=Range)
    kind: ClassVar = "spring-gauge"

    rules: ClassVar = (Rule(("scale",), lambda gauge: gauge.scale != 13, lambda *_: "must not be 13"),)


@dataclass(frozen=True)
class Feeler(Part):
    kind: ClassVar = "feeler"
    scale: Annotated[float, Quantity("1", "scale")] = 1.0
    range: Range = field(default_factory=Range)


GAUGES: Registry[Part] = Registry("gauge", Gauge, Feeler)


@dataclass(frozen=True)
class Bench:
    colour: Annotated[Literal["red", "blue"], Quantity("", "its colour")] = "red"
    lit: Annotated[bool, Quantity("", "whether it is lit")] = False
    first: Annotated[Part, Quantity("", "first gauge"), PartChoice("first", GAUGES)] = field(default_factory=Gauge)
    second: Annotated[Part, Quantity("", "second gauge"), PartChoice("second", GAUGES)] = field(default_factory=Feeler)


LEAVES = describe(Range) | describe(Bench)


@pytest.mark.parametrize(
    ("key", "value", "kept"),
    [
        ("lower", 3, 3.0),
        ("lower", np.float64(0.5), 0.5),
        ("upper", -1e300, -1e300),
        ("steps", 4, 4),
        ("steps", None, None),
        ("colour", "blue", "blue"),
        ("lit", True, True),
        ("first", "feeler", "feeler"),
    ],
)
def test_values_that_are_allowed_come_back_in_their_own_type(key: str, value: Any, kept: Any) -> None:
    found = validated(LEAVES[key], value)
    assert found == kept
    assert isinstance(found, type(kept))


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("lower", -1, "lower = -1: must be a finite number >= 0 N"),
        ("lower", float("nan"), "lower = nan: must be a finite number >= 0 N"),
        ("upper", float("inf"), "upper = inf: must be a finite number N"),
        ("upper", 10**400, "upper = 1000"),
        ("upper", None, "upper = None: must be a finite number N"),
        ("upper", "much", 'upper = "much": must be a finite number N'),
        ("upper", True, "upper = true: must be a finite number N"),
        ("steps", 0, "steps = 0: must be a whole number >= 1"),
        ("steps", 2.0, "steps = 2.0: must be a whole number >= 1"),
        ("colour", "green", 'colour = "green": must be "red" or "blue"'),
        ("lit", 1, "lit = 1: must be true or false"),
        ("first", "ruler", 'first = "ruler": must be "spring-gauge" or "feeler"'),
        ("first", ["feeler"], "first = ['feeler']: must be"),
    ],
)
def test_values_that_are_not_are_named_with_what_is(key: str, value: Any, message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        validated(LEAVES[key], value)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_values_are_shown_as_toml_writes_them_on_one_line() -> None:
    assert [shown(value) for value in (True, "word", 1.5, None)] == ["true", '"word"', "1.5", "None"]
    assert shown("x" * 100) == f'"{"x" * 56}...'
    assert shown(10**5000) == "a number too large to show"


def test_all_values_of_a_group_are_checked_by_key() -> None:
    check_values(Bench(), "shop.")
    with pytest.raises(ConfigurationError, match=r"^shop\.spring_gauge\.scale = 0: must be a finite number > 0$"):
        check_values(Bench(first=Gauge(0)), "shop.")
    with pytest.raises(ConfigurationError, match=r"^range\.lower = -1\.0: must be a finite number >= 0 N$"):
        check_values(Bench(second=Feeler(range=Range(-1.0))))


def test_parts_that_share_keys_must_share_values() -> None:
    """The numbers of both stand under one key: one of two values would be lost."""
    check_values(Bench(first=Gauge(range=Range(upper=5.0)), second=Feeler(range=Range(upper=5.0))))
    with pytest.raises(ConfigurationError, match=r"^range\.upper = 2\.0: must be 5\.0, as another part has it$"):
        check_values(Bench(first=Gauge(range=Range(upper=5.0))))
    with pytest.raises(ConfigurationError, match=r"^feeler\.scale = 3\.0: must be 2\.0, as another part has it$"):
        check_values(Bench(first=Feeler(2.0), second=Feeler(3.0)))


def test_rules_blame_their_first_field_by_its_key() -> None:
    check_rules(Bench())
    with pytest.raises(ConfigurationError, match=r"^b\.range\.lower = 3: must be < b\.range\.upper = 2 N$"):
        check_rules(Bench(second=Feeler(range=Range(3.0))), "b.")
    with pytest.raises(ConfigurationError, match=r"^b\.spring_gauge\.scale = 13: must not be 13$"):
        check_rules(Bench(first=Gauge(13.0)), "b.")
