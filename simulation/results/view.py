"""A result in a few words, and as a notebook shows it."""

import math

import numpy as np

from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.html import page, readable, readable_unit, section, table
from dualwinch.simulation.integrators.solver import is_automatic, solver_of
from dualwinch.simulation.loop.metrics import Metrics
from dualwinch.simulation.results.run_like import RunLike

SHOWN = ("mse", "max_abs_error", "chatter")
"""Figures of merit that stand in the text of a result."""


def text(result: RunLike) -> str:
    """A line that says what was run and what came out."""
    known, values = describe(Metrics), vars(result.metrics)
    merits = [
        f"{name} {values[name]:.4g} {readable_unit(known[name].quantity.unit)}".rstrip()
        for name in SHOWN
        if not math.isnan(values[name])
    ]
    return f"Result({_law(result)}: {'; '.join([_words(result), *merits])})"


def html(result: RunLike) -> str:
    """Outcome, figures of merit and columns."""
    rows = []
    for name, quantity in result.quantities.items():
        values = result[name]
        low, high = (np.fmin.reduce(values), np.fmax.reduce(values)) if values.size else (np.nan, np.nan)
        ends = [f"{end:.4g}" if np.isfinite(end) else "–" for end in (low, high)]
        rows.append([name, *ends, readable_unit(quantity.unit), readable(quantity.meaning)])
    columns = table(["column", "lowest", "highest", "unit", "meaning"], rows, numbers=(1, 2))
    return page(
        _law(result),
        _words(result),
        section("figures of merit", result.metrics._repr_html_(), is_open=True),
        section(f"{len(rows)} columns", columns),
    )


def _law(result: RunLike) -> str:
    law = result.experiment.controller.law
    return law.label or law.kind


def _words(result: RunLike) -> str:
    ending, rows = result.outcome.replace("_", " "), len(next(iter(result.columns.values())))
    return f"{ending} at {result.end_time:g} s, {rows} rows of {len(result.columns)} columns{_solver(result)}"


def _solver(result: RunLike) -> str:
    """The integrator that the ropes ask for, in place of the experiment's."""
    return f", {solver_of(result.experiment)}" if is_automatic(result.experiment) else ""
