"""Given signals over time, from a file or from arrays, for the disturbances of the plant."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from os import PathLike, fspath
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import NONE, Mark, Numbers, Quantity, numbers_of
from dualwinch.model.recordings import Origin, Recording, recorded

Floats = NDArray[np.float64]

Interpolation: TypeAlias = Literal["linear", "previous"]

Beyond: TypeAlias = Literal["hold", "zero", "error"]

COARSE, LONGER = 0.5, 100.0
"""Median step in s, and duration relative to the run, beyond which the unit of the times must be stated."""

EARLY = 1e-9
"""Tolerance of times in s: sample times are rounded."""


def _seconds(t: Iterable[Any]) -> Iterable[Any]:
    """Times unchanged; dates as seconds since the first one, time spans in seconds."""
    times = np.asarray(t if isinstance(t, np.ndarray) else list(t))
    if times.dtype == object and all(isinstance(each, datetime | timedelta) for each in times):
        start = times[0] if isinstance(times[0], datetime) else timedelta()
        try:
            return [(each - start).total_seconds() for each in times]
        except TypeError:
            raise ConfigurationError(
                "times: must be all of one kind: spans of time, dates with a time zone, or dates without one"
            ) from None
    if times.dtype.kind in "mM":
        return (times - times[0] if times.dtype.kind == "M" else times) / np.timedelta64(1, "s")
    return times


def _numbers(name: str, given: Iterable[Any]) -> Floats:
    try:
        return np.asarray(given if isinstance(given, np.ndarray) else list(given), float).reshape(-1)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(f"{name}: must be numbers: {error}") from error


@dataclass(frozen=True)
class Signal:
    """A signal given as values over time; zero without any.

    A file is read once, when the signal is created: all runs with the signal and its copies use the values read then.
    Signals with equal values are equal.
    """

    file: Annotated[
        str | None, Quantity("", "CSV or Parquet file that holds the signal (default: none)"), Mark.FILE
    ] = None
    column: Annotated[str | None, Quantity("", "its column in the file (default: the only one beside the times)")] = (
        None
    )
    unit: Annotated[str | None, Quantity("", "its unit, such as kN or km/h (default: as the file says)")] = None
    scale: Annotated[float, Quantity("1", "factor on its values")] = 1.0
    interpolation: Annotated[Interpolation, Quantity("", "between two times: straight lines, or the value before")] = (
        "linear"
    )
    beyond: Annotated[
        Beyond, Quantity("", "before the first time and after the last: the value there, 0, or no run")
    ] = "hold"
    time_column: Annotated[str, Quantity("", "column of the times in the file")] = "t"
    time_unit: Annotated[str | None, Quantity("", "unit of the times (default: as the file says, else s)")] = None
    times: Annotated[tuple[float, ...], Quantity("", "instead of a file: the times, ascending")] = field(
        default=NONE, repr=False
    )
    values: Annotated[tuple[float, ...], Quantity("", "instead of a file: the values at these times")] = field(
        default=NONE, repr=False
    )
    digest: Annotated[
        str | None, Quantity("", "digest of the numbers read; others are an error (default: any)"), Mark.DIGEST
    ] = None
    field_marks: ClassVar = frozenset({Mark.DRAWN_AHEAD})

    recording: Annotated[Recording | None, Mark.CONTENT] = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        """Read the numbers.

        Raises:
            ConfigurationError: they cannot be read, or are no signal.
        """
        keep = object.__setattr__
        keep(self, "times", numbers_of(self.times))
        keep(self, "values", numbers_of(self.values))
        if self.file is not None:
            keep(self, "file", str(Path(fspath(self.file)).absolute()))
        if not self.given:
            keep(self, "digest", None)
            keep(self, "recording", None)
            return
        if self.file is not None and (self.times or self.values):
            raise ConfigurationError("times, values: must not be given beside a file")
        origin = Origin(
            self.file, self.time_column, self.time_unit, (self.column,), Numbers(self.times), Numbers(self.values)
        )
        recording = recorded(origin, self.recording, self.digest)
        keep(self, "recording", recording)
        keep(self, "digest", recording.digest)

    @classmethod
    def from_file(
        cls,
        file: str | PathLike[str],
        column: str | None = None,
        *,
        unit: str | None = None,
        interpolation: Interpolation = "linear",
        beyond: Beyond = "hold",
        time_column: str = "t",
    ) -> "Signal":
        """A signal from a column of a CSV or Parquet file; arguments as in the fields."""
        return cls(fspath(file), column, unit, 1.0, interpolation, beyond, time_column)

    @classmethod
    def from_arrays(
        cls,
        t: Iterable[float],
        values: Iterable[float],
        *,
        unit: str,
        interpolation: Interpolation = "linear",
        beyond: Beyond = "hold",
    ) -> "Signal":
        """A signal from arrays.

        Args:
            t: (n,) times in s, ascending; or dates, counted from the first one.
            values: (n,) values at these times.
            unit: of the values, such as ``kN``.
            interpolation: as in the field.
            beyond: as in the field.

        Raises:
            ConfigurationError: fewer than two values, unequal lengths, or an element that is no finite number.
        """
        for name, array in (("t", t), ("values", values)):
            if not isinstance(array, Iterable):
                raise ConfigurationError(f"{name}: must be numbers, not {type(array).__name__}")
        times = Numbers(_numbers("times", _seconds(t)).tolist())
        numbers = Numbers(_numbers("values", values).tolist())
        if not times:
            raise ConfigurationError("times: is too short: must have two numbers or more")
        return cls(unit=unit, interpolation=interpolation, beyond=beyond, times=times, values=numbers)

    @property
    def given(self) -> bool:
        """Whether there is a file or there are values."""
        return self.file is not None or bool(self.times) or bool(self.values)

    def sampled(self, t: Floats, si: str) -> Floats:
        """The signal's values in an SI unit at the times t in s, (n,); zero where there is no signal.

        Raises:
            ConfigurationError: its unit is missing, or is of another quantity.
        """
        if self.recording is None:
            return np.zeros(len(t))
        times, values = self.recording.t, self.scale * self.recording.column(0, self.unit, si)
        if self.interpolation == "linear":
            samples = np.interp(t, times, values)
        else:
            samples = values[np.searchsorted(times, t + EARLY, side="right").clip(1) - 1]
        if self.beyond == "zero":
            samples[(t < times[0] - EARLY) | (t > times[-1] + EARLY)] = 0.0
        return samples

    def check(self, si: str, last: float) -> None:
        """Raise `ConfigurationError` for a signal without values in an SI unit, or none up to the time `last` in s."""
        if self.recording is None:
            return
        self.recording.column(0, self.unit, si)
        start, end = self.recording.t[[0, -1]]
        if end < -EARLY or start > last + EARLY:
            raise ConfigurationError(
                f"{self.file or 'times'}: none of its times is in the run: has {start:.10g} to {end:.10g} s, must have "
                f"some of 0 to {last:g} s; count them from the run's start, and check time_unit"
            )
        step = float(np.median(np.diff(self.recording.t)))
        if self.recording.time_unit is None and step > COARSE and end - start > LONGER * last:
            raise ConfigurationError(
                f"{self.file}: has a row every {step:g} s and ends after {end:g} s, the run after {last:g} s, if "
                f'{self.time_column} is in s: must be stated, time_unit = "s" or "ms"'
            )
        if self.beyond == "error" and not (start <= EARLY and last <= end + EARLY):
            raise ConfigurationError(
                f"{self.file or 'times'}: is too short: holds {start:g} to {end:g} s, must hold 0 to {last:g} s; "
                'or set beyond = "hold" or "zero"'
            )
