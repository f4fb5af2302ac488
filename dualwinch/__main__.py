"""``python -m dualwinch``."""

from dualwinch.cli import main

main()
