"""A linear system as a notebook shows it."""

import numpy as np

from dualwinch.model.linear.files import Content
from dualwinch.model.quantities.html import page, readable_unit, section, table

LARGEST = 16
"""Rows and columns of the largest matrix that is shown; of a larger system only the names are."""


def html(system: Content) -> str:
    """Names, units and, of a small system, the matrix [A B; C D] with its rows and columns named."""
    sizes = len(system.states), len(system.inputs), len(system.outputs)
    words = "{} states, {} inputs, {} outputs".format(*sizes)
    time = "continuous time" if system.dt is None else f"sampled every {system.dt:g} s"
    point = ", ".join(f"{name} = {value:.4g}" for name, value in system.operating_point.items())
    kinds = {"state": system.states, "input": system.inputs, "output": system.outputs}
    rows = [[name, readable_unit(system.units[name]), kind] for kind, names in kinds.items() for name in names]
    names = section("names and units", table(["name", "unit", ""], rows))
    parts = [section("A, B; C, D", _matrix(system), is_open=True)] if _is_small(system) else []
    if point:
        words += f", at {point}"
    return page("Linear system", f"{time}, {words}", *parts, names)


def _is_small(system: Content) -> bool:
    states, inputs, outputs = len(system.states), len(system.inputs), len(system.outputs)
    return max(states + inputs, states + outputs) <= LARGEST


def _matrix(system: Content) -> str:
    numbers = np.block([[system.matrices["A"], system.matrices["B"]], [system.matrices["C"], system.matrices["D"]]])
    columns = (*system.states, *system.inputs)
    form = "d{}/dt" if system.dt is None else "next {}"
    causes = [*(form.format(name) for name in system.states), *system.outputs]
    rows = [[name, *(f"{value:.4g}" for value in row)] for name, row in zip(causes, numbers, strict=True)]
    return table(["", *columns], rows, numbers=range(1, len(columns) + 1))
