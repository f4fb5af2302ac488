"""A small SVG canvas: lines, arrows, boxes and words in the colours of the figures, for light pages and dark ones."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

from dualwinch.simulation.plots.style import BLUE, GREEN, GREY, INK, LIGHT, ROPE_COLOURS, SHADE, VERMILION

LIGHT_COLOURS = {
    "paper": "#ffffff", "ink": INK, "grey": GREY, "line": LIGHT, "shade": SHADE,
    "rope1": ROPE_COLOURS[0], "rope2": ROPE_COLOURS[1], "blue": BLUE, "red": VERMILION, "green": GREEN,
}  # fmt: skip
"""What the figures use."""

DARK_COLOURS = {
    "paper": "#16181d", "ink": "#E6E6E6", "grey": "#A6A6A6", "line": "#4A4E57", "shade": "#23262D",
    "rope1": "#E07BAF", "rope2": "#E3B341", "blue": "#56B4E9", "red": "#FF8C42", "green": "#3CCB9B",
}  # fmt: skip
"""The same hues, bright enough for a dark page."""


def _rules(colours: dict[str, str]) -> str:
    return "".join(f".f-{name}{{fill:{value}}}.s-{name}{{stroke:{value}}}" for name, value in colours.items())


STYLE = (
    "text{font-family:'DejaVu Sans',Helvetica,Arial,sans-serif;font-size:15px}"
    ".small{font-size:12.5px}.symbol{font-style:italic}.s{fill:none;stroke-width:1.8}.thick{stroke-width:3}"
    + _rules(LIGHT_COLOURS)
    + f"@media(prefers-color-scheme:dark){{{_rules(DARK_COLOURS)}}}"
)


@dataclass
class Canvas:
    """A drawing of a size in pixels, with a title and a description for those who do not see it."""

    width: int
    height: int
    title: str
    description: str
    parts: list[str] = field(default_factory=list)

    def rectangle(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        fill: str = "shade",
        edge: str = "grey",
        round_: float = 6,
    ) -> None:
        """A box from its upper left corner."""
        self.parts.append(
            f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="{round_:g}" '
            f'class="f-{fill} s-{edge}" stroke-width="1.4"/>'
        )

    def line(
        self, points: Sequence[tuple[float, float]], colour: str = "ink", style: str = "", head: bool = False
    ) -> None:
        """A line through points; with an arrow's head at its end."""
        path = "M" + "L".join(f"{x:g},{y:g}" for x, y in points)
        self.path(path, colour, style)
        if head:
            self.head(points[-2], points[-1], colour)

    def path(self, path: str, colour: str = "ink", style: str = "") -> None:
        """Any path."""
        self.parts.append(f'<path d="{path}" class="s s-{colour} {style}"/>')

    def head(self, before: tuple[float, float], tip: tuple[float, float], colour: str = "ink") -> None:
        """An arrow's head at its tip, in the direction from a point before."""
        dx, dy = tip[0] - before[0], tip[1] - before[1]
        length = (dx**2 + dy**2) ** 0.5
        ux, uy = dx / length, dy / length
        back, half = 10, 4
        left = tip[0] - back * ux - half * uy, tip[1] - back * uy + half * ux
        right = tip[0] - back * ux + half * uy, tip[1] - back * uy - half * ux
        corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in (tip, left, right))
        self.parts.append(f'<polygon points="{corners}" class="f-{colour}"/>')

    def words(
        self, x: float, y: float, text: str, colour: str = "ink", style: str = "", anchor: str = "middle"
    ) -> None:
        """A line of text; what follows ``_`` up to a blank stands lower, as an index."""
        spans = []
        for number, piece in enumerate(text.split("_")):
            if number == 0:
                spans.append(escape(piece))
                continue
            index, blank, rest = piece.partition(" ")
            spans.append(
                f'<tspan dy="4" font-size="75%">{escape(index)}</tspan><tspan dy="-4">{blank}{escape(rest)}</tspan>'
            )
        self.parts.append(
            f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}" class="f-{colour} {style}">{"".join(spans)}</text>'
        )

    def svg(self) -> str:
        """The whole file."""
        around = f'<rect width="{self.width}" height="{self.height}" rx="8" class="f-paper"/>'
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}" '
            f'width="{self.width}" height="{self.height}" role="img" aria-labelledby="t d">'
            f'<title id="t">{escape(self.title)}</title><desc id="d">{escape(self.description)}</desc>'
            f"<style>{STYLE}</style>\n" + "\n".join([around, *self.parts]) + "\n</svg>\n"
        )
