"""Draw the pictures of the documentation: ``python -m docs.pictures`` writes docs/images/controller.svg."""

from pathlib import Path

from docs.pictures.blocks import blocks

IMAGES = Path(__file__).parents[1] / "images"
PICTURES = {"controller.svg": blocks}
"""File → what draws it."""


def main() -> None:
    """Write every picture."""
    for name, draw in PICTURES.items():
        (IMAGES / name).write_text(draw().svg(), encoding="utf-8")


if __name__ == "__main__":
    main()
