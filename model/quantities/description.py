"""The scalars of a group type: each with its key, quantity, type and bounds, as a `Leaf`.

A group is a frozen dataclass, of floats or of CasADi symbols, that may have further groups and parts
(`model.quantities.part`) as fields.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import cache
from types import MappingProxyType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import annotated_types as at

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.part import Part, PartChoice, PartChoices, built_in, named
from dualwinch.model.quantities.quantity import (
    Elements,
    Key,
    Leaf,
    Mark,
    Quantity,
    Tied,
    Tunable,
    TunableRatio,
    elements,
    is_array,
)


@dataclass(frozen=True)
class Slot:
    """A field of a group type below a prefix.

    Attributes:
        field, hint, metadata, default: its name, type, annotations and default.
        key: of the scalar it holds.
        below: what the keys of a group that it holds begin with.
        beside: what the keys of a part that it holds begin with.
        plain: whether it can only hold a scalar.
        choice: where it holds a part: what there is to choose from.
        choice_key: key of the kind of that part.
        choices: where it holds a tuple of parts: what there is to choose from. Its key is that of their kinds.
    """

    field: str
    hint: Any
    metadata: tuple[Any, ...]
    default: Any
    key: str
    below: str
    beside: str
    plain: bool
    choice: PartChoice | None
    choice_key: str
    choices: PartChoices | None

    def find(self, kind: type) -> Any:
        """The first piece of metadata of a type."""
        return next((item for item in self.metadata if isinstance(item, kind)), None)


def check_base(slot: Slot, value: Any) -> None:
    """Raise `ConfigurationError` where what stands in a part's place is no object of the part's base."""
    if not isinstance(value, slot.hint):
        given = f"the class {value.__name__}" if isinstance(value, type) else f"a {type(value).__name__}"
        hint = f"; write {value.__name__}()" if isinstance(value, type) and issubclass(value, slot.hint) else ""
        raise ConfigurationError(f"{slot.choice_key}: must be a {slot.hint.__name__}, not {given}{hint}")


@cache
def slots(group: type, prefix: str) -> tuple[Slot, ...]:
    """The fields with keys of a group type, whose keys begin with a prefix, in declaration order."""
    hints, declared = get_type_hints(group, include_extras=True), fields(group)
    own = own_prefix(group, prefix)
    found = []
    for field in declared:
        hint, metadata = hints[field.name], ()
        if get_origin(hint) is Annotated:
            hint, *metadata = get_args(hint)
        if Mark.CONTENT in metadata:
            continue
        given = next((item.name for item in metadata if isinstance(item, Key)), None)
        choice = next((item for item in metadata if isinstance(item, PartChoice)), None)
        found.append(
            Slot(
                field=field.name,
                hint=hint,
                metadata=tuple(metadata),
                default=field.default,
                key=own + field.name if given is None else prefix + given,
                below=f"{prefix}{given or field.name}.",
                beside=f"{prefix}{choice.table}." if choice and choice.table else prefix,
                plain=hint in PLAIN or get_origin(hint) is Literal or _all_plain(get_args(hint)),
                choice=choice,
                choice_key=prefix + choice.key if choice else "",
                choices=next((item for item in metadata if isinstance(item, PartChoices)), None),
            )
        )
    return tuple(found)


def own_prefix(group: type, prefix: str) -> str:
    """What the keys of a group's own scalars begin with: a part's, in its own table."""
    table = group.table() if issubclass(group, Part) else ""
    return f"{prefix}{table}." if table else prefix


def _all_plain(options: tuple[Any, ...]) -> bool:
    return bool(options) and all(option in PLAIN for option in options)


PLAIN = (float, int, bool, str, tuple[float, ...], type(None))
"""Types of scalars; a list of numbers counts as one."""


def describe(group: type, prefix: str = "") -> dict[str, Leaf]:
    """Every scalar below a dataclass type, nested groups and every registered part included, in declaration order.

    Args:
        group: a dataclass type whose scalar fields are annotated with a `Quantity`.
        prefix: put before every key.

    Returns:
        Dotted key → `Leaf`.

    Raises:
        ConfigurationError: a scalar field has no `Quantity`, or a constraint that is no bound.
    """
    found: dict[str, Leaf] = {}
    for _, leaf in every_leaf(group, prefix):
        found.setdefault(leaf.key, leaf)
    return found


def every_leaf(group: type, prefix: str = "") -> Iterator[tuple[type, Leaf]]:
    """Every scalar as in `describe`, with the group that has it; a key that several parts share comes with each."""
    for slot in slots(group, prefix):
        if slot.choice:
            yield group, _choice_leaf(slot, tuple(slot.choice.registry))
            for part in slot.choice.registry.values():
                for _, leaf in every_leaf(part, slot.beside):
                    yield part, leaf
        elif slot.choices:
            yield group, _kinds_leaf(slot, tuple(slot.choices.registry))
            for part in slot.choices.registry.values():
                for _, leaf in every_leaf(part, slot.below):
                    yield part, leaf
        elif isinstance(slot.hint, type) and is_dataclass(slot.hint):
            tied = slot.find(Tied)
            for owner, leaf in every_leaf(slot.hint, slot.below):
                yield owner, _tied(leaf, slot) if tied else leaf
        else:
            yield group, _leaf(group, slot)


def describe_parts(group: Any, prefix: str = "") -> Mapping[str, Leaf]:
    """Every scalar below an instance, by the types of the parts it is made of; keys as in `leaves`.

    Args:
        group: an instance of a dataclass, whose parts may be of any dataclass type.
        prefix: put before every key.

    Raises:
        ConfigurationError: a scalar field has no `Quantity`, or a constraint that is no bound; a part is none; or two
            parts mean something else by a key.
    """
    shape = _shape(group, prefix), prefix
    if shape not in _described:
        _described[shape] = MappingProxyType(_describe_parts(group, prefix))
    return _described[shape]


_described: dict[tuple[Any, str], Mapping[str, Leaf]] = {}
"""What groups of a shape are, once they have been asked for."""


def _shape(group: Any, prefix: str) -> tuple[Any, ...]:
    """What the description of a group depends on: the types of its groups and the shapes of its arrays."""
    found: list[Any] = [type(group)]
    for slot in slots(type(group), prefix):
        if slot.plain:
            continue
        value = getattr(group, slot.field)
        if slot.choice:
            check_base(slot, value)
            found.append(tuple(slot.choice.registry))
        if slot.choices:
            found.append((tuple(slot.choices.registry), *(_shape(part, slot.below) for part in value)))
        elif is_dataclass(value):
            found.append(_shape(value, slot.below))
        elif is_array(value):
            found.append(value.shape)
    return tuple(found)


def _describe_parts(group: Any, prefix: str) -> dict[str, Leaf]:
    described: list[tuple[type, Mapping[str, Leaf]]] = []
    for slot in slots(type(group), prefix):
        value = getattr(group, slot.field)
        if slot.choices:
            kinds = dict.fromkeys((*slot.choices.registry, *(part.kind for part in value)))
            described.append((type(group), {slot.key: _kinds_leaf(slot, tuple(kinds))}))
            described += [(type(part), describe_parts(part, slot.below)) for part in value]
            continue
        if isinstance(value, Part) and slot.choice:
            choices = dict.fromkeys((*slot.choice.registry, value.kind))
            described.append((type(group), {slot.choice_key: _choice_leaf(slot, tuple(choices))}))
        described.append(_describe_value(type(group), slot, value))
    for part, own in described:
        if issubclass(part, Part) and part is not type(group) and not built_in(part):
            others = ((owner, leaf) for owner, known in described if known is not own for leaf in known.values())
            check_keys(part, own, others)
    return {key: leaf for _, known in described for key, leaf in known.items()}


def _describe_value(group: type, slot: Slot, value: Any) -> tuple[type, Mapping[str, Leaf]]:
    """Every scalar of a field's value, with the group that has it."""
    if isinstance(value, Part):
        return type(value), describe_parts(value, slot.beside)
    if is_dataclass(value):
        below = describe_parts(value, slot.below)
        return type(value), {key: _tied(leaf, slot) for key, leaf in below.items()}
    if is_array(value) or slot.find(Elements):
        return group, _element_leaves(group, slot, tuple(elements(value)) if is_array(value) else ("",))
    return group, {slot.key: _leaf(group, slot)}


