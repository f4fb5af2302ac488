"""Values and rules of a group of numbers, checked: errors name the key and what is allowed."""

from typing import Any

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.numbers import numbers_of
from dualwinch.model.quantities.part import HOW_TO_REGISTER
from dualwinch.model.quantities.quantity import Leaf, Mark
from dualwinch.model.quantities.tree import pairs, rules


def shown(value: Any) -> str:
    """A value as an error shows it: as TOML writes it, and never longer than a line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    try:
        text = f'"{value}"' if isinstance(value, str) else repr(value)
    except ValueError:  # a whole number of more digits than Python prints
        text = "a number too large to show"
    return text if len(text) <= 60 else f"{text[:57]}..."


def validated(leaf: Leaf, value: Any) -> Any:
    """The value of a leaf, of the leaf's type.

    Raises:
        ConfigurationError: it is of another type or out of range.
    """
    if not leaf.admits(value):
        hint = "" if leaf.marks.isdisjoint({Mark.PART, Mark.PARTS}) else f" ({HOW_TO_REGISTER})"
        raise ConfigurationError(f"{leaf.key} = {shown(value)}: must be {leaf.wanted}{hint}")
    if Mark.PARTS in leaf.marks:
        return (value,) if isinstance(value, str) else tuple(value)
    if leaf.kind is tuple:
        return numbers_of(value)
    return float(value) if leaf.kind is float and value is not None else value


def check_values(group: Any, prefix: str = "") -> None:
    """Raise `ConfigurationError` where a value is of the wrong type or out of range, or is another in another part."""
    known = describe_parts(group, prefix)
    found: dict[str, Any] = {}
    for key, value in pairs(group, prefix, whole=True):
        if key not in known or type(value) is list:  # an array or a list has no hash, by which code is found again
            kind = "a list" if key in known else "an array"
            raise ConfigurationError(f"{key}: is {kind}; must be a number, or a tuple of numbers")
        if not known[key].admits(value):
            raise ConfigurationError(f"{key} = {shown(value)}: must be {known[key].wanted}")
        if found.setdefault(key, value) != value:
            raise ConfigurationError(f"{key} = {shown(value)}: must be {shown(found[key])}, as another part has it")


def check_rules(group: Any, prefix: str = "") -> None:
    """Raise `ConfigurationError` where values of a group do not go together."""
    for table, owner, rule in rules(group, prefix):
        if not rule.holds(owner):
            blamed = getattr(owner, rule.fields[0])
            raise ConfigurationError(f"{table}{rule.fields[0]} = {blamed:g}: {rule.wanted(owner, table)}")
