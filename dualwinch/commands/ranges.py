"""Ranges of numbers as command lines write them: ``first:last:step``, the last one included."""

import math

from dualwinch.model.errors import ConfigurationError

MOST = 10_000
"""Numbers of a range."""


def numbers_between(text: str, wrong: str) -> list[float] | list[int]:
    """The numbers of ``first:last:step`` or ``first:last:count:log``; whole ones where all of the first three are.

    Args:
        text: the range.
        wrong: what a message begins with where it is none.

    Raises:
        ConfigurationError: no range, or one of too many numbers.
    """
    words = text.split(":")
    if len(words) == 4 and words[3].strip() == "log":
        return _by_factors(words, wrong)
    try:
        first, last, step = (float(word) for word in words)
    except ValueError:
        raise ConfigurationError(wrong) from None
    if not all(map(math.isfinite, (first, last, step))) or step == 0 or (last - first) / step < 0:
        raise ConfigurationError(f"{wrong}; the step must be finite, not 0, and lead from first to last")
    if not math.isfinite((last - first) / step):
        raise ConfigurationError(f"{wrong}; these are too many points, must be <= {MOST}")
    count = math.floor((last - first) / step * (1 + 1e-12) + 1e-9) + 1
    if count > MOST:
        raise ConfigurationError(f"{wrong}; these are {count:.12g} points, must be <= {MOST}")
    if all(word.strip().lstrip("+-").isdecimal() for word in words):
        return [int(first) + k * int(step) for k in range(count)]
    return [round(first + k * step, 12) for k in range(count)]


def _by_factors(words: list[str], wrong: str) -> list[float]:
    try:
        first, last, count = float(words[0]), float(words[1]), int(words[2])
    except ValueError:
        raise ConfigurationError(wrong) from None
    if not (0 < first < math.inf and 0 < last < math.inf and 2 <= count <= MOST):
        raise ConfigurationError(f"{wrong}; first and last must be > 0, and the count 2 to {MOST}")
    inner = [float(f"{first * (last / first) ** (k / (count - 1)):.12g}") for k in range(1, count - 1)]
    return [first, *inner, last]