def check_keys(part: type, own: Mapping[str, Leaf], others: Iterable[tuple[type, Leaf]]) -> None:
    """Raise `ConfigurationError` where a part means something else by a key than others that have it.

    Parts may share a group of numbers, and its keys; they may not by accident.

    Args:
        part: the part.
        own: what it is described as.
        others: scalars of others, each with the group that has it.
    """
    tables = {key[:end] for key in own for end, character in enumerate(key) if character == "."}
    for owner, leaf in others:
        if Mark.PARTS in leaf.marks:  # a list of kinds, and the table of those parts' own numbers
            continue
        mine, above = own.get(leaf.key), (key for key in own if leaf.key.startswith(f"{key}."))
        if leaf.key in tables or any(above) or (mine is not None and not _alike(mine, leaf)):
            raise ConfigurationError(
                f"{named(part)}: the key {leaf.key} is taken by {owner.__qualname__}; "
                "give the part another kind, or its field another name"
            )


def _alike(leaf: Leaf, other: Leaf) -> bool:
    return replace(leaf, default=None, tied=None) == replace(other, default=None, tied=None)


def _tied(leaf: Leaf, slot: Slot) -> Leaf:
    tied = slot.find(Tied)
    return replace(leaf, tied=f"{slot.beside}{tied.name}.{leaf.key.removeprefix(slot.below)}") if tied else leaf


