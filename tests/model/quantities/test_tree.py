from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

import annotated_types as at
import casadi as ca
import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe, describe_parts, owners
from dualwinch.model.quantities.part import Part, PartChoice, Registry
from dualwinch.model.quantities.quantity import Elements, Key, Mark, Quantity, Rule, Tied, Tunable, TunableRatio
from dualwinch.model.quantities.tree import alike, leaves, numbers, pairs, rules, with_leaves


@dataclass(frozen=True)
class Inner:
    size: Annotated[float, at.Gt(0), at.Le(2), Quantity("m", "size", "Table 1"), Mark.OFF_AT_ZERO] = 1.0
    count: Annotated[int | None, at.Ge(1), Quantity("1", "count"), TunableRatio("size", ("3/1",))] = None


@dataclass(frozen=True)
class Outer:
    kind: Annotated[Literal["a", "b"], Quantity("", "kind")] = "a"
    on: Annotated[bool, Quantity("", "switch")] = False
    inner: Inner = field(default_factory=Inner)


def test_every_scalar_is_described_by_its_dotted_key() -> None:
    assert list(describe(Outer)) == ["kind", "on", "inner.size", "inner.count"]
    size = describe(Outer)["inner.size"]
    assert (size.quantity.unit, size.kind, size.optional) == ("m", float, False)
    assert (size.constraints, size.marks, size.default) == ((at.Gt(0), at.Le(2)), {Mark.OFF_AT_ZERO}, 1.0)
    count = describe(Outer)["inner.count"]
    assert (count.kind, count.optional, count.ratio) == (int, True, TunableRatio("size", ("3/1",)))
    assert describe(Outer)["kind"].choices == ("a", "b")


def test_taken_apart_and_put_together_again() -> None:
    changed = Outer("b", on=True, inner=Inner(0.5, 3))
    assert with_leaves(Outer(), leaves(changed)) == changed


def test_only_the_named_scalars_change() -> None:
    assert with_leaves(Outer(), {"x.inner.size": 2.0}, "x.") == Outer(inner=Inner(2.0))
    assert with_leaves(Outer(), {"no.such": 2.0}) == Outer()


def test_groups_in_which_nothing_changes_stay_themselves() -> None:
    before = Outer()
    assert with_leaves(before, {"no.such": 2.0}) is before
    after = with_leaves(before, {"on": True})
    assert after.on is True
    assert after.inner is before.inner


def test_numbers_leave_out_choices_and_what_is_not_given() -> None:
    assert numbers(Outer(), "p.") == {"p.inner.size": 1.0}
    assert numbers(Outer(inner=Inner(count=2)), "p.") == {"p.inner.size": 1.0, "p.inner.count": 2}


def test_a_scalar_without_a_quantity_is_an_error() -> None:
    @dataclass(frozen=True)
    class Bare:
        size: float = 1.0

    for describe_it in (lambda: describe(Bare), lambda: describe_parts(Bare())):
        with pytest.raises(ConfigurationError, match=r"Bare\.size has no Quantity"):
            describe_it()


def test_an_interval_bounds_like_its_ends_and_what_is_no_bound_is_an_error() -> None:
    @dataclass(frozen=True)
    class Bounded:
        share: Annotated[float, at.Interval(gt=0, le=1), Quantity("1", "share")] = 0.5

    @dataclass(frozen=True)
    class Stepped:
        share: Annotated[float, at.MultipleOf(0.1), Quantity("1", "share")] = 0.5

    assert describe(Bounded)["share"].constraints == (at.Gt(0), at.Le(1))
    with pytest.raises(
        ConfigurationError, match=r"Stepped\.share: MultipleOf\(multiple_of=0\.1\) is no bound; use Gt, Ge"
    ):
        describe(Stepped)


@dataclass(frozen=True)
class Tank:
    volume: Annotated[float, at.Gt(0), Quantity("m^3", "volume"), Tunable(1, 9)] = 1.0

    rules: ClassVar = (Rule(("volume",), lambda tank: tank.volume != 13, lambda *_: "must not be 13"),)


class Engine(Part):
    pass


