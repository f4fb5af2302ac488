"""An animation of a run: the machine above, its signals below, as one SVG that needs no script."""

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from dualwinch.codegen.files import write_whole
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.animation.machine import (
    DRUM_GAP,
    FRAME_COLUMNS,
    LEFT,
    RIGHT,
    SAGS,
    WATER,
    WIDTH,
    Machine,
    Play,
    add,
    draw_colours,
    draw_machine,
    move,
    number,
    path,
    picture,
    sag_enlargement,
    text,
    written,
)
from dualwinch.simulation.plots.page import case_number, scenario
from dualwinch.simulation.plots.runs import KILO, length_unit
from dualwinch.simulation.plots.style import GREY, INK, LIGHT, ROPE_COLOURS, VERMILION, law_label, law_look
from dualwinch.simulation.plots.traces import drawable, largest, thin
from dualwinch.simulation.results.result import Result

Floats = NDArray[np.float64]

AXIS_LEFT, AXIS_RIGHT = 76.0, 930.0
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
        title: its quantity and unit.
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
    scale = (AXIS_RIGHT - AXIS_LEFT) / duration
    top, bottom = panels[0].top, panels[-1].bottom
    reveal = add(add(parent, "clipPath", id="past"), "rect", x=AXIS_LEFT, y=top - 6, height=bottom - top + 12)
    widths = [number(width) for width in np.linspace(0, AXIS_RIGHT - AXIS_LEFT, frames)]
    move(reveal, "width", widths, play)
    ticks = MaxNLocator(6).tick_values(0, duration)
    for panel in panels:
        _axes(parent, panel, [(AXIS_LEFT + scale * value, f"{value:g}") for value in ticks if 0 <= value <= duration])
        for opacity, clip in ((0.18, {}), (1.0, {"clip-path": "url(#past)"})):
            group = add(parent, "g", fill="none", stroke_width=1.4, stroke_linejoin="round", opacity=f"{opacity:g}")
            for name, value in clip.items():
                group.set(name, value)
            for line in panel.lines:
                times, values = thin(t, line.values, 420)
                kept = np.isfinite(values)
                ys = panel.y(np.clip(values[kept], panel.low, panel.high))
                add(group, "path", d=path(AXIS_LEFT + scale * times[kept], ys), stroke=line.colour)
    for value in ticks:
        if 0 <= value <= duration:
            x = AXIS_LEFT + scale * value
            text(parent, x, bottom + 16, f"{value:g}", font_size=11, text_anchor="middle", fill=GREY)
    text(parent, AXIS_RIGHT, bottom + 32, "time (s)", font_size=11, text_anchor="end", fill=GREY)
    now = add(parent, "line", y1=top, y2=bottom, stroke=INK, stroke_width=1)
    for end in ("x1", "x2"):
        move(now, end, [number(AXIS_LEFT + float(width)) for width in widths], play)


def _axes(parent: Element, panel: Panel, times: list[tuple[float, str]]) -> None:
    for x, _ in times:
        add(parent, "line", x1=x, x2=x, y1=panel.top, y2=panel.bottom, stroke=LIGHT, stroke_width=0.7)
    for value in MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]).tick_values(panel.low, panel.high):
        if panel.low <= value <= panel.high:
            y = float(panel.y(value))
            add(parent, "line", x1=AXIS_LEFT, x2=AXIS_RIGHT, y1=y, y2=y, stroke=LIGHT, stroke_width=0.7)
            words = f"{value:g}".replace("-", "−")
            text(parent, AXIS_LEFT - 8, y + 4, words, font_size=11, text_anchor="end", fill=GREY)
    text(parent, AXIS_LEFT, panel.top - 9, panel.title, font_size=12)
    x = AXIS_RIGHT
    for line in reversed(panel.lines if len(panel.lines) > 1 else ()):
        x -= 62
        add(parent, "line", x1=x, x2=x + 16, y1=panel.top - 13, y2=panel.top - 13, stroke=line.colour, stroke_width=2.5)
        text(parent, x + 20, panel.top - 9, line.name, font_size=11)


HEIGHT, RAIL = 530, 200.0
"""Height of the picture and of the rail in it, in pixels."""

PLAY_SECONDS, FRAMES = 12.5, 250
"""How long a run takes on the screen, and in how many frames."""


