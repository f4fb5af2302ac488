"""Logs in files: what a column is called and which unit it is in, told where the file does not say so itself."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dualwinch.identification.log import TORQUES, Log
from dualwinch.identification.sensed import Sensed
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe
from dualwinch.model.recordings import factor
from dualwinch.simulation.rows import READ

UNIT_OF = {
    "t": "s",
    **dict.fromkeys(TORQUES, "N m"),
    **{leaf.key: leaf.quantity.unit for leaf in describe(Sensed).values()},
}
"""Name → SI unit."""


NONE = "-"
"""In the place of a column's name: there is none."""


@dataclass(frozen=True)
class Column:
    """Where a reading is found.

    Attributes:
        name: of the file's column; `NONE`: it is left out.
        unit: that it is in; None: what the file says, else the SI unit.
    """

    name: str
    unit: str | None = None


def column_map(texts: Sequence[str]) -> dict[str, Column]:
    """Columns from texts such as ``F1=load_cell_left``, ``F1=load_cell_left:kN`` or ``F1=-``, which leaves it out.

    Raises:
        ConfigurationError: anything else, or an unknown reading or unit.
    """
    found = {}
    for text in texts:
        parts = re.fullmatch(r"\s*(\w+)\s*=\s*([^:]+?)\s*(?::\s*(\S.*?))?\s*", text)
        if not parts:
            raise ConfigurationError(f"--column {text}: must be READING=COLUMN or READING=COLUMN:UNIT, e.g. F1=left:kN")
        reading, name, unit = parts.groups()
        if reading not in UNIT_OF:
            raise ConfigurationError(f"--column {text}: unknown reading '{reading}'; must be {', '.join(UNIT_OF)}")
        if unit is not None:
            try:
                factor(unit, UNIT_OF[reading])
            except ConfigurationError as error:
                raise ConfigurationError(f"--column {text}: {error}") from None
        found[reading] = Column(name, unit)
    return found


def read_log(file: str | Path, columns: Mapping[str, Column] | None = None) -> Log:
    """A log from a file: CSV, Parquet, MATLAB or NumPy; empty cells and NaN are gaps.

    Columns go by the names of readings (``x``, ``F1``, ...), or by these with ``_read``, as runs have them that were
    written with ``simulation.readings``.

    Args:
        file: its path.
        columns: reading → where it is found, for those of other names.

    Raises:
        ConfigurationError: the file cannot be read, lacks a column that was named, or is no log (`Log`).
    """
    from dualwinch.identification.log_columns import read_columns

    path, columns = Path(file), columns or {}
    held, units = read_columns(path)
    found: dict[str, np.ndarray] = {}
    for reading, si in UNIT_OF.items():
        given = columns.get(reading)
        if given and given.name == NONE:
            continue
        names = [given.name] if given else [f"{reading}{READ}", reading]
        name = next((name for name in names if name in held), None)
        if name is None:
            if given:
                listed = ", ".join(list(held)[:12])
                raise ConfigurationError(f"{path}: unknown column '{given.name}'; it has {listed}")
            continue
        unit = (given.unit if given else None) or units.get(name) or si
        try:
            found[reading] = held[name] * (1.0 if unit == si else factor(unit, si))
        except ConfigurationError as error:
            raise ConfigurationError(f"{path}: column '{name}': {error}") from None
    if "t" not in found:
        raise ConfigurationError(f"{path}: t: no such column; name the one of times with --column t=NAME")
    times = found.pop("t")
    return Log(times, found, path.name)
