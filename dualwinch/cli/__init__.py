"""The command line: what can be asked for, one command a file.

Heavy imports stand inside the commands, so that ``--help`` answers at once; the work is in modules of `dualwinch`.
"""

from dualwinch.cli.app import main

__all__ = ["main"]