@dataclass(frozen=True)
class Diesel(Engine):
    power: Annotated[float, at.Gt(0), Quantity("W", "power")] = 5e3
    noise: Annotated[float, Quantity("1", "loudness"), Key("noise")] = 0.7
    tank: Tank = field(default_factory=Tank)
    kind: ClassVar = "slow-diesel"

    rules: ClassVar = (Rule(("power",), lambda engine: engine.power < 1e6, lambda *_: "must be < 1e6"),)


@dataclass(frozen=True)
class Steam(Engine):
    heat: Annotated[float, at.Gt(0), Quantity("K", "temperature")] = 400.0
    tank: Tank = field(default_factory=lambda: Tank(3.0))
    kind: ClassVar = "steam"


@dataclass(frozen=True)
class Sail(Engine):
    """Not in the registry."""

    area: Annotated[float, at.Gt(0), Quantity("m^2", "area"), Tunable(2, 20)] = 8.0
    tank: Tank = field(default_factory=lambda: Tank(7.0))
    kind: ClassVar = "sail"


ENGINES: Registry[Engine] = Registry("engine", Diesel, Steam)


@dataclass(frozen=True)
class Oar:
    length: Annotated[float, at.Gt(0), Quantity("m", "length")] = 2.0


@dataclass(frozen=True)
class Boat:
    engine: Annotated[Engine, Quantity("", "what drives it"), PartChoice("drive.kind", ENGINES)] = field(
        default_factory=Diesel
    )
    size: Annotated[Tank, Key("hull")] = field(default_factory=Tank)
    left: Annotated[Oar, Tied("oar")] = field(default_factory=Oar)
    right: Annotated[Oar, Tied("oar")] = field(default_factory=Oar)


@dataclass(frozen=True)
class Fleet:
    first: Boat = field(default_factory=Boat)


AROUND = ["f.hull.volume", "f.left.length", "f.right.length"]


def test_a_type_is_described_with_every_registered_part() -> None:
    own = ["f.slow_diesel.power", "f.noise", "f.tank.volume", "f.steam.heat"]
    assert list(describe(Boat, "f.")) == ["f.drive.kind", *own, *AROUND]
    choice = describe(Boat, "f.")["f.drive.kind"]
    assert (choice.choices, choice.kind, choice.marks) == (("slow-diesel", "steam"), str, {Mark.PART})
    assert choice.quantity.meaning == "what drives it"


def test_an_instance_is_described_and_taken_apart_with_the_parts_it_has() -> None:
    for boat, own in (
        (Boat(), ["f.slow_diesel.power", "f.noise", "f.tank.volume"]),
        (Boat(Steam()), ["f.steam.heat", "f.tank.volume"]),
        (Boat(Sail()), ["f.sail.area", "f.tank.volume"]),
    ):
        assert list(describe_parts(boat, "f.")) == list(leaves(boat, "f.")) == ["f.drive.kind", *own, *AROUND]
    assert leaves(Fleet(Boat(Sail(3.0))))["first.sail.area"] == 3
    assert leaves(Fleet(Boat(Sail(3.0))))["first.drive.kind"] == "sail"


def test_a_part_that_is_not_registered_is_a_choice_where_it_is_and_has_all_a_gain_has() -> None:
    known = describe_parts(Boat(Sail()))
    assert known["drive.kind"].choices == ("slow-diesel", "steam", "sail")
    assert known["sail.area"].tunable == Tunable(2, 20)
    assert (known["sail.area"].allowed, known["sail.area"].quantity.unit) == ("> 0", "m^2")
    assert describe_parts(Boat())["drive.kind"].choices == ("slow-diesel", "steam")


def test_gains_of_a_part_are_set_by_their_keys() -> None:
    assert with_leaves(Boat(Sail()), {"sail.area": 3.0, "tank.volume": 2.0}) == Boat(Sail(3.0, Tank(2.0)))
    assert with_leaves(Boat(), {"sail.area": 3.0, "steam.heat": 500.0}) == Boat()


def test_another_kind_keeps_what_both_share_and_has_its_own_defaults_for_the_rest() -> None:
    boat = Boat(Diesel(9e3, 0.1, Tank(4.0)), left=Oar(3.0))
    steaming = with_leaves(boat, {"drive.kind": "steam"})
    assert steaming == Boat(Steam(400.0, Tank(4.0)), left=Oar(3.0))
    assert with_leaves(steaming, {"drive.kind": "slow-diesel"}) == Boat(Diesel(tank=Tank(4.0)), left=Oar(3.0))
    assert with_leaves(boat, {"drive.kind": "steam", "steam.heat": 500.0, "tank.volume": 2.0}).engine == Steam(
        500.0, Tank(2.0)
    )


