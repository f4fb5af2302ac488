"""Groups of numbers as trees: flattened into named scalars, rebuilt from others, and checked."""

from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass, replace
from datetime import date, time
from operator import is_
from typing import Any, TypeVar

import casadi as ca

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts, own_prefix, slots
from dualwinch.model.quantities.part import HOW_TO_REGISTER, Part, PartChoice
from dualwinch.model.quantities.quantity import (
    Leaf,
    Mark,
    Rule,
    elements,
    is_array,
    meant,
    numbers_of,
    rebuilt,
    with_point,
)
from dualwinch.model.scalar import Scalar, present, where

Group = TypeVar("Group")


def leaves(group: Any, prefix: str = "", *, whole: bool = False) -> dict[str, Any]:
    """Flatten a (nested) dataclass into its scalars, vectors and matrices into their elements.

    Returns dotted key → value in declaration order, the kinds of parts included. Every key has the prefix, such as
    ``"plant."``. A `whole` array, such as a signal over time, is kept in one piece.
    """
    return dict(pairs(group, prefix, whole=whole))


def pairs(group: Any, prefix: str = "", *, whole: bool = False) -> Iterator[tuple[str, Any]]:
    """Keys and values as in `leaves`; a key shared by two parts comes once for each."""
    for slot in slots(type(group), prefix):
        value = getattr(group, slot.field)
        inside = () if slot.plain else slot.groups(value)
        if slot.choice:
            kinds = tuple(part.kind for part in inside)
            yield slot.key, kinds if slot.choice.several else kinds[0]
        for part in inside:
            yield from pairs(part, slot.below, whole=whole)
        if not slot.plain and is_array(value) and not whole:
            yield from ((slot.key + end, element) for end, element in elements(value).items())
        elif not inside and not slot.choice:
            yield slot.key, value


def with_leaves(group: Group, values: Mapping[str, Any], prefix: str = "") -> Group:
    """A copy of a (nested) dataclass with some of its scalars replaced, by their dotted keys; unknown keys are ignored.

    A new kind of a part has its own defaults, and the values of keys it shares with the part it replaces. Of several
    parts those of a requested kind are kept; others are added with their defaults. The keys of this group have a
    prefix, e.g. ``"plant."``.

    Raises:
        ConfigurationError: a part of an unknown kind, or invalid values of a group.
    """
    changes: dict[str, Any] = {}
    for slot in slots(type(group), prefix):
        value = getattr(group, slot.field)
        inside = () if slot.plain else slot.groups(value)
        if inside and slot.key not in values and not any(key.startswith(slot.below) for key in values):
            continue
        if slot.choice:
            parts = _chosen(slot.choice, inside, values.get(slot.key), slot.below)
            parts = tuple(with_leaves(part, values, slot.below) for part in parts)
            unchanged = len(parts) == len(inside) and all(map(is_, parts, inside))
            changes[slot.field] = value if unchanged else parts if slot.choice.several else parts[0]
        elif inside:
            changes[slot.field] = with_leaves(value, values, slot.below)
        elif not slot.plain and is_array(value):
            present_elements = elements(value)
            changes[slot.field] = rebuilt(
                value, lambda end, key=slot.key, present=present_elements: values.get(key + end, present[end])
            )
        elif slot.key in values:
            changes[slot.field] = values[slot.key]
    return _changed(group, changes, prefix)


def either_of(condition: Scalar, group: Group, otherwise: Group) -> Group:
    """One of two groups of the same fields, element by element: `group` where the condition holds."""
    if condition is True:
        return group
    alternatives = leaves(otherwise)
    return with_leaves(group, {key: where(condition, value, alternatives[key]) for key, value in leaves(group).items()})


def _chosen(choice: PartChoice, parts: tuple[Part, ...], kinds: Any, below: str) -> Iterator[Part]:
    """Parts of some kinds, new ones with the values they share with the present parts; ``None``: the present kinds."""
    classes = {part.kind: part for part in parts}
    for kind in classes if kinds is None else kinds if choice.several else (kinds,):
        if kind in classes:
            yield classes[kind]
        else:
            shared = {key: value for part in parts for key, value in pairs(part, below)}
            yield with_leaves(choice.registry.find(kind)(), shared, below)


def _changed(group: Group, changes: dict[str, Any], prefix: str) -> Group:
    """A copy with some fields changed, or the group itself; errors of its constructor get its key."""
    if all(getattr(group, name) is value for name, value in changes.items()):
        return group
    try:
        return replace(group, **changes)  # pyright: ignore[reportArgumentType, reportCallIssue]
    except ConfigurationError as error:
        if not prefix:
            raise
        raise ConfigurationError(f"{prefix[:-1]}: {error}") from error


