"""The scalars of a group: each with its key, quantity, type and bounds, as a `Leaf`.

A group is a frozen dataclass, of floats or of CasADi symbols, that may have further groups and parts
(`model.quantities.part`) as fields. Its `field_marks`, if any, apply to fields without marks. The description of a type
covers every registered part, that of an instance the parts it has.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import cache
from types import MappingProxyType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import annotated_types as at

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.part import Part, PartChoice, built_in, named
from dualwinch.model.quantities.quantity import (
    COMPARISONS,
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
        key: key of its scalar, or of the kind of its parts.
        below: prefix of the keys of the groups in it.
        plain: whether it can only hold a scalar.
        choice: choice of its parts, if any.
        tied: prefix of the keys that its group shares with others; empty without any.
    """

    field: str
    hint: Any
    metadata: tuple[Any, ...]
    default: Any
    key: str
    below: str
    plain: bool
    choice: PartChoice | None
    tied: str

    @property
    def declared(self) -> Any:
        """The type it holds; for ``Any`` the type of its default."""
        return type(self.default) if self.hint is Any and is_dataclass(self.default) else self.hint

    def find(self, kind: type) -> Any:
        """The first piece of metadata of a type."""
        return _first(self.metadata, kind)

    def groups(self, value: Any) -> tuple[Any, ...]:
        """The groups in a value of this field; all registered parts for its type."""
        if self.choice and value is self.hint:
            return tuple(self.choice.registry.values())
        if self.choice and self.choice.several:
            return tuple(value)
        return (value,) if is_dataclass(value) else ()


def _first(metadata: Iterable[Any], kind: type) -> Any:
    return next((item for item in metadata if isinstance(item, kind)), None)


@cache
def slots(group: type, prefix: str) -> tuple[Slot, ...]:
    """The entries of a group type that have keys, below a prefix, in declaration order."""
    hints, default_prefix = get_type_hints(group, include_extras=True), own_prefix(group, prefix)
    entries = []
    for field in fields(group):
        hint, metadata = hints[field.name], ()
        if get_origin(hint) is Annotated:
            hint, *metadata = get_args(hint)
        if Mark.CONTENT in metadata:
            continue
        key, choice, tied = (_first(metadata, kind) for kind in (Key, PartChoice, Tied))
        table = choice.table if choice else key.name if key else field.name
        entries.append(
            Slot(
                field=field.name,
                hint=hint,
                metadata=tuple(metadata),
                default=field.default,
                key=prefix + choice.key if choice else prefix + key.name if key else default_prefix + field.name,
                below=f"{prefix}{table}." if table else prefix,
                plain=hint in PLAIN or get_origin(hint) is Literal or _all_plain(get_args(hint)),
                choice=choice,
                tied=f"{prefix}{tied.name}." if tied else "",
            )
        )
    return tuple(entries)


def own_prefix(group: type, prefix: str) -> str:
    """Prefix of the keys of a group's own scalars; a part has its own table."""
    table = group.table() if issubclass(group, Part) else ""
    return f"{prefix}{table}." if table else prefix


def _all_plain(options: tuple[Any, ...]) -> bool:
    return bool(options) and all(option in PLAIN for option in options)


PLAIN = (float, int, bool, str, tuple[float, ...], type(None))
"""Types of scalars, lists of numbers included."""


def describe(group: type, prefix: str = "") -> dict[str, Leaf]:
    """Every scalar below a dataclass type, nested groups and every registered part included, in declaration order.

    Its scalar fields are annotated with a `Quantity`. Returns dotted keys, all with a prefix, and their `Leaf`.

    Raises:
        ConfigurationError: a scalar field has no `Quantity`, or a constraint that is no bound.
    """
    description: dict[str, Leaf] = {}
    for _, leaf in every_leaf(group, prefix):
        description.setdefault(leaf.key, leaf)
    return description


def every_leaf(group: Any, prefix: str = "") -> Iterator[tuple[type, Leaf]]:
    """Every scalar below a group or a group type, with the part, else the group, that holds it.

    A key shared by several parts is repeated for each.
    """
    owner = group if isinstance(group, type) else type(group)
    for slot in slots(owner, prefix):
        value = slot.declared if group is owner else getattr(group, slot.field)
        inside = () if slot.plain else slot.groups(value)
        if slot.choice:
            kinds = (part.kind for part in inside)
            yield owner, _choice_leaf(slot, tuple(dict.fromkeys((*slot.choice.registry, *kinds))))
        for part in inside:
            part_type = part if isinstance(part, type) else type(part)
            for inner, leaf in every_leaf(part, slot.below):
                tied = replace(leaf, tied=slot.tied + leaf.key.removeprefix(slot.below)) if slot.tied else leaf
                yield part_type if issubclass(part_type, Part) else inner, tied
        if not inside and not slot.choice:
            leaves = _element_leaves(owner, slot, tuple(elements(value)) if is_array(value) else ("",))
            yield from ((owner, leaf) for leaf in leaves)


def describe_parts(group: Any, prefix: str = "") -> Mapping[str, Leaf]:
    """Every scalar below an instance, from the types of its parts; keys as in `leaves`.

    Raises:
        ConfigurationError: a scalar field has no `Quantity`, or a constraint that is no bound; a part is invalid; or
            two parts use one key for different quantities.
    """
    shape = tuple(_shape(group, prefix)), prefix
    if shape not in _described:
        every = list(every_leaf(group, prefix))
        for part in dict.fromkeys(owner for owner, _ in every):
            if issubclass(part, Part) and part is not type(group) and not built_in(part):
                part_leaves = {leaf.key: leaf for owner, leaf in every if owner is part}
                check_keys(part, part_leaves, [(owner, leaf) for owner, leaf in every if owner is not part])
        _described[shape] = MappingProxyType({leaf.key: leaf for _, leaf in every})
    return _described[shape]


