"""A run as an animated SVG of the machine with its traces."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TypeAlias
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from dualwinch.toolbox import ConfigurationError, Experiment, Result, arguments, drawing, whole_files

FONT = "system-ui, 'DejaVu Sans', 'Segoe UI', Helvetica, Arial, sans-serif"


@dataclass(frozen=True)
class Play:
    """Playback of frames: duration in s of all, which are repeated, and index of the one shown without animation."""

    seconds: float
    still: int


def picture(width: int, height: int, title: str, description: str) -> Element:
    """An empty picture with title and description; sizes in pixels."""
    root = Element("svg", xmlns="http://www.w3.org/2000/svg", viewBox=f"0 0 {width} {height}", role="img")
    root.set("font-family", FONT)
    SubElement(root, "title").text = title
    SubElement(root, "desc").text = description
    return root


def add(parent: Element, tag: str, **attributes: str | float) -> Element:
    """Add a child element; ``stroke_width`` stands for ``stroke-width``."""
    return SubElement(parent, tag, {name.replace("_", "-"): number(value) for name, value in attributes.items()})


def text(parent: Element, x: float, y: float, words: str, **attributes: str | float) -> Element:
    """Add text whose baseline begins at a point, or is centred there with ``text_anchor="middle"``."""
    element = add(parent, "text", **({"x": x, "y": y, "font_size": 13, "fill": drawing.INK} | attributes))
    element.text = words
    return element


def number(value: str | float) -> str:
    """A number with the few digits a picture needs."""
    return value if isinstance(value, str) else f"{value:.1f}".removesuffix(".0")


def path(xs: ArrayLike, ys: ArrayLike) -> str:
    """A line through points, as the attribute ``d``; both (points,) in pixels."""
    points = zip(np.ravel(xs), np.ravel(ys), strict=True)
    return "M" + "L".join(f"{number(float(x))} {number(float(y))}" for x, y in points)


def animate(element: Element, attribute: str, frames: Sequence[str], play: Play) -> None:
    """Animate an attribute through its frames; ``translate`` moves the element, ``rotate`` rotates it."""
    timing = {"dur": f"{play.seconds:g}s", "repeatCount": "indefinite", "values": ";".join(frames)}
    if attribute in {"translate", "rotate"}:
        element.set("transform", f"{attribute}({frames[play.still]})")
        tag, target = "animateTransform", {"attributeName": "transform", "type": attribute}
    else:
        element.set(attribute, frames[play.still])
        tag, target = "animate", {"attributeName": attribute}
    if len(set(frames)) > 1:
        SubElement(element, tag, target | timing)


def written(root: Element) -> str:
    """The picture as text."""
    indent(root, "")
    return tostring(root, encoding="unicode") + "\n"


Floats = NDArray[np.float64]

WIDTH = 960
"""Width of every picture in pixels."""

LEFT, RIGHT = 120.0, 840.0
"""Positions of the rail's ends in pixels."""

DRUM, DRUM_GAP = 24.0, 64.0
"""Radius of a drum, drawn larger than to scale, and its distance from the rail's end, in pixels."""

WATER, BED, HULL = "#EAF3F8", "#D8CDB8", "#34516B"
SLACK = "#B9B9B9"

ARROW = 60.0
"""Length of the arrow of the largest disturbance in pixels."""


Frames: TypeAlias = Mapping[str, Floats]
"""Motion of the machine, one row per frame: columns of a result, with ``d_true`` as disturbance of the vehicle."""

FRAME_COLUMNS = ("x", "x_ref", "theta_1", "theta_2", "F1", "F2", "d_true")

SAGS = ("sag_1", "sag_2")
"""Further columns for ropes that sag; other ropes are straight."""


