"""Results of runs: outcomes and figures of merit, rows, files; and the way to their figures."""

from importlib import import_module
from typing import Any


def figures() -> Any:
    """The module `simulation.plots`, imported by its name when the first figure is drawn.

    It knows every result, so that no result can import it in turn; and Matplotlib is not loaded before.
    """
    return import_module("dualwinch.simulation.plots")
