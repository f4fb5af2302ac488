"""The command line, one command a file; the computations are functions of the other packages.

Heavy imports stand inside the commands, so that ``--help`` answers at once.
"""

from dualwinch.cli.app import main

__all__ = ["main"]