def test_the_same_kind_and_a_kind_that_is_not_registered_stay_what_they_are() -> None:
    boat = Boat(Sail(3.0))
    assert with_leaves(boat, {"drive.kind": "sail"}) == boat
    assert with_leaves(boat, leaves(boat)) == boat
    assert with_leaves(boat, {"drive.kind": "steam"}).engine == Steam(tank=Tank(7.0))


def test_a_kind_there_is_not_is_an_error() -> None:
    with pytest.raises(ConfigurationError, match=r"unknown engine 'stem'; did you mean 'steam'\?"):
        with_leaves(Boat(), {"drive.kind": "stem"})


def test_tied_gains_know_the_key_they_share() -> None:
    for known in (describe(Fleet), describe_parts(Fleet())):
        assert [key for key, leaf in known.items() if leaf.tied] == ["first.left.length", "first.right.length"]
        assert known["first.left.length"].tied == known["first.right.length"].tied == "first.oar.length"


def test_the_kinds_that_own_a_key() -> None:
    assert owners(Fleet, "first.steam.heat") == ("first.drive.kind", ("steam",))
    assert owners(Fleet, "first.tank.volume") == ("first.drive.kind", ("slow-diesel", "steam"))
    assert owners(Fleet, "first.hull.volume") == owners(Fleet, "first.sail.area") == ("", ())


@dataclass(frozen=True)
class Wheel(Part):
    """A part of which there are several: its numbers stand below the name of the field that holds it."""

    radius: Annotated[float, at.Gt(0), Quantity("m", "radius")] = 0.3

    kind: ClassVar = "wheel"
    rules: ClassVar = (Rule(("radius",), lambda wheel: wheel.radius < 2, lambda _, table: f"{table} must be < 2"),)

    @classmethod
    def table(cls) -> str:
        return ""


WHEELS: Registry[Wheel] = Registry("wheel", Wheel)


@dataclass(frozen=True)
class Cart:
    left: Annotated[Wheel, Quantity("", "wheel"), PartChoice("left.kind", WHEELS, "left")] = field(
        default_factory=Wheel
    )
    right: Annotated[Wheel, Quantity("", "wheel"), PartChoice("right.kind", WHEELS, "right")] = field(
        default_factory=Wheel
    )
    horse: Annotated[Engine, Quantity("", "in front"), PartChoice("horse.kind", ENGINES, "horse")] = field(
        default_factory=Steam
    )


def test_parts_may_stand_in_tables_of_the_fields_that_hold_them() -> None:
    cart = Cart(left=Wheel(0.5))
    keys = ["c.left.kind", "c.left.radius", "c.right.kind", "c.right.radius"]
    keys += ["c.horse.kind", "c.horse.steam.heat", "c.horse.tank.volume"]
    assert list(leaves(cart, "c.")) == list(describe_parts(cart, "c.")) == keys
    assert set(keys) < set(describe(Cart, "c."))
    assert with_leaves(Cart(), leaves(cart)) == cart
    assert with_leaves(cart, {"right.radius": 1.0}) == Cart(Wheel(0.5), Wheel(1.0))
    assert with_leaves(cart, {"horse.kind": "slow-diesel", "horse.slow_diesel.power": 2.0}).horse == Diesel(
        2.0, tank=Tank(3.0)
    )
    assert owners(Cart, "left.radius") == ("left.kind", ("wheel",))
    assert owners(Cart, "horse.steam.heat") == ("horse.kind", ("steam",))
    assert [table for table, _, rule in rules(cart) if rule.fields == ("radius",)] == ["left.", "right."]


def test_groups_of_one_structure_are_alike() -> None:
    assert alike(Cart(left=Wheel(0.5))) == alike(Cart(horse=Steam(7.0))) != alike(Cart(horse=Diesel()))
    assert alike(Boat(Sail(3.0))) == alike(Boat(Sail(4.0))) != alike(Boat())
    assert alike(Outer(inner=Inner(count=2))) != alike(Outer()) != alike(Outer("b"))
    assert alike(Outer(inner=Inner(0.5))) == alike(Outer())


