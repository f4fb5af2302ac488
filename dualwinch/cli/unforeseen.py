"""Unforeseen failures: one line for the user, and a traceback in a file for the report."""

import os
import platform
import sys
import tempfile
import traceback

from dualwinch import __version__
from dualwinch.codegen.text import without_secrets


def unforeseen(error: Exception, *, printed: bool) -> str:
    """Print a failure's traceback, or write it to a new file that only its owner can read; return the message.

    Neither contains the command line, which may hold passwords.
    """
    where = f"dualwinch {__version__}, Python {platform.python_version()}, {platform.platform()}\n"
    text = without_secrets(where + "".join(traceback.format_exception(error)))
    what = f"unforeseen {type(error).__name__}: {error}"
    if printed:
        sys.stderr.write(text)
        return what
    try:
        descriptor, path = tempfile.mkstemp(prefix="dualwinch-traceback-", suffix=".txt")
        with os.fdopen(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
    except OSError:
        return f"{what}; a fault of dualwinch, please report it with the output of --traceback"
    return f"{what}; a fault of dualwinch, please report it with {path} to your supplier of dualwinch"
