"""Elements of an SVG, and attributes that move: SMIL, which browsers play in an ``<img>`` without any script."""

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
from numpy.typing import ArrayLike

from dualwinch.simulation.plots.style import INK

FONT = "system-ui, 'DejaVu Sans', 'Segoe UI', Helvetica, Arial, sans-serif"


@dataclass(frozen=True)
class Play:
    """How frames are played.

    Attributes:
        seconds: that all frames take on the screen, again and again.
        still: index of the frame that is shown where nothing moves.
    """

    seconds: float
    still: int


STILL = Play(0.0, 0)
"""Of pictures with a single frame."""


def picture(width: int, height: int, title: str, description: str) -> Element:
    """An empty picture that says in words what it shows; sizes in pixels."""
    root = Element("svg", xmlns="http://www.w3.org/2000/svg", viewBox=f"0 0 {width} {height}", role="img")
    root.set("font-family", FONT)
    SubElement(root, "title").text = title
    SubElement(root, "desc").text = description
    return root


def add(parent: Element, tag: str, **attributes: str | float) -> Element:
    """An element below another; ``stroke_width`` stands for ``stroke-width``."""
    return SubElement(parent, tag, {name.replace("_", "-"): number(value) for name, value in attributes.items()})


def text(parent: Element, x: float, y: float, words: str, **attributes: str | float) -> Element:
    """Words whose baseline begins at a point, or is centred there with ``text_anchor="middle"``."""
    element = add(parent, "text", **({"x": x, "y": y, "font_size": 13, "fill": INK} | attributes))
    element.text = words
    return element


def number(value: str | float) -> str:
    """A number as short as a picture needs it."""
    return value if isinstance(value, str) else f"{value:.1f}".removesuffix(".0")


def path(xs: ArrayLike, ys: ArrayLike) -> str:
    """A line through points, as the attribute ``d``; both (points,) in pixels."""
    points = zip(np.ravel(xs), np.ravel(ys), strict=True)
    return "M" + "L".join(f"{number(float(x))} {number(float(y))}" for x, y in points)


def move(element: Element, attribute: str, frames: Sequence[str], play: Play) -> None:
    """Let an attribute go through its frames."""
    element.set(attribute, frames[play.still])
    if len(set(frames)) > 1:
        _animate(element, "animate", frames, play, attributeName=attribute)


def transform(element: Element, kind: str, frames: Sequence[str], play: Play) -> None:
    """Let an element be moved (`kind` ``translate``) or turned (``rotate``) through its frames."""
    element.set("transform", f"{kind}({frames[play.still]})")
    if len(set(frames)) > 1:
        _animate(element, "animateTransform", frames, play, attributeName="transform", type=kind)


def _animate(element: Element, tag: str, frames: Sequence[str], play: Play, **more: str) -> None:
    timing = {"dur": f"{play.seconds:g}s", "repeatCount": "indefinite", "values": ";".join(frames)}
    SubElement(element, tag, more | timing)


def written(root: Element) -> str:
    """The picture as text."""
    indent(root, "")
    return tostring(root, encoding="unicode") + "\n"
