"""Numbers as people read them."""

from dualwinch.model.quantities.html import readable_unit

SMALLER = {
    "m": ((1e3, "mm"), (1e6, "µm")),
    "s": ((1e3, "ms"), (1e6, "µs")),
    "m/s": ((1e3, "mm/s"),),
    "m^2": ((1e6, "mm²"),),
    "of nominal": ((100.0, "%"),),
}
"""Unit → factors and names of the units in which smaller values of it are read."""

SMALL = 0.1
"""Below this a value is read in a smaller unit; a share of the nominal value always is."""


def plain(value: float) -> str:
    """A number of three digits; without an exponent where it is neither tiny nor huge."""
    rounded = f"{value:.3g}"
    text = f"{float(rounded):.10g}" if 1e-4 <= abs(value) < 1e7 else rounded
    return text.replace("-", "−")


def scaled_unit(largest: float, unit: str) -> tuple[float, str]:
    """Factor and name of the unit in which numbers up to a largest one are read."""
    factor, name = 1.0, readable_unit(unit)
    for larger, smaller in SMALLER.get(unit, ()):
        if abs(largest) * factor < SMALL or unit == "of nominal":
            factor, name = larger, smaller
    return factor, name


def with_unit(values: list[float], unit: str) -> tuple[list[str], str]:
    """Numbers in a unit that suits the largest of them, and what stands behind it, with a space."""
    factor, name = scaled_unit(max(map(abs, values)), unit)
    return [plain(factor * value) for value in values], f" {name}".rstrip()


def multiple(size: float) -> str:
    """A size as a multiple of the ensemble's, such as ``0.0075×``."""
    return f"{float(f'{size:.2g}'):g}×"
