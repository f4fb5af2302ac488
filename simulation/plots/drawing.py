"""Primitives of figures: page, colours, axes and files."""

# ruff: noqa: F401

from dualwinch.simulation.plots.page import GivenAxes, case_number, new_page, save, scenario
from dualwinch.simulation.plots.style import (
    BLUE,
    GOLD,
    GREEN,
    GREY,
    INK,
    LIGHT,
    PURPLE,
    ROPE_COLOURS,
    SKY,
    VERMILION,
    WINE,
    law_label,
    law_look,
    logarithmic,
    looks,
    plain,
    prefixed_unit,
)
from dualwinch.simulation.plots.traces import drawable, largest, thin, within
