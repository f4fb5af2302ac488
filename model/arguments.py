"""Arguments of public functions, checked: an error says in one line what each must be."""

from typing import Any

import numpy as np

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import shown


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
