"""Primitives of figures: page, colours, axes and files."""

from dualwinch.simulation.plots.page import GivenAxes, new_page, save
from dualwinch.simulation.plots.style import (
    BLUE,
    GOLD,
    GREEN,
    GREY,
    INK,
    PURPLE,
    SKY,
    VERMILION,
    WINE,
    logarithmic,
    looks,
    plain,
)

__all__ = [
    "BLUE",
    "GOLD",
    "GREEN",
    "GREY",
    "INK",
    "PURPLE",
    "SKY",
    "VERMILION",
    "WINE",
    "GivenAxes",
    "logarithmic",
    "looks",
    "new_page",
    "plain",
    "save",
]
