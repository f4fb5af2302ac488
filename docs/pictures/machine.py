"""The machine with the symbols of its equations and their positive directions."""

from xml.etree.ElementTree import Element

import numpy as np

from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.plots.style import BLUE, GREY, INK, VERMILION
from dualwinch.toolboxes.lab.animation import (
    DRUM,
    DRUM_GAP,
    FRAME_COLUMNS,
    LEFT,
    RIGHT,
    WATER,
    WIDTH,
    Machine,
    Play,
    add,
    draw_machine,
    number,
    picture,
    text,
    written,
)

HEIGHT, RAIL = 236, 172.0
"""Height of the picture and vertical position of the rail in pixels."""

SHOWN_AT = 0.42
"""Position of the vehicle as a share of the rail."""


def labelled_machine() -> str:
    """The paper's machine as an SVG with symbols and positive directions."""
    machine = Machine(Experiment(), RAIL)
    x, preload = np.array([SHOWN_AT * machine.length]), np.array([0.2 * machine.highest])
    frames = dict.fromkeys(FRAME_COLUMNS, np.zeros(1)) | {"x": x, "x_ref": x + 6.0, "F1": preload, "F2": preload}
    title = "The machine: a vehicle on a rail between two winches, with the symbols of its equations"
    root = picture(WIDTH, HEIGHT, title, "Arrows point in the positive direction of each quantity.")
    add(root, "rect", width=WIDTH, height=HEIGHT, rx=10, fill="white")
    add(root, "rect", y=14, width=WIDTH, height=RAIL - 8, fill=WATER)
    draw_machine(root, machine, frames, Play(0.0, 0))
    _winches(root, machine)
    _forces(root, machine, float(machine.at(x)[0]))
    return written(root)


def _winches(root: Element, machine: Machine) -> None:
    for x, name, index, turn in ((LEFT - DRUM_GAP, "winch 2", "₂", -1), (RIGHT + DRUM_GAP, "winch 1", "₁", 1)):
        y, r = machine.rope + DRUM, DRUM + 10
        text(root, x, machine.rope - 62, name, text_anchor="middle", font_weight="bold")
        start, end = (x - turn * 0.77 * r, y - 0.64 * r), (x + turn * 0.5 * r, y - 0.87 * r)
        sweep = 1 if turn > 0 else 0
        d = f"M{number(start[0])} {number(start[1])}A{r:g} {r:g} 0 0 {sweep} {number(end[0])} {number(end[1])}"
        add(root, "path", d=d, fill="none", stroke=BLUE, stroke_width=2)
        head = (number(end[0]), number(end[1]))
        add(root, "path", d=f"M{head[0]} {head[1]}l{-turn * 8} -7l{-turn * -1} 9z", fill=BLUE, stroke=BLUE)
        text(root, x, machine.rope - 42, f"θ{index}, ω{index}, τ{index}", text_anchor="middle", fill=BLUE)
        text(root, x, machine.rope - 25, "retrieving", text_anchor="middle", font_size=11, fill=GREY)


def _forces(root: Element, machine: Machine, x: float) -> None:
    half, y, top = machine.size[0] / 2, machine.rope, machine.top
    for side, name, index in ((1, "rope 1: L − x", "₁"), (-1, "rope 2: x", "₂")):
        begin = x + side * (half + 4)
        _arrow(root, begin, y, side * 58, VERMILION)
        text(root, begin + side * 30, y - 10, f"F{index}", text_anchor="middle", font_size=15, fill=VERMILION)
        middle = (x + half + RIGHT) / 2 + 40 if side > 0 else (LEFT + x - half) / 2 - 40
        text(root, middle, y - 10, f"{name} long", text_anchor="middle", fill=GREY)
    text(root, x, top - 44, "mass m", text_anchor="middle", fill=GREY)
    _arrow(root, x, top - 14, 44, BLUE)
    text(root, x - 8, top - 9, "x, v", text_anchor="end", fill=BLUE, font_size=15)
    text(root, x + 6 * machine.scale + 10, top - 9, "reference x_ref; error e = x − x_ref", fill=INK, font_size=12)
    _arrow(root, x - half - 4, machine.rail - 4, -44, GREY)
    text(root, x - half - 54, machine.rail - 4, "friction and drag", text_anchor="end", fill=GREY, font_size=11)
    _arrow(root, x + half + 4, machine.rail - 4, 44, VERMILION)
    text(root, x + half + 54, machine.rail - 4, "disturbance d", fill=VERMILION, font_size=11)
    text(root, (LEFT + RIGHT) / 2, HEIGHT - 10, f"rail, L = {machine.length:g} m", text_anchor="middle")


def _arrow(root: Element, x: float, y: float, length: float, colour: str) -> None:
    """Draw a horizontal arrow from a point."""
    barb = 6 if length < 0 else -6
    d = f"M{number(x)} {number(y)}h{number(length)}m{barb} {barb}l{-barb} {-barb}l{barb} {-barb}"
    add(root, "path", d=d, fill="none", stroke=colour, stroke_width=2.5)
