"""Signals of a run below the machine: drawn as time goes by, with a line at the present."""

from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from dualwinch.simulation.animation.svg import Play, add, move, number, path, text
from dualwinch.simulation.plots.style import GREY, INK, LIGHT
from dualwinch.simulation.plots.thin import thin

Floats = NDArray[np.float64]

LEFT, RIGHT = 76.0, 930.0
"""Ends of the time axis in pixels."""


@dataclass(frozen=True)
class Line:
    """A signal of a panel: its name, its colour and its (rows,) values."""

    name: str
    colour: str
    values: Floats


@dataclass(frozen=True)
class Panel:
    """Where a panel stands, and over which values.

    Attributes:
        title: what it shows, with its unit.
        top, bottom: in pixels.
        lines: its signals.
        low, high: ends of its vertical axis.
    """

    title: str
    top: float
    bottom: float
    lines: tuple[Line, ...]
    low: float
    high: float

    def y(self, values: Floats | float) -> Floats:
        """Values as heights in pixels."""
        return self.bottom - (np.asarray(values) - self.low) / (self.high - self.low) * (self.bottom - self.top)


def draw_traces(parent: Element, t: Floats, duration: float, panels: list[Panel], play: Play, frames: int) -> None:
    """Draw panels above each other.

    Args:
        parent: the picture.
        t: (rows,) times of all signals in s.
        duration: end of the time axis in s.
        panels: from the top downwards.
        play: how the frames are played.
        frames: their number.
    """
    scale = (RIGHT - LEFT) / duration
    top, bottom = panels[0].top, panels[-1].bottom
    reveal = add(add(parent, "clipPath", id="past"), "rect", x=LEFT, y=top - 6, height=bottom - top + 12)
    widths = [number(width) for width in np.linspace(0, RIGHT - LEFT, frames)]
    move(reveal, "width", widths, play)
    ticks = MaxNLocator(6).tick_values(0, duration)
    for panel in panels:
        _axes(parent, panel, [(LEFT + scale * value, f"{value:g}") for value in ticks if 0 <= value <= duration])
        for opacity, clip in ((0.18, {}), (1.0, {"clip-path": "url(#past)"})):
            group = add(parent, "g", fill="none", stroke_width=1.4, stroke_linejoin="round", opacity=f"{opacity:g}")
            for name, value in clip.items():
                group.set(name, value)
            for line in panel.lines:
                times, values = thin(t, line.values, 420)
                kept = np.isfinite(values)
                ys = panel.y(np.clip(values[kept], panel.low, panel.high))
                add(group, "path", d=path(LEFT + scale * times[kept], ys), stroke=line.colour)
    for value in ticks:
        if 0 <= value <= duration:
            x = LEFT + scale * value
            text(parent, x, bottom + 16, f"{value:g}", font_size=11, text_anchor="middle", fill=GREY)
    text(parent, RIGHT, bottom + 32, "time (s)", font_size=11, text_anchor="end", fill=GREY)
    now = add(parent, "line", y1=top, y2=bottom, stroke=INK, stroke_width=1)
    for end in ("x1", "x2"):
        move(now, end, [number(LEFT + float(width)) for width in widths], play)


def _axes(parent: Element, panel: Panel, times: list[tuple[float, str]]) -> None:
    for x, _ in times:
        add(parent, "line", x1=x, x2=x, y1=panel.top, y2=panel.bottom, stroke=LIGHT, stroke_width=0.7)
    for value in MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]).tick_values(panel.low, panel.high):
        if panel.low <= value <= panel.high:
            y = float(panel.y(value))
            add(parent, "line", x1=LEFT, x2=RIGHT, y1=y, y2=y, stroke=LIGHT, stroke_width=0.7)
            words = f"{value:g}".replace("-", "−")
            text(parent, LEFT - 8, y + 4, words, font_size=11, text_anchor="end", fill=GREY)
    text(parent, LEFT, panel.top - 9, panel.title, font_size=12)
    x = RIGHT
    for line in reversed(panel.lines if len(panel.lines) > 1 else ()):
        x -= 62
        add(parent, "line", x1=x, x2=x + 16, y1=panel.top - 13, y2=panel.top - 13, stroke=line.colour, stroke_width=2.5)
        text(parent, x + 20, panel.top - 9, line.name, font_size=11)
