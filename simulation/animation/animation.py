"""A run as an animated SVG: the machine above, its error and its tensions below."""

from os import PathLike
from pathlib import Path

import numpy as np

from dualwinch.codegen.files import atomic
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.animation.machine import (
    DRUM_GAP,
    LEFT,
    RIGHT,
    WATER,
    WIDTH,
    Frames,
    draw_colours,
    draw_machine,
    machine_of,
)
from dualwinch.simulation.animation.svg import Play, add, picture, text, written
from dualwinch.simulation.animation.traces import Line, Panel, draw_traces
from dualwinch.simulation.plots.headings import case_number, scenario
from dualwinch.simulation.plots.motion import length_unit
from dualwinch.simulation.plots.ropes import KILO
from dualwinch.simulation.plots.style import GREY, INK, ROPE_COLOURS, VERMILION, law_colour, law_label
from dualwinch.simulation.plots.thin import drawable, largest
from dualwinch.simulation.results.result import Result

HEIGHT, RAIL = 530, 200.0
"""Height of the picture and of the rail in it, in pixels."""

PLAY_SECONDS, FRAMES = 12.5, 250
"""How long a run takes on the screen, and in how many frames."""


def animation(result: Result) -> str:
    """A run as one SVG that moves, without scripts: it plays in browsers and in READMEs.

    The rail is to scale; drums are drawn larger, and the sag of ropes, which grows as their tension falls, is drawn
    larger than it is.

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
    machine = machine_of(experiment, RAIL)
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
    columns = {name: np.nan_to_num(drawable(result[name]))[rows] for name in Frames.__annotations__ if name != "force"}
    frames = Frames(**columns, force=np.nan_to_num(drawable(result["d_true"]))[rows])
    for x, name in ((LEFT - DRUM_GAP, "winch 2"), (RIGHT + DRUM_GAP, "winch 1")):
        text(root, x, machine.rope - 14, name, text_anchor="middle")
    for x, name in ((LEFT + 70, "rope 2"), (RIGHT - 10, "rope 1")):
        text(root, x, machine.rope - 14, name, text_anchor="middle", fill=GREY)
    draw_machine(root, machine, frames, play)
    text(root, 20, 90, "▽ reference", font_size=12, fill=INK)
    text(root, 112, 90, "→ disturbance on the vehicle", font_size=12, fill=VERMILION)
    draw_traces(root, t - t[0], duration, _panels(result), play, FRAMES)
    return written(root)


def save_animation(result: Result, path: str | PathLike[str]) -> None:
    """Write a run as an animated SVG, which appears whole or not at all.

    Raises:
        ConfigurationError: the suffix is not ``.svg``, or the run keeps no rows.
        OSError: the file cannot be written.
    """
    check_animation(Path(path))
    content = animation(result)
    with atomic(Path(path)) as unfinished:
        unfinished.write_text(content, encoding="utf-8")


def check_animation(path: Path) -> None:
    """Find out whether a file can hold an animation.

    Raises:
        ConfigurationError: the suffix is not ``.svg``.
    """
    if path.suffix.lower() != ".svg":
        raise ConfigurationError(f"{path.name}: unknown suffix {path.suffix!r}; an animation is an .svg")


def _panels(result: Result) -> list[Panel]:
    error = drawable(result["e"])
    unit, name = length_unit(largest(error))
    reach = 1.08 * max(largest(error) / unit, 1e-9)
    forces = tuple(
        Line(f"rope {rope}", shade, drawable(result[f"F{rope}"]) / KILO)
        for rope, shade in enumerate(ROPE_COLOURS, start=1)
    )
    highest = 1.08 * max(*(largest(line.values) for line in forces), 1e-9)
    tracking = (Line("error", law_colour(result.experiment), error / unit),)
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