def numbers(group: Any, prefix: str = "") -> dict[str, Any]:
    """The scalars of a group that are numbers at run time: the parameters of a compiled function.

    Zeros that shape code (`Mark.SHAPES_CODE_AT_ZERO`) are not included.
    """
    descriptions = describe_parts(group, prefix)
    return {
        key: value
        for key, value in leaves(group, prefix).items()
        if descriptions[key].is_number and value is not None
        if present(value) or Mark.SHAPES_CODE_AT_ZERO not in descriptions[key].marks
    }


def shape_of(group: Group) -> Group:
    """A group of the same type and code structure with default numbers."""
    descriptions = describe_parts(group)
    shaping = {key: value for key, value in leaves(group).items() if descriptions[key].shapes_code}
    at_zero = {key for key in descriptions if Mark.SHAPES_CODE_AT_ZERO in descriptions[key].marks}
    values = numbers(group)
    switched = {key: descriptions[key].some_value if key in values else 0.0 for key in at_zero}
    return with_leaves(type(group)(), shaping | switched)


def symbols(group: Group, name: str) -> tuple[Group, ca.SX]:
    """A group with symbols as its numbers, and their vector in the order of ``numbers(group)``."""
    keys = list(numbers(group))
    vector = ca.SX.sym(name, len(keys))
    return with_leaves(group, dict(zip(keys, ca.vertsplit(vector), strict=True))), vector


def alike(group: Group) -> Group:
    """A group of the same structure with placeholder numbers, as a cache key for all groups of this structure."""
    descriptions = describe_parts(group)
    return with_leaves(group, {key: descriptions[key].some_value for key in numbers(group)})


def rules(group: Any, prefix: str = "") -> Iterator[tuple[str, Any, Rule]]:
    """Every rule between values below a group: prefix of its keys, its group, and the rule."""
    default_prefix = own_prefix(type(group), prefix)
    for rule in getattr(group, "rules", ()):
        yield default_prefix, group, rule
    for slot in slots(type(group), prefix):
        for inner in () if slot.plain else slot.groups(getattr(group, slot.field)):
            yield from rules(inner, slot.below)


def shown(value: Any) -> str:
    """A value for error messages: in TOML, at most 60 characters."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (date, time)):  # or a datetime
        return value.isoformat()
    try:
        text = f'"{value}"' if isinstance(value, str) else repr(value)
    except ValueError:  # a whole number of more digits than Python prints
        text = "a number too large to show"
    return text if len(text) <= 60 else f"{text[:57]}..."


def validated(leaf: Leaf, value: Any) -> Any:
    """The value of a leaf, converted to the leaf's type.

    Raises:
        ConfigurationError: it is of the wrong type or out of range.
    """
    if not leaf.admits(value):
        hint = "" if leaf.marks.isdisjoint({Mark.PART, Mark.PARTS}) else f" ({HOW_TO_REGISTER})"
        if leaf.choices and isinstance(value, str) and (question := meant(value, leaf.choices)):
            hint += f"; {question}"
        if leaf.kind in {float, int}:
            hint += with_point(value)
        raise ConfigurationError(f"{leaf.key} = {shown(value)}: must be {leaf.wanted}{hint}")
    if Mark.PARTS in leaf.marks:
        return (value,) if isinstance(value, str) else tuple(value)
    if leaf.kind is tuple:
        return numbers_of(value)
    return float(value) if leaf.kind is float and value is not None else value


def check_values(group: Any, prefix: str = "") -> None:
    """Raise `ConfigurationError` where a value is of the wrong type, out of range, or different in two parts."""
    _check_groups(group, prefix)
    descriptions = describe_parts(group, prefix)
    values: dict[str, Any] = {}
    for key, value in pairs(group, prefix, whole=True):
        leaf = descriptions.get(key)
        if leaf is None or type(value) is list:  # arrays and lists have no hash, which the cache of code needs
            kind = "an array" if leaf is None else "a list"
            raise ConfigurationError(f"{key}: is {kind}; must be a number, or a tuple of numbers")
        if not leaf.admits(value):
            raise ConfigurationError(f"{key} = {shown(value)}: must be {leaf.wanted}")
        if values.setdefault(key, value) != value:
            raise ConfigurationError(f"{key} = {shown(value)}: must be {shown(values[key])}, as another part has it")


def _check_groups(group: Any, prefix: str) -> None:
    """Raise `ConfigurationError` where a group is replaced by something else, such as a signal by a number."""
    for slot in slots(type(group), prefix):
        value = getattr(group, slot.field)
        if isinstance(slot.hint, type) and is_dataclass(slot.hint) and not slot.choice:
            if not isinstance(value, slot.hint):
                raise ConfigurationError(f"{slot.key}: must be a {slot.hint.__name__}, not {type(value).__name__}")
            _check_groups(value, slot.below)


def check_rules(group: Any, prefix: str = "") -> None:
    """Raise `ConfigurationError` where the values of a group violate a rule."""
    for table, owner, rule in rules(group, prefix):
        if not rule.holds(owner):
            blamed = getattr(owner, rule.fields[0])
            raise ConfigurationError(f"{table}{rule.fields[0]} = {blamed:g}: {rule.wanted(owner, table)}")
