"""Figures of a study: the search, and what its best is worth."""

from dualwinch.tuning.plots.score import before_and_after, held_out
from dualwinch.tuning.plots.search import front, history, importance, importances, parallel_coordinates

__all__ = [
    "before_and_after",
    "front",
    "held_out",
    "history",
    "importance",
    "importances",
    "parallel_coordinates",
]