_described: dict[tuple[Any, str], Mapping[str, Leaf]] = {}
"""Cache of descriptions by shape."""


def _shape(group: Any, prefix: str) -> Iterator[Any]:
    """Everything the description of a group depends on: the types of its groups and the shapes of its arrays."""
    yield type(group)
    for slot in slots(type(group), prefix):
        if slot.plain:
            continue
        value = getattr(group, slot.field)
        if slot.choice:
            _check_base(slot, value)
            yield tuple(slot.choice.registry)
        inside = slot.groups(value)
        yield value.shape if is_array(value) else len(inside)
        for part in inside:
            yield from _shape(part, slot.below)


def _check_base(slot: Slot, value: Any) -> None:
    """Raise `ConfigurationError` where the value of a part's field is no instance of the part's base."""
    if not (slot.choice and slot.choice.several) and not isinstance(value, slot.hint):
        value_type = f"the class {value.__name__}" if isinstance(value, type) else f"a {type(value).__name__}"
        hint = f"; write {value.__name__}()" if isinstance(value, type) and issubclass(value, slot.hint) else ""
        raise ConfigurationError(f"{slot.key}: must be a {slot.hint.__name__}, not {value_type}{hint}")


def check_keys(part: type, own: Mapping[str, Leaf], others: Iterable[tuple[type, Leaf]]) -> None:
    """Raise `ConfigurationError` where a part's key has another meaning in another part or group.

    Parts may share the keys of a common group of numbers. `others` are scalars with their groups.
    """
    tables = {key[:end] for key in own for end, character in enumerate(key) if character == "."}
    for owner, leaf in others:
        if Mark.PARTS in leaf.marks:  # this key names both the list of kinds and the table of these parts
            continue
        mine, above = own.get(leaf.key), (key for key in own if leaf.key.startswith(f"{key}."))
        if leaf.key in tables or any(above) or (mine is not None and not _alike(mine, leaf)):
            raise ConfigurationError(
                f"{named(part)}: the key {leaf.key} is taken by {owner.__qualname__}; "
                "give the part another kind, or its field another name"
            )


def _alike(leaf: Leaf, other: Leaf) -> bool:
    return replace(leaf, default=None, tied=None) == replace(other, default=None, tied=None)


@cache
def _element_leaves(group: type, slot: Slot, ends: tuple[str, ...]) -> tuple[Leaf, ...]:
    """Leaves of a scalar, or of the elements of an array, by the suffixes of their keys."""
    each = slot.find(Elements)
    if each is None:
        leaf = _leaf(group, slot)
        return tuple(replace(leaf, key=slot.key + end) for end in ends)
    if len(ends) != len(each.quantities):
        raise ConfigurationError(
            f"{group.__qualname__}.{slot.field}: has {len(ends)} elements; its Elements(...) must be as many, "
            f"not {len(each.quantities)}"
        )
    described = zip(ends, each.quantities, each.marks, strict=True)
    return tuple(Leaf(slot.key + end, quantity, float, marks=marks) for end, quantity, marks in described)


@cache
def _choice_leaf(slot: Slot, choices: tuple[str, ...]) -> Leaf:
    """Leaf of the kind of a part, or of the kinds of several."""
    if slot.choice and slot.choice.several:
        return Leaf(slot.key, slot.find(Quantity), tuple, choices, marks=frozenset({Mark.PARTS}), default=())
    return Leaf(slot.key, slot.find(Quantity), str, choices, marks=frozenset({Mark.PART}))


def _leaf(group: type, slot: Slot) -> Leaf:
    quantity, name = slot.find(Quantity), f"{group.__name__}.{slot.field}"
    if quantity is None:
        word = slot.hint.__name__ if isinstance(slot.hint, type) else str(slot.hint).removeprefix("typing.")
        raise ConfigurationError(
            f'{name} has no Quantity; write {slot.field}: Annotated[{word}, Quantity("unit", "meaning")]'
        )
    marks = frozenset(item for item in slot.metadata if isinstance(item, Mark))
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
        marks=marks or getattr(group, "field_marks", frozenset()),
        default=None if slot.default is MISSING else slot.default,
    )


def _bounds(metadata: tuple[Any, ...], name: str) -> Iterator[at.BaseMetadata]:
    for item in metadata:
        if isinstance(item, at.GroupedMetadata):  # an interval
            yield from _bounds(tuple(item), name)
        elif type(item) in COMPARISONS:
            yield item
        elif isinstance(item, at.BaseMetadata):
            raise ConfigurationError(
                f"{name}: {item} is no bound; use Gt, Ge, Lt, Le or Interval, and a Rule for the rest"
            )


def owners(group: type, key: str, prefix: str = "") -> tuple[str, tuple[str, ...]]:
    """Owners of a key: the key that chooses among parts below a group type, and the registered kinds with this key."""
    for slot in slots(group, prefix):
        inside = slot.groups(slot.hint)
        if slot.choice:
            owner = slot.key, tuple(part.kind for part in inside if key in describe(part, slot.below))
        else:
            owner = owners(slot.hint, key, slot.below) if inside else ("", ())
        if owner[1]:
            return owner
    return "", ()
