"""Results of runs: outcomes and figures of merit, rows, files; access to their figures."""

from importlib import import_module
from typing import Any


def figures() -> Any:
    """The module `dualwinch.plots`, imported when the first figure is drawn.

    It depends on all results, so they cannot import it; and Matplotlib is loaded only when needed.
    """
    return import_module("dualwinch.plots")
