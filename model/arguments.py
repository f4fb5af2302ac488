"""Checks of public functions' arguments: a wrong type is a one-line error that names the argument."""

from collections.abc import Collection, Iterable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import shown

WORDS = {str: "a text", PathLike: "a path", Mapping: "a dictionary"}
"""Type → its name in error messages."""


def instance(name: str, value: Any, *kinds: type, hint: str = "", optional: bool = False) -> None:
    """Raise `ConfigurationError` for an argument that is an instance of none of the types.

    None is allowed where `optional`. The hint follows the allowed types in the message.
    """
    if not isinstance(value, kinds) and not (optional and value is None):
        *alternatives, last = (
            WORDS.get(kind) or f"a{'n' * (kind.__name__[0] in 'AEIOU')} {kind.__name__}" for kind in kinds
        )
        types = f"{', '.join(alternatives)} or {last}" if alternatives else last
        raise ConfigurationError(f"{name}: must be {types}{hint}, not {type(value).__name__}")


def path_of(name: str, value: Any) -> Path:
    """The path of a file or folder.

    Raises:
        ConfigurationError: it is no path.
    """
    try:
        return Path(value)
    except TypeError as error:
        raise ConfigurationError(f"{name}: must be a path, not {type(value).__name__}") from error


def suffix_of(path: Path, allowed: Collection[str]) -> str:
    """The suffix of a path in lower case.

    Raises:
        ConfigurationError: it is none of the allowed ones.
    """
    if (suffix := path.suffix.lower()) not in allowed:
        one_of = "one of " if len(allowed) > 1 else ""
        raise ConfigurationError(f"{path.name}: unknown suffix {path.suffix!r}; must be {one_of}{', '.join(allowed)}")
    return suffix


def texts(name: str, value: Any) -> list[str]:
    """One text or several, as a list.

    Raises:
        ConfigurationError: an element is no text.
    """
    listed = list(value) if isinstance(value, Iterable) and not isinstance(value, str) else [value]
    for each in listed:
        if not isinstance(each, str):
            raise ConfigurationError(f"{name}: must be a text or a list of texts, not {shown(each)}")
    return listed


def one_number(name: str, value: Any, hint: str = "") -> float:
    """One number, or an array of one element; the hint names a function that takes many numbers.

    Raises:
        ConfigurationError: it is no number, or more than one.
    """
    values = number_array(name, value, "a number")
    if values.size != 1:
        raise ConfigurationError(f"{name}: must be one number, not {values.size}{hint}")
    return float(values.item())


def number_array(name: str, values: Any, wanted: str = "a number or an array of numbers") -> NDArray[np.float64]:
    """A number or an array of numbers, as an array.

    Raises:
        ConfigurationError: an element is no number.
    """
    try:
        array = np.asarray(values)
        if array.dtype.kind in "biufO" and not any(value is None for value in array.flat):
            return array.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        pass
    raise ConfigurationError(f"{name}: must be {wanted}, not {type(values).__name__}")


def whole_number(name: str, value: Any, least: int = 0, most: int | None = None) -> int:
    """A whole number within a range.

    Raises:
        ConfigurationError: it is no whole number, or out of range.
    """
    is_integer = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not (is_integer and least <= value and (most is None or value <= most)):
        allowed = f">= {least}" if most is None else f"from {least} to {most}"
        raise ConfigurationError(f"{name} = {shown(value)}: must be a whole number {allowed}")
    return int(value)
