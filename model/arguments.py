"""Arguments of public functions, checked: an error says in one line what each must be."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import shown


def instance(name: str, value: Any, *kinds: type, hint: str = "") -> None:
    """Raise `ConfigurationError` for a value that is an instance of none of some types.

    Args:
        name: of the argument.
        value: what was given.
        kinds: the types.
        hint: what more is to be said.
    """
    if not isinstance(value, kinds):
        wanted = " or ".join(f"{'an' if kind.__name__[0] in 'AEIOU' else 'a'} {kind.__name__}" for kind in kinds)
        raise ConfigurationError(f"{name}: must be {wanted}{hint}, not {kind_of(value)}")


def kind_of(value: Any) -> str:
    """The type of a value, as errors call it."""
    return "None" if value is None else type(value).__name__


def one_number(name: str, value: Any, hint: str = "") -> float:
    """One number, of an array only where it has one element.

    Args:
        name: of the argument.
        value: what was given.
        hint: what takes many numbers, if anything.

    Raises:
        ConfigurationError: it is no number, or more than one.
    """
    values = number_array(name, value)
    if values.size != 1:
        raise ConfigurationError(f"{name}: must be one number, not {values.size}{hint}")
    return float(values.item())


def number_array(name: str, values: Any) -> NDArray[np.float64]:
    """A number or an array of numbers, as an array.

    Raises:
        ConfigurationError: something in it is no number.
    """
    try:
        found = np.asarray(values)
        if found.dtype.kind in "biufO" and not any(value is None for value in found.flat):
            return found.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        pass
    raise ConfigurationError(f"{name}: must be a number or an array of numbers, not {kind_of(values)}")


def whole_number(name: str, value: Any, least: int = 0, most: int | None = None) -> int:
    """A whole number within a range.

    Raises:
        ConfigurationError: it is none, or out of range.
    """
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not (whole and least <= value and (most is None or value <= most)):
        allowed = f">= {least}" if most is None else f"from {least} to {most}"
        raise ConfigurationError(f"{name} = {shown(value)}: must be a whole number {allowed}")
    return int(value)
