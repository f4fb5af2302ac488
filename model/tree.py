"""Groups of numbers as trees: taken apart into named scalars, described, and put together again from others.

A group is a frozen dataclass, of floats or of CasADi symbols, that may hold further groups and parts (`model.part`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import cache
from types import MappingProxyType
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import annotated_types as at

from dualwinch.model.arrays import elements, is_array, rebuilt
from dualwinch.model.part import Choice, Part
from dualwinch.model.quantity import Key, Leaf, Mark, Quantity, Rule, Tied, Tunable, TunableRatio

Group = TypeVar("Group")


@dataclass(frozen=True)
class _Slot:
    """A field of a group type below a prefix.

    Attributes:
        field, hint, metadata, default: its name, type, annotations and default.
        key: of the scalar it holds.
        below: what the keys of a group that it holds begin with.
        beside: what the keys of a part that it holds begin with.
        plain: whether it can only hold a scalar.
        choice: where it holds a part: what there is to choose from.
        choice_key: key of the kind of that part.
    """

    field: str
    hint: Any
    metadata: tuple[Any, ...]
    default: Any
    key: str
    below: str
    beside: str
    plain: bool
    choice: Choice | None
    choice_key: str

    def find(self, kind: type) -> Any:
        """The first piece of metadata of a type."""
        return next((item for item in self.metadata if isinstance(item, kind)), None)


@cache
def _slots(group: type, prefix: str) -> tuple[_Slot, ...]:
    hints, declared = get_type_hints(group, include_extras=True), fields(group)
    own = f"{prefix}{group.table()}." if issubclass(group, Part) else prefix
    found = []
    for field in declared:
        hint, metadata = hints[field.name], ()
        if get_origin(hint) is Annotated:
            hint, *metadata = get_args(hint)
        given = next((item.name for item in metadata if isinstance(item, Key)), None)
        choice = next((item for item in metadata if isinstance(item, Choice)), None)
        found.append(
            _Slot(
                field=field.name,
                hint=hint,
                metadata=tuple(metadata),
                default=field.default,
                key=own + field.name if given is None else prefix + given,
                below=f"{prefix}{given or field.name}.",
                beside=prefix,
                plain=all(option in PLAIN for option in get_args(hint) or (hint,)) or get_origin(hint) is Literal,
                choice=choice,
                choice_key=prefix + choice.key if choice else "",
            )
        )
    return tuple(found)


PLAIN = (float, int, bool, str, type(None))
"""Types of scalars."""


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
    for slot in _slots(group, prefix):
        if slot.choice:
            found[slot.choice_key] = _choice_leaf(slot, tuple(slot.choice.registry))
            for part in slot.choice.registry.values():
                found |= {key: leaf for key, leaf in describe(part, prefix).items() if key not in found}
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
    for slot in _slots(type(group), ""):
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
    for slot in _slots(type(group), prefix):
        value = getattr(group, slot.field)
        if isinstance(value, Part):
            if slot.choice:
                choices = dict.fromkeys((*slot.choice.registry, value.kind))
                found[slot.choice_key] = _choice_leaf(slot, tuple(choices))
            found |= describe_parts(value, prefix)
        elif is_dataclass(value):
            found |= _tied(describe_parts(value, slot.below), slot)
        elif is_array(value):
            leaf = _leaf(type(group), slot)
            found |= {slot.key + end: replace(leaf, key=slot.key + end) for end in elements(value)}
        else:
            found[slot.key] = _leaf(type(group), slot)
    return found


def _tied(found: Mapping[str, Leaf], slot: _Slot) -> Mapping[str, Leaf]:
    tied = slot.find(Tied)
    if tied is None:
        return found
    shared = f"{slot.beside}{tied.name}."
    return {key: replace(leaf, tied=shared + key.removeprefix(slot.below)) for key, leaf in found.items()}


@cache
def _choice_leaf(slot: _Slot, choices: tuple[str, ...]) -> Leaf:
    return Leaf(slot.choice_key, slot.find(Quantity), str, choices, marks=frozenset({Mark.PART}))


@cache
def _leaf(group: type, slot: _Slot) -> Leaf:
    quantity, name = slot.find(Quantity), f"{group.__name__}.{slot.field}"
    if quantity is None:
        raise TypeError(f"{name} has no Quantity")
    optional = type(None) in get_args(slot.hint)
    options = [option for option in get_args(slot.hint) if option is not type(None)]
    kind = options[0] if optional else slot.hint
    choices: tuple[str, ...] = ()
    if get_origin(kind) is Literal:
        kind, choices = str, tuple(str(choice) for choice in get_args(kind))
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


def leaves(group: Any, prefix: str = "", *, whole: bool = False) -> dict[str, Any]:
    """Take a dataclass apart into its scalars; vectors and matrices into their elements.

    Args:
        group: an instance of a (nested) dataclass.
        prefix: put before every key, with its dot, e.g. ``"plant."``.
        whole: leave arrays in one piece, such as signals over the time.

    Returns:
        Dotted key → value, in declaration order; the kind of a part among them.
    """
    return dict(pairs(group, prefix, whole=whole))


def pairs(group: Any, prefix: str = "", *, whole: bool = False) -> Iterator[tuple[str, Any]]:
    """Keys and values as in `leaves`; a key that two parts share comes once for each."""
    for slot in _slots(type(group), prefix):
        value = getattr(group, slot.field)
        if slot.plain:
            found[slot.key] = value
        elif isinstance(value, Part):
            if slot.choice:
                yield slot.choice_key, value.kind
            yield from pairs(value, prefix, whole=whole)
        elif is_dataclass(value):
            yield from pairs(value, slot.below, whole=whole)
        elif is_array(value) and not whole:
            yield from ((slot.key + end, element) for end, element in elements(value).items())
        else:
            yield slot.key, value


def with_leaves(group: Group, values: Mapping[str, Any], prefix: str = "") -> Group:
    """A copy of a dataclass with some of its scalars replaced.

    Another kind of a part is that part with its own defaults, and with what it shares with the one before.

    Args:
        group: an instance of a (nested) dataclass.
        values: dotted key → new value; keys that name nothing here are ignored.
        prefix: what the keys of this group begin with, e.g. ``"plant."``.

    Raises:
        ConfigurationError: a part of an unknown kind.
    """
    changes: dict[str, Any] = {}
    for slot in _slots(type(group), prefix):
        if slot.plain:
            if slot.key in values:
                changes[slot.field] = values[slot.key]
            continue
        value = getattr(group, slot.field)
        if isinstance(value, Part):
            kind = values.get(slot.choice_key, value.kind)
            if slot.choice and kind != value.kind:
                value = with_leaves(slot.choice.registry.find(kind)(), leaves(value, prefix), prefix)
            changes[slot.field] = with_leaves(value, values, prefix)
        elif is_dataclass(value):
            changes[slot.field] = with_leaves(value, values, slot.below)
        elif is_array(value):
            kept = elements(value)
            changes[slot.field] = rebuilt(value, lambda end, key=slot.key, kept=kept: values.get(key + end, kept[end]))
        elif slot.key in values:
            changes[slot.field] = values[slot.key]
    return replace(group, **changes)  # pyright: ignore[reportArgumentType, reportCallIssue]


def owners(group: type, key: str, prefix: str = "") -> tuple[str, tuple[str, ...]]:
    """Whose a key is: the key that chooses among parts below a group type, and the registered kinds that have it."""
    for slot in _slots(group, prefix):
        found = "", ()
        if slot.choice:
            kinds = slot.choice.registry.items()
            found = slot.choice_key, tuple(kind for kind, part in kinds if key in describe(part, prefix))
        elif isinstance(slot.hint, type) and is_dataclass(slot.hint):
            found = owners(slot.hint, key, slot.below)
        if found[1]:
            return found
    return "", ()


def numbers(group: Any, prefix: str = "") -> dict[str, Any]:
    """The scalars of a group that are numbers at run time: what a compiled function takes as parameters."""
    known = describe_parts(group, prefix)
    return {key: value for key, value in leaves(group, prefix).items() if known[key].is_number and value is not None}


def rules(group: Any, prefix: str = "") -> Iterator[tuple[str, Any, Rule]]:
    """Every rule between values below a group: what the keys of its fields begin with, the group it is of, the rule."""
    own = f"{prefix}{group.table()}." if isinstance(group, Part) else prefix
    for rule in getattr(group, "rules", ()):
        yield own, group, rule
    for slot in _slots(type(group), prefix):
        value = None if slot.plain else getattr(group, slot.field)
        if isinstance(value, Part):
            yield from rules(value, prefix)
        elif is_dataclass(value):
            yield from rules(value, slot.below)
