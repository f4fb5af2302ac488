"""A run of one's own, as the page takes it."""

import base64
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.results.result import Result

MOST_ROWS = 100_000
"""Rows that a page draws; of a longer run every so many."""


def own_run(label: str, result: Result) -> dict[str, Any]:
    """A run as the page takes it, every number of its columns in the eight bytes of a little-endian double.

    Args:
        label: what it is called.
        result: the run, with its rows.

    Returns:
        ``label``, ``outcome``, ``until`` in s, ``metrics``, ``columns``: name → base64, and ``units``.
    """
    stride = max(1, -(-len(result.columns.get("t", ())) // MOST_ROWS))
    metrics = {name: None if math.isnan(value) else value for name, value in dict(result.metrics).items()}
    return {
        "label": label,
        "outcome": result.outcome,
        "until": result.end_time,
        "metrics": metrics,
        "columns": {name: _packed(column[::stride]) for name, column in result.columns.items()},
        "units": result.units,
    }


def _packed(column: NDArray[np.float64]) -> str:
    return base64.b64encode(np.ascontiguousarray(column, "<f8").tobytes()).decode()