@cache
def _element_leaves(group: type, slot: Slot, ends: tuple[str, ...]) -> Mapping[str, Leaf]:
    """What the elements of an array are, by their keys."""
    each = slot.find(Elements)
    if each is None:
        leaf = _leaf(group, slot)
        return {slot.key + end: replace(leaf, key=slot.key + end) for end in ends}
    if len(ends) != len(each.quantities):
        raise ConfigurationError(
            f"{group.__qualname__}.{slot.field}: has {len(ends)} elements; its Elements(...) must be as many, "
            f"not {len(each.quantities)}"
        )
    described = zip(ends, each.quantities, each.marks, strict=True)
    return {slot.key + end: Leaf(slot.key + end, quantity, float, marks=marks) for end, quantity, marks in described}


@cache
def _choice_leaf(slot: Slot, choices: tuple[str, ...]) -> Leaf:
    return Leaf(slot.choice_key, slot.find(Quantity), str, choices, marks=frozenset({Mark.PART}))


@cache
def _kinds_leaf(slot: Slot, choices: tuple[str, ...]) -> Leaf:
    return Leaf(slot.key, slot.find(Quantity), tuple, choices, marks=frozenset({Mark.PARTS}), default=())


@cache
def _leaf(group: type, slot: Slot) -> Leaf:
    quantity, name = slot.find(Quantity), f"{group.__name__}.{slot.field}"
    if quantity is None:
        raise ConfigurationError(
            f'{name} has no Quantity; write {slot.field}: Annotated[{_word(slot.hint)}, Quantity("unit", "meaning")]'
        )
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


def _word(hint: Any) -> str:
    return hint.__name__ if isinstance(hint, type) else str(hint).removeprefix("typing.")


def _bounds(metadata: tuple[Any, ...], name: str) -> Iterator[at.BaseMetadata]:
    for item in metadata:
        if isinstance(item, at.GroupedMetadata):  # an interval
            yield from _bounds(tuple(item), name)
        elif isinstance(item, (at.Gt, at.Ge, at.Lt, at.Le)):
            yield item
        elif isinstance(item, at.BaseMetadata):
            raise ConfigurationError(
                f"{name}: {item} is no bound; use Gt, Ge, Lt, Le or Interval, and a Rule for the rest"
            )


def owners(group: type, key: str, prefix: str = "") -> tuple[str, tuple[str, ...]]:
    """Whose a key is: the key that chooses among parts below a group type, and the registered kinds that have it."""
    for slot in slots(group, prefix):
        found = "", ()
        if slot.choice:
            kinds = slot.choice.registry.items()
            found = slot.choice_key, tuple(kind for kind, part in kinds if key in describe(part, slot.beside))
        elif slot.choices:
            kinds = slot.choices.registry.items()
            found = slot.key, tuple(kind for kind, part in kinds if key in describe(part, slot.below))
        elif isinstance(slot.hint, type) and is_dataclass(slot.hint):
            found = owners(slot.hint, key, slot.below)
        if found[1]:
            return found
    return "", ()
