"""What the scalars of a group are: every one with its key, quantity, type and bounds, as a `Leaf`."""

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, is_dataclass, replace
from functools import cache
from types import MappingProxyType
from typing import Any, Literal, get_args, get_origin

import annotated_types as at

from dualwinch.model.quantities.arrays import elements, is_array
from dualwinch.model.quantities.part import Part
from dualwinch.model.quantities.quantity import Leaf, Mark, Quantity, Tied, Tunable, TunableRatio
from dualwinch.model.quantities.slots import Slot, slots


def describe(group: type, prefix: str = "") -> dict[str, Leaf]:
    """Every scalar below a dataclass type, nested groups and every registered part included, in declaration order.

    Args:
        group: a dataclass type whose scalar fields are annotated with a `Quantity`.
        prefix: put before every key.

    Returns:
        Dotted key → `Leaf`.

    Raises:
        TypeError: a scalar field has no `Quantity`, or a constraint that is no bound.
    """
    found: dict[str, Leaf] = {}
    for slot in slots(group, prefix):
        if slot.choice:
            found[slot.choice_key] = _choice_leaf(slot, tuple(slot.choice.registry))
            for part in slot.choice.registry.values():
                found |= {key: leaf for key, leaf in describe(part, slot.beside).items() if key not in found}
        elif isinstance(slot.hint, type) and is_dataclass(slot.hint):
            found |= _tied(describe(slot.hint, slot.below), slot)
        else:
            found[slot.key] = _leaf(group, slot)
    return found


def describe_parts(group: Any, prefix: str = "") -> Mapping[str, Leaf]:
    """Every scalar below an instance, by the types of the parts it is made of; keys as in `leaves`.

    Args:
        group: an instance of a dataclass, whose parts may be of any dataclass type.
        prefix: put before every key.

    Raises:
        TypeError: a scalar field has no `Quantity`, or a constraint that is no bound.
    """
    shape = _shape(group), prefix
    if shape not in _described:
        _described[shape] = MappingProxyType(_describe_parts(group, prefix))
    return _described[shape]


_described: dict[tuple[Any, str], Mapping[str, Leaf]] = {}
"""What groups of a shape are, once they have been asked for."""


def _shape(group: Any) -> tuple[Any, ...]:
    """What the description of a group depends on: the types of its groups and the shapes of its arrays."""
    found: list[Any] = [type(group)]
    for slot in slots(type(group), ""):
        if slot.plain:
            continue
        value = getattr(group, slot.field)
        if slot.choice:
            found.append(len(slot.choice.registry))
        if is_dataclass(value):
            found.append(_shape(value))
        elif is_array(value):
            found.append(value.shape)
    return tuple(found)


def _describe_parts(group: Any, prefix: str) -> dict[str, Leaf]:
    found: dict[str, Leaf] = {}
    for slot in slots(type(group), prefix):
        value = getattr(group, slot.field)
        if isinstance(value, Part):
            if slot.choice:
                choices = dict.fromkeys((*slot.choice.registry, value.kind))
                found[slot.choice_key] = _choice_leaf(slot, tuple(choices))
            found |= describe_parts(value, slot.beside)
        elif is_dataclass(value):
            found |= _tied(describe_parts(value, slot.below), slot)
        elif is_array(value):
            leaf = _leaf(type(group), slot)
            found |= {slot.key + end: replace(leaf, key=slot.key + end) for end in elements(value)}
        else:
            found[slot.key] = _leaf(type(group), slot)
    return found


def _tied(found: Mapping[str, Leaf], slot: Slot) -> Mapping[str, Leaf]:
    tied = slot.find(Tied)
    if tied is None:
        return found
    shared = f"{slot.beside}{tied.name}."
    return {key: replace(leaf, tied=shared + key.removeprefix(slot.below)) for key, leaf in found.items()}


@cache
def _choice_leaf(slot: Slot, choices: tuple[str, ...]) -> Leaf:
    return Leaf(slot.choice_key, slot.find(Quantity), str, choices, marks=frozenset({Mark.PART}))


@cache
def _leaf(group: type, slot: Slot) -> Leaf:
    quantity, name = slot.find(Quantity), f"{group.__name__}.{slot.field}"
    if quantity is None:
        raise TypeError(f"{name} has no Quantity")
    optional = type(None) in get_args(slot.hint)
    options = [option for option in get_args(slot.hint) if option is not type(None)]
    kind = options[0] if optional else slot.hint
    choices: tuple[str, ...] = ()
    if get_origin(kind) is Literal:
        kind, choices = str, tuple(str(choice) for choice in get_args(kind))
    elif get_origin(kind) is tuple:
        kind = tuple
    return Leaf(
        key=slot.key,
        quantity=quantity,
        kind=kind,
        choices=choices,
        optional=optional,
        constraints=tuple(_bounds(slot.metadata, name)),
        tunable=slot.find(Tunable),
        ratio=slot.find(TunableRatio),
        marks=frozenset(item for item in slot.metadata if isinstance(item, Mark)),
        default=None if slot.default is MISSING else slot.default,
    )


def _bounds(metadata: tuple[Any, ...], name: str) -> Iterator[at.BaseMetadata]:
    for item in metadata:
        if isinstance(item, at.GroupedMetadata):  # an interval
            yield from _bounds(tuple(item), name)
        elif isinstance(item, (at.Gt, at.Ge, at.Lt, at.Le)):
            yield item
        elif isinstance(item, at.BaseMetadata):
            raise TypeError(f"{name}: {item} is no bound; use Gt, Ge, Lt, Le or Interval, and a Rule for the rest")


def owners(group: type, key: str, prefix: str = "") -> tuple[str, tuple[str, ...]]:
    """Whose a key is: the key that chooses among parts below a group type, and the registered kinds that have it."""
    for slot in slots(group, prefix):
        found = "", ()
        if slot.choice:
            kinds = slot.choice.registry.items()
            found = slot.choice_key, tuple(kind for kind, part in kinds if key in describe(part, slot.beside))
        elif isinstance(slot.hint, type) and is_dataclass(slot.hint):
            found = owners(slot.hint, key, slot.below)
        if found[1]:
            return found
    return "", ()
