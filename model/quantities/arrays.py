"""Vectors and matrices in states: taken apart into scalars, and put together again."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True, init=False)
class Elements:
    """What the elements of a vector are where they are not alike, in place of one `Quantity` of all.

    ``z: Annotated[Any, Elements((Quantity("m", "position"), Mark.POSITION), Quantity("m/s", "drift"))]``

    Attributes:
        quantities, marks: of each element; of a matrix, row by row.
    """

    quantities: tuple[Quantity, ...]
    marks: tuple[frozenset[Mark], ...]

    def __init__(self, *each: Quantity | tuple[Quantity | Mark, ...]) -> None:
        """Say what each element is: its quantity, or a tuple of that and its marks."""
        groups = [item if isinstance(item, tuple) else (item,) for item in each]
        quantities = tuple(item for group in groups for item in group if isinstance(item, Quantity))
        marks = tuple(frozenset(item for item in group if isinstance(item, Mark)) for group in groups)
        if len(quantities) != len(groups) or not groups:
            raise ConfigurationError("Elements: must be one Quantity for each element, or a tuple of it and its marks")
        object.__setattr__(self, "quantities", quantities)
        object.__setattr__(self, "marks", marks)


def is_array(value: Any) -> bool:
    """Whether a value is a vector or a matrix, of floats or of symbols, and not a scalar."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, (ca.SX, ca.MX, ca.DM)) and value.shape != (1, 1)


def vector(values: Sequence[Scalar]) -> Any:
    """Numbers, or symbols, as a vector of a state."""
    symbolic = any(isinstance(value, (ca.SX, ca.MX)) for value in values)
    return ca.vertcat(*values) if symbolic else np.array(values, dtype=float)


def elements(value: Any) -> dict[str, Any]:
    """What its key ends in → element of a vector (``.0``, ``.1``, …) or a matrix (``.0.0``, ``.0.1``, …), row by row.

    A single element has the array's own key, for as a symbol it cannot be told from a scalar.
    """
    rows, columns = (*value.shape, 1)[:2]
    matrix = value.reshape(rows, columns) if isinstance(value, np.ndarray) else value
    if rows == columns == 1:
        return {"": matrix[0, 0]}
    if columns == 1:
        return {f".{row}": matrix[row, 0] for row in range(rows)}
    return {f".{row}.{column}": matrix[row, column] for row in range(rows) for column in range(columns)}


def rebuilt(value: Any, element: Callable[[str], Any]) -> Any:
    """An array shaped like another, by the ends of its elements' keys: NumPy's where all are floats, else CasADi's.

    Elements that are themselves NumPy arrays, of many runs, add their axes behind.
    """
    found = [element(end) for end in elements(value)]
    if any(isinstance(item, (ca.SX, ca.MX)) for item in found):
        rows, columns = (*value.shape, 1)[:2]
        return ca.reshape(ca.vertcat(*found), columns, rows).T
    stacked = np.array(found, float)
    return stacked.reshape(value.shape + stacked.shape[1:])
