"""What a file of a result holds, whatever its format: columns, what they are, and facts that travel with them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.quantities.quantity import Quantity

INFINITE = {"INF": math.inf, "-INF": -math.inf}
"""How infinite numbers are written in JSON, which has none: as XML Schema and the W3C's "CSV on the Web" write them."""


@dataclass(frozen=True)
class Content:
    """What a file holds.

    Attributes:
        columns: name → (rows,).
        quantities: name → unit and meaning of every column.
        facts: name → text, or what JSON holds (`plain`).
    """

    columns: Mapping[str, NDArray[Any]]
    quantities: Mapping[str, Quantity]
    facts: Mapping[str, Any]

    @property
    def units(self) -> dict[str, str]:
        """Column → unit."""
        return {name: quantity.unit for name, quantity in self.quantities.items()}


def plain(value: Any) -> Any:
    """A value as JSON holds it: NaN as null, infinite numbers as words."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else ("INF" if value > 0 else "-INF")
    return value


def number(value: Any) -> float:
    """A number that `plain` has written."""
    if value is None:
        return math.nan
    return INFINITE[value] if value in INFINITE else float(value)


def about(quantity: Quantity) -> dict[str, str]:
    """A quantity in texts; what it does not say is left out."""
    given = {"unit": quantity.unit, "meaning": quantity.meaning, "source": quantity.source}
    return {name: text for name, text in given.items() if text or name != "source"}
