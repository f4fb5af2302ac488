"""Every column of a result, from the annotations beside the fields."""

from collections.abc import Iterator

import dualwinch as dw
from docs.generated.text import code, table, unit
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.simulation.rows import COLUMNS, CONTINUOUS, READINGS, TORQUES

HEADINGS = ["column", "unit", "meaning", "between two rows"]
NO_COLUMNS = {"saturated", "torque_saturated"}
"""Outputs of a controller that a result sums up and does not keep."""


def _rows(columns: dict[str, Quantity]) -> list[list[str]]:
    return [
        [code(name), unit(quantity.unit), quantity.meaning, "linear" if name in CONTINUOUS else "held"]
        for name, quantity in columns.items()
    ]


def _controllers() -> Iterator[tuple[str, Controller]]:
    """Every registered part once, in an otherwise usual controller."""
    for kind, law in POSITION_LAWS.items():
        yield kind, Controller(law=law())
    for kind, estimator in ESTIMATORS.items():
        yield kind, Controller(estimator=estimator())
    for kind, coordination in COORDINATIONS.items():
        yield kind, Controller(coordination=coordination())


def own_columns() -> dict[str, tuple[Quantity, list[str]]]:
    """Column → what it is, and the kinds of the parts that give it."""
    usual = {variable.name for variable in dw.block("controller", dw.case(4, "nftsm")).outputs} - {"Z_a", "s"}
    found: dict[str, tuple[Quantity, list[str]]] = {}
    for kind, controller in _controllers():
        experiment = dw.case(
            4, law=controller.law, estimator=controller.estimator, coordination=controller.coordination
        )
        for variable in dw.block("controller", experiment).outputs:
            if variable.name in usual | NO_COLUMNS | set(COLUMNS) or (
                controller.law.kind != kind and variable.name in {"d_hat", "L1", "Z_a", "s"}
            ):
                continue
            quantity = Quantity(variable.unit, variable.description)
            found.setdefault(variable.name, (quantity, []))[1].append(kind)
    return found


def columns_markdown() -> str:
    """Columns of every result, those of motors and sensors, and those of the parts of a controller."""
    own = [
        [code(name), unit(quantity.unit), quantity.meaning, ", ".join(map(code, kinds))]
        for name, (quantity, kinds) in own_columns().items()
    ]
    return "\n".join(
        [
            "## Every result\n",
            table(HEADINGS, _rows(COLUMNS)),
            "\n## Motors that lag\n",
            "Where `actuator.kind` is not `ideal`:\n",
            table(HEADINGS, _rows(TORQUES)),
            "\n## What the sensors say\n",
            "With `simulation.readings = true`:\n",
            table(HEADINGS, _rows(READINGS)),
            "\n## Signals of a controller's parts\n",
            "All of them are held from one sample to the next.\n",
            table(["column", "unit", "meaning", "given by"], own),
        ]
    )
