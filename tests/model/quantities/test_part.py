from dataclasses import dataclass
from typing import ClassVar

import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.part import Part, Registry


@dataclass(frozen=True)
class Slow(Part):
    kind: ClassVar = "slow-and-sure"


@dataclass(frozen=True)
class Quick(Part):
    kind: ClassVar = "quick"


WALKERS: Registry[Part] = Registry("walker", Slow, Quick)


def test_the_table_of_a_part_is_its_kind_as_a_key() -> None:
    assert (Slow.table(), Quick().table()) == ("slow_and_sure", "quick")


def test_a_registry_is_a_mapping_of_kinds_in_the_order_given() -> None:
    assert dict(WALKERS) == {"slow-and-sure": Slow, "quick": Quick}
    assert list(WALKERS) == ["slow-and-sure", "quick"]
    assert len(WALKERS) == 2
    assert WALKERS["quick"] is WALKERS.find("quick") is Quick


@pytest.mark.parametrize("kind", ["qick", 3, None])
def test_an_unknown_kind_is_named_with_all_there_are_and_the_nearest(kind: object) -> None:
    with pytest.raises(ConfigurationError) as caught:
        WALKERS.find(kind)
    message = str(caught.value)
    assert message.startswith(f"unknown walker {kind!r}; ")
    assert "ust be one of slow-and-sure, quick (a kind of your own: dw.register(YourClass), or --plugin" in message
    assert "\n" not in message
    if kind == "qick":
        assert "did you mean 'quick'?" in message
