"""Names of gains and statistics as figures and tables show them."""

from dualwinch.simulation.ensembles.result import Statistic

ABBREVIATIONS = ("mse", "mae")


def axis_title(statistic: Statistic) -> str:
    """Statistic with its unit, as on an axis."""
    unit = shown_unit(statistic.unit)
    return f"{shown_name(statistic.name)}{f' ({unit})' if unit else ''}"


def shown_name(name: str) -> str:
    """Name of a statistic in words."""
    words = name.replace(".", " ").replace("_", " ").split()
    return " ".join(word.upper() if word in ABBREVIATIONS else word for word in words)


def shown_unit(unit: str) -> str:
    """A unit as printed; empty for a pure number."""
    return "" if unit == "1" else unit.replace("^2", "²")


def short(name: str) -> str:
    """A dimension's name without what all of them share."""
    return name.removeprefix("controller.")
