"""MATLAB and Octave: a variable for each column, units and figures of merit as structures, all else as JSON."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dualwinch.codegen.files import atomic
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.simulation.results.content import Content, about, number

LONGEST = 63
"""Characters of the longest name MATLAB knows."""


def write(content: Content, path: Path) -> None:
    """Write a file; what is no letter or digit in a column's name becomes an underscore.

    Raises:
        ConfigurationError: two columns would have one name, or a column that of another entry.
    """
    from scipy.io import savemat

    variables = {name: re.sub(r"\W", "_", name)[:LONGEST] for name in content.columns}
    described = {variables[name]: {"name": name, **about(quantity)} for name, quantity in content.quantities.items()}
    units = {variables[name]: unit for name, unit in content.units.items()}
    entries: dict[str, Any] = {"units": units, "columns": json.dumps(described)}
    entries |= {key: _entry(value) for key, value in content.facts.items()}
    for name, variable in variables.items():
        if variable in entries:
            raise ConfigurationError(f"column '{name}': .mat files have another entry of this name; save as .parquet")
        entries[variable] = content.columns[name]
    with atomic(path) as unfinished:
        savemat(unfinished, entries, oned_as="column", do_compression=True, long_field_names=True)


def _entry(value: Any) -> Any:
    """A fact as MATLAB knows it: a structure where it holds nothing but numbers by simple names, else JSON."""
    if not isinstance(value, Mapping):
        return value
    simple = all(
        str(key).isidentifier() and (item is None or isinstance(item, (int, float))) for key, item in value.items()
    )
    return {key: number(item) for key, item in value.items()} if simple else json.dumps(value)


def read(path: Path) -> Content:
    """Read a file of numbers.

    Raises:
        ValueError: it is no .mat file, or damaged.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        found = loadmat(path, simplify_cells=True)
    except MatReadError as error:
        raise ValueError(error) from error
    described = json.loads(found["columns"])
    names = {variable: texts.pop("name") for variable, texts in described.items()}
    return Content(
        columns={name: np.array(found[variable], float).ravel() for variable, name in names.items()},
        quantities={names[variable]: Quantity(**texts) for variable, texts in described.items()},
        facts={key: value for key, value in found.items() if key not in names and not key.startswith("__")},
    )