@dataclass(frozen=True)
class Machine:
    """Geometry of the drawn machine, with its rail at a vertical position in pixels, downwards."""

    experiment: Experiment
    rail: float

    @property
    def length(self) -> float:
        """Length of the rail in m."""
        return float(self.experiment.plant.track.length)

    @property
    def highest(self) -> float:
        """Tension in N at the upper end of the colours."""
        return float(self.experiment.controller.limits.tension_max)

    @property
    def scale(self) -> float:
        """Pixels per metre."""
        return (RIGHT - LEFT) / self.length

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the vehicle in pixels."""
        vehicle = self.experiment.plant.vehicle
        return float(vehicle.diameter) * self.scale, float(vehicle.height) * self.scale

    @property
    def rope(self) -> float:
        """Vertical position of the taut ropes in pixels: the middle of the vehicle."""
        return self.rail - 6 - self.size[1] / 2

    @property
    def top(self) -> float:
        """Upper edge of the vehicle in pixels."""
        return self.rope - self.size[1] / 2

    def at(self, x: Floats) -> Floats:
        """Positions along the rail in m as pixels."""
        return LEFT + self.scale * np.asarray(x)


def draw_machine(parent: Element, machine: Machine, frames: Frames, play: Play) -> None:
    """Draw the machine in all its frames."""
    _rail(parent, machine)
    half, vehicle = machine.size[0] / 2, machine.at(frames["x"])
    add(add(parent, "clipPath", id="water"), "rect", width=WIDTH, height=machine.rail + 32)
    ropes = add(parent, "g", clip_path="url(#water)")
    _rope(ropes, machine, frames, play, number=2, drum=LEFT - DRUM_GAP, ends=vehicle - half)
    _rope(ropes, machine, frames, play, number=1, drum=RIGHT + DRUM_GAP, ends=vehicle + half)
    _drum(parent, machine, LEFT - DRUM_GAP, -frames["theta_2"], play)
    _drum(parent, machine, RIGHT + DRUM_GAP, frames["theta_1"], play)
    reference = add(parent, "g")
    add(
        reference,
        "path",
        d=f"M0 {number(machine.top - 8)}l-6 -10h12z",
        fill="none",
        stroke=drawing.INK,
        stroke_width=1.2,
    )
    animate(reference, "translate", [f"{number(x)} 0" for x in machine.at(frames["x_ref"])], play)
    _vehicle(parent, machine, vehicle, frames["d_true"], play)


def colour(tension: float, highest: float) -> str:
    """Colour of a rope that carries a tension in N; grey where it carries none."""
    return SLACK if tension <= 0 else to_hex(colormaps["plasma"](0.85 * min(tension / highest, 1.0)))


def draw_colours(parent: Element, x: float, y: float, highest: float) -> None:
    """Draw the key to the ropes' colours in a box of 200 x 30 pixels."""
    steps, width = 40, 4.0
    for step in range(steps):
        shade = colour((step + 0.5) / steps * highest, highest)
        add(parent, "rect", x=x + step * width, y=y, width=width + 0.3, height=8, fill=shade)
    size, unit = drawing.prefixed_unit("N", highest)
    for share in (0.0, 0.5, 1.0):
        words = f"{share * highest / size:g}" + (f" {unit}" if share == 1 else "")
        text(parent, x + share * steps * width, y + 22, words, font_size=11, text_anchor="middle", fill=drawing.GREY)
    text(parent, x - 12, y + 9, "tension", font_size=11, text_anchor="end", fill=drawing.GREY)


def _rail(parent: Element, machine: Machine) -> None:
    top = machine.rail
    add(parent, "rect", x=0, y=top + 6, width=WIDTH, height=26, fill=BED)
    add(parent, "rect", x=LEFT - 16, y=top, width=RIGHT - LEFT + 32, height=6, fill=drawing.GREY)
    for metres in np.linspace(0, machine.length, 6):
        x = float(machine.at(metres))
        add(parent, "line", x1=x, x2=x, y1=top + 6, y2=top + 11, stroke=drawing.INK)
        words = f"{metres:g} m" if metres else "x = 0"
        text(parent, x, top + 25, words, font_size=11, text_anchor="middle")


def sag_enlargement(machine: Machine, frames: Frames) -> float:
    """Power of ten by which sags are enlarged to be visible, within a drum's radius; 1 if they are visible to scale."""
    largest = max((float(frames[name].max()) for name in SAGS if name in frames), default=0.0) * machine.scale
    return 10.0 ** max(np.floor(np.log10(DRUM / largest)), 0.0) if largest > 0 else 1.0


