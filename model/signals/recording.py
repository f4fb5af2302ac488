"""Numbers over the time, read once from a file or a list and kept: the content behind a signal or a reference."""

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.numbers import NONE, Numbers
from dualwinch.model.signals.tables import read_table
from dualwinch.model.signals.units import factor

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Origin:
    """Where numbers over the time come from: columns of a file, or lists.

    Attributes:
        file: its path; ``None`` where the numbers are given.
        time_column, time_unit: the column of the times; without a unit of its own or of the file, in s.
        columns: names of the others; ``None`` is the only one there is beside the named ones.
        times, values: the numbers, where there is no file.
    """

    file: str | None
    time_column: str
    time_unit: str | None
    columns: tuple[str | None, ...]
    times: Numbers = NONE
    values: Numbers = NONE


@dataclass(frozen=True, eq=False)
class Recording:
    """Numbers over the time, as they were read.

    Attributes:
        origin: where they come from.
        t: (n,) times in s, ascending.
        columns: the others, each (n,), in the units they came in.
        names: of the columns; ``values`` where they are a list.
        units: of the columns, where the file says them.
        digest: SHA-256 of all this but the origin, the first 16 digits.
    """

    origin: Origin
    t: Floats
    columns: tuple[Floats, ...]
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    digest: str

    def column(self, index: int, unit: str | None, si: str) -> Floats:
        """A column in an SI unit, (n,).

        Args:
            index: its number.
            unit: that it came in; ``None``: as the file says.
            si: the SI unit.

        Raises:
            ConfigurationError: nobody says the unit, two say different ones, or it is of another quantity.
        """
        said = self.units[index]
        stated = said if unit is None else unit
        about = f"{self.origin.file}: column '{self.names[index]}'" if self.origin.file else self.names[index]
        if stated is None:
            raise ConfigurationError(f'{about}: has no unit; say which: unit = "{si}"')
        if said is not None and stated != said:
            raise ConfigurationError(f'{about}: unit "{stated}": must be "{said}", as the file says')
        try:
            return factor(stated, si) * self.columns[index]
        except ConfigurationError as error:
            raise ConfigurationError(f"{about}: {error}") from error


def recorded(origin: Origin, kept: Recording | None, digest: str | None) -> Recording:
    """The recording of an origin: the kept one where it is of this origin, else read now.

    Args:
        origin: where the numbers come from.
        kept: what was read before.
        digest: of what was read before, or of what is expected.

    Raises:
        ConfigurationError: the numbers cannot be read, or are not those expected.
    """
    if kept is not None and kept.origin == origin:
        return kept
    read = _listed(origin) if origin.file is None else _of_file(origin, origin.file)
    expected = None if kept is not None and digest == kept.digest else digest
    if expected not in {None, read.digest}:
        raise ConfigurationError(
            f"{origin.file or 'values'}: has changed: its numbers have the digest {read.digest}, must be {expected}"
        )
    return read


def _of_file(origin: Origin, file: str) -> Recording:
    table = read_table(file, (origin.time_column, *origin.columns))
    names = tuple(name for name in table.columns if name != origin.time_column)
    unit = origin.time_unit or table.units.get(origin.time_column, "s")
    try:
        t = factor(unit, "s") * table.columns[origin.time_column]
    except ConfigurationError as error:
        raise ConfigurationError(f"{file}: column '{origin.time_column}': {error}") from error
    late = np.flatnonzero(np.diff(t) <= 0)
    if len(late):
        row, times = int(late[0]) + 1, table.columns[origin.time_column]
        raise ConfigurationError(
            f"{file}: {table.position(row)}: {origin.time_column} = {times[row]:g}: "
            f"must be > {times[row - 1]:g}, the time before it"
        )
    return _recording(
        origin, t, tuple(table.columns[name] for name in names), names, tuple(map(table.units.get, names))
    )


def _listed(origin: Origin) -> Recording:
    t, values = np.array(origin.times, float), np.array(origin.values, float)
    if len(t) != len(values):
        raise ConfigurationError(f"values: has {len(values)} numbers: must have {len(t)}, one for each of times")
    if len(t) < 2:
        raise ConfigurationError("times: is too short: must have two numbers or more")
    for name, numbers in (("times", t), ("values", values)):
        wrong = np.flatnonzero(~np.isfinite(numbers))
        if len(wrong):
            raise ConfigurationError(f"{name}[{wrong[0]}] = {numbers[wrong[0]]:g}: must be a finite number")
    late = np.flatnonzero(np.diff(t) <= 0)
    if len(late):
        index = int(late[0]) + 1
        raise ConfigurationError(f"times[{index}] = {t[index]:g}: must be > {t[index - 1]:g}, the time before it")
    return _recording(origin, factor(origin.time_unit or "s", "s") * t, (values,), ("values",), (None,))


def _recording(
    origin: Origin, t: Floats, columns: tuple[Floats, ...], names: tuple[str, ...], units: tuple[str | None, ...]
) -> Recording:
    content = hashlib.sha256(repr(units).encode())
    for numbers in (t, *columns):
        numbers.flags.writeable = False
        content.update(np.ascontiguousarray(numbers, dtype="<f8").tobytes())
    return Recording(origin, t, columns, names, units, content.hexdigest()[:16])
