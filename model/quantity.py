"""What a number is: unit, meaning and source, written once beside the field it describes.

Parameters and signals are frozen dataclasses whose fields are annotated with a `Quantity` and, for parameters,
with bounds from `annotated_types`. Everything else that needs the names, units or bounds (validation, the
annotated TOML, result columns, the C header) reads them from here.

The same dataclass holds floats or CasADi symbols: `leaves` takes it apart into named scalars, `with_leaves` puts
it together again from others.
"""

import difflib
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import annotated_types as at

Group = TypeVar("Group")


@dataclass(frozen=True)
class Quantity:
    """Unit, meaning and source of one number ("1" is the unit of a pure number)."""

    unit: str
    meaning: str
    source: str = ""


def behind_number(unit: str) -> str:
    """A unit as it stands behind a number, with a space; nothing for a pure number."""
    return "" if unit == "1" else f" {unit}"


@dataclass(frozen=True)
class Tunable:
    """Where a gain is searched for when it is tuned, in its own unit.

    Attributes:
        lower, upper: bounds of the search.
        log: whether factors count, not differences.
        standard: whether it is tuned where nobody says what to tune.
    """

    lower: float
    upper: float
    log: bool = True
    standard: bool = True


@dataclass(frozen=True)
class Leaf:
    """One scalar of a group: its dotted key, its quantity, its type and its bounds.

    Attributes:
        key: dotted path below the group, e.g. ``vehicle.mass``.
        quantity: unit, meaning and source.
        kind: the Python type (``float``, ``int``, ``bool``, ``str`` or a ``Literal``), without ``None``.
        optional: whether ``None`` (a default taken from elsewhere) is allowed.
        constraints: the bounds from `annotated_types`.
        tunable: where it is searched for when it is tuned; ``None``: it is no gain.
    """

    key: str
    quantity: Quantity
    kind: Any
    optional: bool
    constraints: tuple[at.BaseMetadata, ...]
    tunable: Tunable | None = None

    @property
    def allowed(self) -> str:
        """The allowed range in words, e.g. ``> 0`` or ``0 to 1``; empty where anything goes."""
        words: list[str] = []
        for constraint in self.constraints:
            match constraint:
                case at.Gt(gt=bound):
                    words.append(f"> {bound:g}")
                case at.Ge(ge=bound):
                    words.append(f">= {bound:g}")
                case at.Lt(lt=bound):
                    words.append(f"< {bound:g}")
                case at.Le(le=bound):
                    words.append(f"<= {bound:g}")
                case _:
                    pass
        if self.kind is bool:
            words.append("true or false")
        words.extend(f'"{choice}"' for choice in self.choices)
        return (" or " if self.choices else " and ").join(words)

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper end of the allowed range, infinite where there is none."""
        lower, upper = (0.0, 1.0) if self.kind is bool else (-math.inf, math.inf)
        for constraint in self.constraints:
            lower = max(lower, getattr(constraint, "gt", lower), getattr(constraint, "ge", lower))
            upper = min(upper, getattr(constraint, "lt", upper), getattr(constraint, "le", upper))
        return lower, upper

    @property
    def choices(self) -> tuple[str, ...]:
        """The allowed words of a ``Literal``; empty for numbers."""
        return tuple(str(choice) for choice in get_args(self.kind))

    @property
    def is_number(self) -> bool:
        """Whether the value is a number at run time (and not a choice of structure)."""
        return self.kind in {float, int}


@cache
def describe(group: type) -> dict[str, Leaf]:
    """Every scalar below a dataclass type, nested groups included, in declaration order.

    Args:
        group: a dataclass type whose scalar fields are annotated with a `Quantity`.

    Returns:
        Dotted key → `Leaf`.

    Raises:
        TypeError: a scalar field has no `Quantity`.
    """
    return {leaf.key: leaf for leaf in _describe(group, "")}


def _describe(group: type, prefix: str) -> Iterator[Leaf]:
    hints = get_type_hints(group, include_extras=True)
    for field in fields(group):
        hint, key = hints[field.name], prefix + field.name
        if is_dataclass(hint) and isinstance(hint, type):
            yield from _describe(hint, key + ".")
        else:
            yield _leaf(hint, key, f"{group.__name__}.{field.name}")


def describe_parts(group: Any, prefix: str = "") -> dict[str, Leaf]:
    """Every scalar below an instance, by the types of the parts it is made of; keys as in `leaves`.

    Args:
        group: an instance of a dataclass, whose parts may be of any dataclass type.
        prefix: put before every key.

    Raises:
        TypeError: a scalar field has no `Quantity`.
    """
    found: dict[str, Leaf] = {}
    hints = get_type_hints(type(group), include_extras=True)
    for field in fields(group):
        value, key = getattr(group, field.name), prefix + field.name
        if is_dataclass(value):
            found |= describe_parts(value, key + ".")
        else:
            found[key] = _leaf(hints[field.name], key, f"{type(group).__name__}.{field.name}")
    return found


def _leaf(hint: Any, key: str, where: str) -> Leaf:
    base, metadata = hint, ()
    if get_origin(hint) is Annotated:
        base, *metadata = get_args(hint)
    quantity = next((item for item in metadata if isinstance(item, Quantity)), None)
    if quantity is None:
        raise TypeError(f"{where} has no Quantity")
    options = [option for option in get_args(base) if option is not type(None)]
    optional = type(None) in get_args(base)
    return Leaf(
        key=key,
        quantity=quantity,
        kind=options[0] if optional else base,
        optional=optional,
        constraints=tuple(item for item in metadata if isinstance(item, at.BaseMetadata)),
        tunable=next((item for item in metadata if isinstance(item, Tunable)), None),
    )


def nearest(key: str, keys: Iterable[str]) -> str:
    """The key most like a mistaken one: as a whole, else in its last part."""
    known = list(keys)
    near = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    if near:
        return near[0]
    names = {name.rsplit(".", 1)[-1]: name for name in reversed(known)}
    near = difflib.get_close_matches(key.rsplit(".", 1)[-1], list(names), n=1, cutoff=0.0)
    return names[near[0]]


def leaves(group: Any, prefix: str = "") -> dict[str, Any]:
    """Take a dataclass apart into its scalars.

    Args:
        group: an instance of a (nested) dataclass.
        prefix: put before every key, with its dot, e.g. ``"plant."``.

    Returns:
        Dotted key → value, in declaration order.
    """
    found: dict[str, Any] = {}
    for field in fields(group):
        value = getattr(group, field.name)
        if is_dataclass(value):
            found |= leaves(value, f"{prefix}{field.name}.")
        else:
            found[prefix + field.name] = value
    return found


def with_leaves(group: Group, values: Mapping[str, Any], prefix: str = "") -> Group:
    """A copy of a dataclass with some of its scalars replaced.

    Args:
        group: an instance of a (nested) dataclass.
        values: dotted key → new value; keys that name nothing here are ignored.
        prefix: what the keys of this group begin with, e.g. ``"plant."``.
    """
    changes: dict[str, Any] = {}
    for field in fields(group):  # pyright: ignore[reportArgumentType]
        value, key = getattr(group, field.name), prefix + field.name
        if is_dataclass(value):
            changes[field.name] = with_leaves(value, values, key + ".")
        elif key in values:
            changes[field.name] = values[key]
    return replace(group, **changes)  # pyright: ignore[reportArgumentType]


def numbers(group: Any, prefix: str = "") -> dict[str, float]:
    """The scalars of a dataclass that are numbers at run time: what a compiled function takes as parameters."""
    kinds = describe(type(group))
    return {prefix + key: value for key, value in leaves(group).items() if kinds[key].is_number and value is not None}