def _rope(
    parent: Element, machine: Machine, frames: Frames, play: Play, *, number: int, drum: float, ends: Floats
) -> None:
    """Draw a rope from the top of its drum, over the rollers, to the vehicle."""
    tension, sags = frames[f"F{number}"], frames.get(f"sag_{number}", np.zeros(len(ends)))
    drawn_sags = sags * machine.scale * sag_enlargement(machine, frames)
    rope = add(parent, "path", fill="none", stroke_width=3.5, stroke_linecap="round")
    animate(
        rope,
        "d",
        [_rope_svg(machine, drum, *each) for each in zip(ends.tolist(), drawn_sags.tolist(), strict=True)],
        play,
    )
    animate(rope, "stroke", [colour(value, machine.highest) for value in tension.tolist()], play)


def _rope_svg(machine: Machine, drum: float, end: float, sag: float) -> str:
    """The line of a rope from drum to vehicle in pixels: straight to the rail's end, then a parabola per span.

    The sag of the span at the vehicle, which may be shorter, is proportional to its length squared.
    """
    height, rail_end = number(machine.rope), LEFT if drum < end else RIGHT
    begin = f"M{number(drum)} {height}H"
    if sag < 0.05:  # straight at the precision of the picture
        return begin + number(end)
    span = machine.scale * float(machine.experiment.plant.track.roller_spacing) or abs(end - rail_end)
    line, at = [begin + number(rail_end)], rail_end
    while abs(end - at) > 0.05:
        part = min(abs(end - at), span)
        at += np.copysign(part, end - at)
        line.append(f"q{number(np.copysign(part / 2, end - drum))} {number(2 * sag * (part / span) ** 2)} ")
        line.append(f"{number(np.copysign(part, end - drum))} 0")
    return "".join(line)


def _drum(parent: Element, machine: Machine, x: float, clockwise: Floats, play: Play) -> None:
    """Draw a drum with its top at the ropes, rotated by angles in rad."""
    y = machine.rope + DRUM
    foot = machine.rail + 6
    add(parent, "path", d=f"M{number(x - 22)} {number(foot)}L{number(x)} {number(y)}L{number(x + 22)} {number(foot)}z",
        fill=drawing.GREY)  # fmt: skip
    add(parent, "circle", cx=x, cy=y, r=DRUM, fill="#F7F3EA", stroke=drawing.INK, stroke_width=2)
    spokes = add(parent, "g", stroke=drawing.INK, stroke_width=2)
    for angle in np.radians([90, 210, 330]):
        across, down = DRUM * np.cos(angle), DRUM * np.sin(angle)
        add(spokes, "line", x1=x, y1=y, x2=x + across, y2=y + down)
    centre = f"{number(x)} {number(y)}"
    animate(spokes, "rotate", [f"{number(degrees)} {centre}" for degrees in np.degrees(clockwise)], play)
    add(parent, "circle", cx=x, cy=y, r=5, fill=drawing.INK)


def _vehicle(parent: Element, machine: Machine, x: Floats, force: Floats, play: Play) -> None:
    """Draw the hull on its shoes, with an arrow for the disturbance."""
    (width, height), top = machine.size, machine.top
    vehicle = add(parent, "g")
    hull = {"x": -width / 2, "y": top, "width": width, "height": height, "rx": width / 5}
    add(vehicle, "rect", **hull, fill=HULL, stroke=drawing.INK, stroke_width=1.5)
    for side in (-1, 1):
        add(vehicle, "rect", x=side * width / 3.2 - 3, y=top + height, width=6, height=8, fill=drawing.INK)
    text(vehicle, 0, top - 26, "vehicle", text_anchor="middle", fill=drawing.GREY)
    largest = float(np.abs(force).max(initial=0.0))
    if largest > 0:
        arrow = add(vehicle, "path", fill="none", stroke=drawing.VERMILION, stroke_width=3.5)
        animate(arrow, "d", _arrows(force / largest * ARROW, machine.rope), play)
    animate(vehicle, "translate", [f"{number(value)} 0" for value in x], play)


def _arrows(lengths: Floats, height: float) -> Sequence[str]:
    y = number(height)
    arrows = []
    for length in lengths.tolist():
        head = -np.sign(length) * min(abs(length), 7)
        barb = number(head)
        arrows.append(f"M0 {y}h{number(length)}m{barb} {barb}L{number(length)} {y}l{barb} {number(-head)}")
    return arrows


AXIS_LEFT, AXIS_RIGHT = 76.0, 930.0
"""Ends of the time axis in pixels."""


@dataclass(frozen=True)
class Line:
    """A signal of a panel: name, colour and (rows,) values."""

    name: str
    colour: str
    values: Floats


