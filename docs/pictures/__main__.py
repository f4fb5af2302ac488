"""Draw the pictures of the documentation: ``python -m docs.pictures`` writes them to docs/images."""

from pathlib import Path

from docs.pictures.blocks import blocks
from docs.pictures.machine import labelled_machine

IMAGES = Path(__file__).parents[1] / "images"
PICTURES = {"controller.svg": lambda: blocks().svg(), "machine-labelled.svg": labelled_machine}
"""File → what draws it as SVG."""


def main() -> None:
    """Write every picture."""
    for name, draw in PICTURES.items():
        (IMAGES / name).write_text(draw(), encoding="utf-8")


if __name__ == "__main__":
    main()
