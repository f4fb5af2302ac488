"""Lists of numbers as fields of groups."""

import math
from typing import Any


class Numbers(tuple[float, ...]):
    """A list of numbers, however long, as a field of a group that is hashed and compared time and again.

    Its hash is computed once, and it equals itself without a look at its elements.
    """

    _hash: int | None = None

    def __hash__(self) -> int:
        if self._hash is None:
            self._hash = super().__hash__()
        return self._hash

    def __eq__(self, other: object) -> bool:
        return self is other or super().__eq__(other)

    def __ne__(self, other: object) -> bool:
        return not self == other


def numbers_of(values: Any) -> Any:
    """A list or tuple as `Numbers`, its elements floats; anything else, which has yet to be refused, as it is."""
    if isinstance(values, Numbers) or not isinstance(values, (list, tuple)):
        return values
    plain = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values)
    return Numbers(map(_as_float, values) if plain else values)


def _as_float(value: float) -> float:
    """A number as a float; a whole number beyond every float is infinite."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


NONE = Numbers()
"""No numbers."""
