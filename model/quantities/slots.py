"""The fields of a group type, and what their keys begin with.

A group is a frozen dataclass, of floats or of CasADi symbols, that may hold further groups and parts
(`model.quantities.part`).
"""

from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.part import Choice, Choices, Part
from dualwinch.model.quantities.quantity import Key, Mark


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
    choice: Choice | None
    choice_key: str
    choices: Choices | None

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
        choice = next((item for item in metadata if isinstance(item, Choice)), None)
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
                choices=next((item for item in metadata if isinstance(item, Choices)), None),
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