def test_rules_come_with_their_group_and_what_its_keys_begin_with() -> None:
    boat = Boat(Diesel(tank=Tank(4.0)))
    found = [(table, group, rule.fields) for table, group, rule in rules(Fleet(boat))]
    assert found == [
        ("first.slow_diesel.", boat.engine, ("power",)),
        ("first.tank.", Tank(4.0), ("volume",)),
        ("first.hull.", Tank(), ("volume",)),
    ]


def test_a_key_that_two_parts_share_is_paired_with_the_value_of_each() -> None:
    @dataclass(frozen=True)
    class Tandem:
        front: Annotated[Engine, Quantity("", "front"), PartChoice("front", ENGINES)] = field(default_factory=Diesel)
        rear: Annotated[Engine, Quantity("", "rear"), PartChoice("rear", ENGINES)] = field(default_factory=Steam)

    assert [value for key, value in pairs(Tandem()) if key == "tank.volume"] == [1.0, 3.0]
    assert [value for key, value in pairs(Tandem()) if key == "steam.heat"] == [400.0]


@dataclass(frozen=True)
class Memory:
    z: Annotated[Any, Quantity("m", "vector"), Mark.SPEED] = field(default_factory=lambda: np.array([1.0, 2.0]))
    P: Annotated[Any, Quantity("m^2", "matrix")] = field(default_factory=lambda: np.array([[1.0, 2.0], [3.0, 4.0]]))
    single: Annotated[Any, Quantity("s", "vector of one")] = field(default_factory=lambda: np.array([9.0]))


MEMORY = {"z.0": 1, "z.1": 2, "P.0.0": 1, "P.0.1": 2, "P.1.0": 3, "P.1.1": 4, "single": 9}


def test_vectors_and_matrices_are_scalars_by_their_places() -> None:
    assert leaves(Memory()) == MEMORY
    known = describe_parts(Memory(), "m.")
    assert [key.removeprefix("m.") for key in known] == list(MEMORY)
    assert all(key == leaf.key for key, leaf in known.items())
    assert (known["m.z.1"].quantity.unit, known["m.P.1.0"].quantity.unit) == ("m", "m^2")
    assert known["m.z.1"].marks == {Mark.SPEED}
    assert list(leaves(Memory(), whole=True)) == ["z", "P", "single"]


@dataclass(frozen=True)
class Motion:
    z: Annotated[Any, Elements((Quantity("m", "position"), Mark.POSITION), Quantity("m/s", "speed"))] = field(
        default_factory=lambda: np.zeros(2)
    )


def test_elements_of_a_vector_have_their_own_units_and_marks() -> None:
    known = describe_parts(Motion(), "m.")
    assert list(known) == [leaf.key for leaf in known.values()] == ["m.z.0", "m.z.1"]
    assert [leaf.quantity.meaning for leaf in known.values()] == ["position", "speed"]
    assert [leaf.marks for leaf in known.values()] == [{Mark.POSITION}, frozenset()]
    for size in (1, 3):
        with pytest.raises(ConfigurationError, match=rf"^Motion\.z: has {size} elements; its Elements.* not 2$"):
            describe_parts(Motion(np.zeros(size)))
    with pytest.raises(ConfigurationError, match=r"^Motion\.z: has 1 elements; its Elements"):
        describe_parts(Motion(ca.SX.sym("z")))


def test_vectors_and_matrices_are_put_together_of_numbers_and_of_symbols() -> None:
    again = with_leaves(Memory(), {"z.1": 5.0, "P.0.1": 6.0, "single": 7.0})
    assert again.z.tolist() == [1, 5]
    assert again.P.tolist() == [[1, 6], [3, 4]]
    assert again.single.tolist() == [7]
    symbols = {key: ca.SX.sym(key) for key in MEMORY}
    symbolic = with_leaves(Memory(), symbols)
    assert (symbolic.z.shape, symbolic.P.shape) == ((2, 1), (2, 2))
    for key, value in leaves(symbolic).items():
        assert ca.is_equal(value, symbols[key]), key
