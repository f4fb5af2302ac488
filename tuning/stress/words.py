"""Numbers as people read them."""

from collections.abc import Sequence

from dualwinch.model.quantities.html import readable_unit
from dualwinch.model.quantities.quantity import Quantity

SHARE = "share"
"""Stands for the unit of a number that is a share of something, and is read in per cent."""

SMALLER = {
    "m": ((1e3, "mm"), (1e6, "µm")),
    "s": ((1e3, "ms"), (1e6, "µs")),
    "m/s": ((1e3, "mm/s"),),
    "m^2": ((1e6, "mm²"),),
    SHARE: ((100.0, "%"),),
}
"""Unit → factors and names of the units in which smaller values of it are read."""

SMALL = 0.1
"""Below this a value is read in a smaller unit; a share always is."""


TINY, HUGE = 1e-4, 1e7
"""Numbers beyond these have an exponent."""


def unit_of(quantity: Quantity) -> str:
    """The unit a number is read in: `SHARE` where its meaning says so."""
    return SHARE if quantity.unit == "1" and "share" in quantity.meaning.split() else quantity.unit


def plain(value: float, digits: int = 3) -> str:
    """A number of some digits, a whole one in full; without an exponent where it is neither tiny nor huge."""
    rounded = f"{value:.{digits}g}"
    if value == round(value) and abs(value) < HUGE:
        return f"{round(value)}".replace("-", "−")
    text = f"{float(rounded):.10g}" if TINY <= abs(value) < HUGE else rounded
    return text.replace("-", "−")


def scaled_unit(largest: float, unit: str) -> tuple[float, str]:
    """Factor and name of the unit in which numbers up to a largest one are read."""
    factor, name = 1.0, readable_unit(unit)
    for larger, smaller in SMALLER.get(unit, ()):
        if abs(largest) * factor < SMALL or unit == SHARE:
            factor, name = larger, smaller
    return factor, name


def with_unit(values: Sequence[float], unit: str) -> tuple[list[str], str]:
    """Numbers in a unit that suits the largest of them, and what stands behind them, with a space.

    They have as many digits as it takes to tell them apart, up to six.
    """
    factor, name = scaled_unit(max(map(abs, values)), unit)
    words: list[str] = []
    for digits in range(3, 7):
        words = [plain(factor * value, digits) for value in values]
        if len(set(words)) == len(set(values)):
            break
    return words, f" {name}".rstrip()


def multiple(size: float) -> str:
    """A size as a multiple of the ensemble's, such as ``0.0075×``."""
    return f"{float(f'{size:.2g}'):g}×"