def animation(result: Result) -> str:
    """A run as one SVG that moves, without scripts: it plays in browsers and in READMEs.

    The rail is to scale; drums are drawn larger. Ropes are straight unless they sag in the model, and a sag that would
    not be seen is enlarged by a power of ten, which the picture names.

    Args:
        result: a run with its rows.

    Raises:
        ConfigurationError: the run keeps fewer than two rows.
    """
    t = result["t"]
    if len(t) < 2:
        raise ConfigurationError("an animation needs a result with rows: simulate with stride >= 1")
    experiment, duration = result.experiment, float(t[-1] - t[0])
    rows = np.linspace(0, len(t) - 1, FRAMES).astype(int)
    play = Play(PLAY_SECONDS, FRAMES // 2)
    machine = Machine(experiment, RAIL)
    number = case_number(experiment)
    case = f"Case {number} of the paper, " if number else ""
    words = f"{case}{scenario(experiment)}; {law_label(experiment)}"
    root = picture(WIDTH, HEIGHT, f"A vehicle towed by two winches: {words}", _description(result))
    add(root, "rect", width=WIDTH, height=HEIGHT, rx=10, fill="white")
    text(root, 20, 28, "A vehicle towed along a rail by two winches", font_size=17, font_weight="bold")
    speed = f"{duration:.3g} s in {PLAY_SECONDS:g} s"
    text(root, 20, 48, f"{words}; a simulated run, {speed}", fill=GREY)
    add(root, "rect", y=66, width=WIDTH, height=RAIL - 60, fill=WATER)
    draw_colours(root, WIDTH - 205, 24, machine.highest)
    sags = [name for name in SAGS if name in result.columns]
    frames = {name: np.nan_to_num(drawable(result[name]))[rows] for name in (*FRAME_COLUMNS, *sags)}
    for x, name in ((LEFT - DRUM_GAP, "winch 2"), (RIGHT + DRUM_GAP, "winch 1")):
        text(root, x, machine.rope - 14, name, text_anchor="middle")
    for x, name in ((LEFT + 70, "rope 2"), (RIGHT - 10, "rope 1")):
        text(root, x, machine.rope - 14, name, text_anchor="middle", fill=GREY)
    draw_machine(root, machine, frames, play)
    text(root, 20, 90, "▽ reference", font_size=12, fill=INK)
    text(root, 112, 90, "→ disturbance on the vehicle", font_size=12, fill=VERMILION)
    if sags:
        factor = sag_enlargement(machine, frames)
        words = f"sag of the ropes × {factor:g}" if factor > 1 else "sag of the ropes to scale"
        text(root, 320, 90, words, font_size=12, fill=GREY)
    draw_traces(root, t - t[0], duration, _panels(result), play, FRAMES)
    return written(root)


def save_animation(result: Result, path: str | PathLike[str]) -> None:
    """Write a run as an animated SVG, which appears whole or not at all.

    Raises:
        ConfigurationError: the suffix is not ``.svg``, or the run keeps no rows.
        OSError: the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".svg":
        raise ConfigurationError(f"{path.name}: unknown suffix {path.suffix!r}; must be .svg")
    write_whole(path, animation(result))


def _panels(result: Result) -> list[Panel]:
    error = drawable(result["e"])
    unit, name = length_unit(largest(error))
    reach = 1.08 * max(largest(error) / unit, 1e-9)
    forces = tuple(
        Line(f"rope {rope}", shade, drawable(result[f"F{rope}"]) / KILO)
        for rope, shade in enumerate(ROPE_COLOURS, start=1)
    )
    highest = 1.08 * max(*(largest(line.values) for line in forces), 1e-9)
    tracking = (Line("error", law_look(result.experiment)[0], error / unit),)
    return [
        Panel(f"tracking error ({name})", 270, 358, tracking, -reach, reach),
        Panel("rope tension (kN)", 394, 490, forces, 0.0, highest),
    ]


def _description(result: Result) -> str:
    error, m = 1e3 * largest(result["e"]), result.metrics
    return (
        f"Two winches pull a vehicle along a rail of {result.experiment.plant.track.length:g} m; their ropes are "
        f"coloured by tension. Below, tracking error (at most {error:.3g} mm) and rope tensions "
        f"({m.min_tension:.0f} to {m.peak_tension:.0f} N) over {result.end_time:g} s."
    )