@dataclass(frozen=True)
class Panel:
    """A panel: title with unit, position in pixels, signals, and ends of its vertical axis."""

    title: str
    top: float
    bottom: float
    lines: tuple[Line, ...]
    low: float
    high: float

    def y(self, values: Floats | float) -> Floats:
        """Vertical positions of values in pixels."""
        return self.bottom - (np.asarray(values) - self.low) / (self.high - self.low) * (self.bottom - self.top)


def draw_traces(parent: Element, t: Floats, duration: float, panels: list[Panel], play: Play, frames: int) -> None:
    """Draw stacked panels of signals over times (rows,) in s, up to a duration in s."""
    scale = (AXIS_RIGHT - AXIS_LEFT) / duration
    top, bottom = panels[0].top, panels[-1].bottom
    reveal = add(add(parent, "clipPath", id="past"), "rect", x=AXIS_LEFT, y=top - 6, height=bottom - top + 12)
    widths = [number(width) for width in np.linspace(0, AXIS_RIGHT - AXIS_LEFT, frames)]
    animate(reveal, "width", widths, play)
    ticks = MaxNLocator(6).tick_values(0, duration)
    for panel in panels:
        _axes(parent, panel, [(AXIS_LEFT + scale * value, f"{value:g}") for value in ticks if 0 <= value <= duration])
        for opacity, clip in ((0.18, {}), (1.0, {"clip-path": "url(#past)"})):
            group = add(parent, "g", fill="none", stroke_width=1.4, stroke_linejoin="round", opacity=f"{opacity:g}")
            for name, value in clip.items():
                group.set(name, value)
            for line in panel.lines:
                times, values = drawing.thin(t, line.values, 420)
                finite = np.isfinite(values)
                ys = panel.y(np.clip(values[finite], panel.low, panel.high))
                add(group, "path", d=path(AXIS_LEFT + scale * times[finite], ys), stroke=line.colour)
    for value in ticks:
        if 0 <= value <= duration:
            x = AXIS_LEFT + scale * value
            text(parent, x, bottom + 16, f"{value:g}", font_size=11, text_anchor="middle", fill=drawing.GREY)
    text(parent, AXIS_RIGHT, bottom + 32, "time (s)", font_size=11, text_anchor="end", fill=drawing.GREY)
    now = add(parent, "line", y1=top, y2=bottom, stroke=drawing.INK, stroke_width=1)
    for end in ("x1", "x2"):
        animate(now, end, [number(AXIS_LEFT + float(width)) for width in widths], play)


def _axes(parent: Element, panel: Panel, times: list[tuple[float, str]]) -> None:
    for x, _ in times:
        add(parent, "line", x1=x, x2=x, y1=panel.top, y2=panel.bottom, stroke=drawing.LIGHT, stroke_width=0.7)
    for value in MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]).tick_values(panel.low, panel.high):
        if panel.low <= value <= panel.high:
            y = float(panel.y(value))
            add(parent, "line", x1=AXIS_LEFT, x2=AXIS_RIGHT, y1=y, y2=y, stroke=drawing.LIGHT, stroke_width=0.7)
            words = f"{value:g}".replace("-", "−")
            text(parent, AXIS_LEFT - 8, y + 4, words, font_size=11, text_anchor="end", fill=drawing.GREY)
    text(parent, AXIS_LEFT, panel.top - 9, panel.title, font_size=12)
    x = AXIS_RIGHT
    for line in reversed(panel.lines if len(panel.lines) > 1 else ()):
        x -= 62
        add(parent, "line", x1=x, x2=x + 16, y1=panel.top - 13, y2=panel.top - 13, stroke=line.colour, stroke_width=2.5)
        text(parent, x + 20, panel.top - 9, line.name, font_size=11)


HEIGHT, RAIL = 530, 200.0
"""Height of the picture and vertical position of the rail in pixels."""

PLAY_SECONDS, FRAMES = 12.5, 250
"""Duration of a run on the screen in s, and number of frames."""


