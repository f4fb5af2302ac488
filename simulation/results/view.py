"""A result in a few words, and as a notebook shows it."""

import math

import numpy as np

from dualwinch.model.quantities.tables import page, readable, readable_unit, section, table
from dualwinch.simulation.loop.structure import is_automatic, solver_of
from dualwinch.simulation.metrics.metrics import BUILT_IN
from dualwinch.simulation.results.run import Run

SHOWN = ("mse", "max_abs_error", "chatter")
"""Built-in figures of merit that stand in the text of a result; an experiment's own all do."""


def text(result: Run) -> str:
    """A line that says what was run and what came out."""
    metrics, known = result.metrics, result.metrics.quantities
    own = [name for name in metrics if name not in BUILT_IN]
    merits = [
        f"{name} {metrics[name]:.4g} {readable_unit(known[name].unit)}".rstrip()
        for name in (*SHOWN, *own)
        if not math.isnan(metrics[name])
    ]
    return f"Result({_law(result)}: {'; '.join([_words(result), *merits])})"


def html(result: Run) -> str:
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


def _law(result: Run) -> str:
    law = result.experiment.controller.law
    return law.label or law.kind


def _words(result: Run) -> str:
    ending, rows = result.outcome.replace("_", " "), len(next(iter(result.columns.values())))
    return f"{ending} at {result.end_time:g} s, {rows} rows of {len(result.columns)} columns{_solver(result)}"


def _solver(result: Run) -> str:
    """The integrator that the ropes ask for, in place of the experiment's."""
    return f", {solver_of(result.experiment)}" if is_automatic(result.experiment) else ""
