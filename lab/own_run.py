"""A run of one's own, as the page takes it."""

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.results.file_formats import plain
from dualwinch.simulation.results.result import Result

MOST_ROWS = 100_000
"""Rows that a page draws; of a longer run every so many."""


def own_run(label: str, result: Result) -> dict[str, Any]:
    """A run as the page takes it, every number of its columns in the eight bytes of a little-endian double.

    Args:
        label: what it is called.
        result: the run, with its rows.

    Returns:
        ``label``, ``outcome``, ``until`` in s, ``metrics``, ``columns``: name → base64, ``units``, and ``settings``:
        key → value of what is not as in the paper's Case 2, as in a file.
    """
    stride = max(1, -(-len(result.columns.get("t", ())) // MOST_ROWS))
    return {
        "label": label,
        "outcome": result.outcome,
        "until": result.end_time,
        "metrics": plain(dict(result.metrics)),
        "columns": {name: _packed(column[::stride]) for name, column in result.columns.items()},
        "units": result.units,
        "settings": _differences(result.experiment),
    }


def _packed(column: NDArray[np.float64]) -> str:
    return base64.b64encode(np.ascontiguousarray(column, "<f8").tobytes()).decode()


def _differences(experiment: Experiment) -> dict[str, Any]:
    """Single values that are not as in the paper's Case 2."""
    usual = leaves(Experiment())
    return {
        key: plain(value)
        for key, value in leaves(experiment).items()
        if isinstance(value, (str, bool, int, float)) and value != usual.get(key)
    }