def animation(result: Result) -> str:
    """A run as an animated SVG without scripts, which plays in browsers and in READMEs.

    The rail is to scale; drums are drawn larger. Ropes are straight unless they sag in the model; an invisible sag is
    enlarged by a power of ten, which the picture states.

    Args:
        result: a run with rows.

    Raises:
        ConfigurationError: the run kept fewer than two rows.
    """
    t = result["t"]
    if len(t) < 2:
        raise ConfigurationError("an animation needs a result with rows: simulate with stride >= 1")
    experiment, duration = result.experiment, float(t[-1] - t[0])
    rows = np.linspace(0, len(t) - 1, FRAMES).astype(int)
    play = Play(PLAY_SECONDS, FRAMES // 2)
    machine = Machine(experiment, RAIL)
    number = drawing.case_number(experiment)
    case = f"Case {number} of the paper, " if number else ""
    words = f"{case}{drawing.scenario(experiment)}; {drawing.law_label(experiment)}"
    root = picture(WIDTH, HEIGHT, f"A vehicle towed by two winches: {words}", _description(result))
    add(root, "rect", width=WIDTH, height=HEIGHT, rx=10, fill="white")
    text(root, 20, 28, "A vehicle towed along a rail by two winches", font_size=17, font_weight="bold")
    speed = f"{duration:.3g} s in {PLAY_SECONDS:g} s"
    text(root, 20, 48, f"{words}; a simulated run, {speed}", fill=drawing.GREY)
    add(root, "rect", y=66, width=WIDTH, height=RAIL - 60, fill=WATER)
    draw_colours(root, WIDTH - 205, 24, machine.highest)
    sags = [name for name in SAGS if name in result.columns]
    frames = {name: np.nan_to_num(drawing.drawable(result[name]))[rows] for name in (*FRAME_COLUMNS, *sags)}
    for x, name in ((LEFT - DRUM_GAP, "winch 2"), (RIGHT + DRUM_GAP, "winch 1")):
        text(root, x, machine.rope - 14, name, text_anchor="middle")
    for x, name in ((LEFT + 70, "rope 2"), (RIGHT - 10, "rope 1")):
        text(root, x, machine.rope - 14, name, text_anchor="middle", fill=drawing.GREY)
    draw_machine(root, machine, frames, play)
    text(root, 20, 90, "▽ reference", font_size=12, fill=drawing.INK)
    text(root, 112, 90, "→ disturbance on the vehicle", font_size=12, fill=drawing.VERMILION)
    if sags:
        factor = sag_enlargement(machine, frames)
        words = f"sag of the ropes × {factor:g}" if factor > 1 else "sag of the ropes to scale"
        text(root, 320, 90, words, font_size=12, fill=drawing.GREY)
    draw_traces(root, t - t[0], duration, _panels(result), play, FRAMES)
    return written(root)


def save_animation(result: Result, path: str | PathLike[str]) -> None:
    """Write a run as an animated SVG, which appears whole or not at all.

    Raises:
        ConfigurationError: the suffix is not ``.svg``, or the run kept no rows.
        OSError: the file cannot be written.
    """
    arguments.suffix_of(path := Path(path), [".svg"])
    whole_files.write_whole(path, animation(result))


def _panels(result: Result) -> list[Panel]:
    error = drawing.drawable(result["e"])
    unit, name = drawing.prefixed_unit("m", drawing.largest(error))
    reach = 1.08 * max(drawing.largest(error) / unit, 1e-9)
    force, name_of_force = drawing.prefixed_unit("N", *(drawing.largest(result[f"F{rope}"]) for rope in (1, 2)))
    forces = tuple(
        Line(f"rope {rope}", shade, drawing.drawable(result[f"F{rope}"]) / force)
        for rope, shade in enumerate(drawing.ROPE_COLOURS, start=1)
    )
    highest = 1.08 * max(*(drawing.largest(line.values) for line in forces), 1e-9)
    tracking = (Line("error", drawing.law_look(result.experiment)[0], error / unit),)
    return [
        Panel(f"tracking error ({name})", 270, 358, tracking, -reach, reach),
        Panel(f"rope tension ({name_of_force})", 394, 490, forces, 0.0, highest),
    ]


def _description(result: Result) -> str:
    error, m = 1e3 * drawing.largest(result["e"]), result.metrics
    return (
        f"Two winches pull a vehicle along a rail of {result.experiment.plant.track.length:g} m; their ropes are "
        f"coloured by tension. Below, tracking error (at most {error:.3g} mm) and rope tensions "
        f"({m.min_tension:.0f} to {m.peak_tension:.0f} N) over {result.end_time:g} s."
    )
