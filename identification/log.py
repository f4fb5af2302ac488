"""A log: what a machine's sensors said, and which torques it was given."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.identification.sensed import READINGS
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.results.run import Run
from dualwinch.simulation.rows import READ

Floats = NDArray[np.float64]

TORQUES = ("tau_1", "tau_2")
"""Torque commands, without which there is nothing to go by."""

LEAST = 200
"""Rows that a log has at least."""


@dataclass(frozen=True, eq=False)
class Log:
    """A log.

    Attributes:
        t: (n,) time of each row in s, ascending.
        columns: name → (n,) in SI units: torque commands ``tau_1``, ``tau_2`` at the motors, and some of
            `identification.sensed.READINGS`. NaN where nothing was recorded.
        name: what it is called.
    """

    t: Floats
    columns: Mapping[str, Floats]
    name: str = "log"

    def __post_init__(self) -> None:
        """Check it.

        Raises:
            ConfigurationError: too short, time that stands still or goes back, no torques, no position or encoder.
        """
        if len(self.t) < LEAST:
            raise ConfigurationError(f"{self.name}: has {len(self.t)} rows: must be {LEAST} or more")
        if not np.isfinite(self.t).all():
            raise ConfigurationError(f"{self.name}: t: must be a finite number in every row")
        backwards = np.flatnonzero(np.diff(self.t) <= 0)
        if len(backwards):
            row = int(backwards[0]) + 1
            raise ConfigurationError(
                f"{self.name}: t = {self.t[row]:g} s in row {row + 1} after {self.t[row - 1]:g} s: must ascend"
            )
        for name in TORQUES:
            if name not in self.columns or not np.isfinite(self.columns[name]).any():
                raise ConfigurationError(f"{self.name}: {name}: there is none, and torques are what a fit goes by")
        if not any(name in self.columns for name in ("x", "theta_1", "theta_2")):
            raise ConfigurationError(f"{self.name}: must have a position or an encoder: x, theta_1 or theta_2")

    @property
    def readings(self) -> tuple[str, ...]:
        """The sensors it has, in the order of `READINGS`."""
        return tuple(name for name in READINGS if name in self.columns and np.isfinite(self.columns[name]).any())

    @property
    def duration(self) -> float:
        """Time in s from the first row to the last."""
        return float(self.t[-1] - self.t[0])


def log(columns: Mapping[str, ArrayLike], name: str = "log") -> Log:
    """A log of arrays: ``t`` in s, torque commands, and readings, all in SI units.

    Raises:
        ConfigurationError: an unknown column, columns of different lengths, or no log (`Log`).
    """
    known = ("t", *TORQUES, *READINGS)
    for column in columns:
        if column not in known:
            raise ConfigurationError(f"{name}: unknown column '{column}'; must be {', '.join(known)}")
    if "t" not in columns:
        raise ConfigurationError(f"{name}: t: there is none")
    arrays = {column: np.array(values, float) for column, values in columns.items()}
    for column, values in arrays.items():
        if values.shape != arrays["t"].shape or values.ndim != 1:
            raise ConfigurationError(f"{name}: {column}: must be a list of {arrays['t'].size} numbers, as t is")
    return Log(arrays.pop("t"), arrays, name)


def log_of(run: Run, name: str = "run") -> Log:
    """The log of a simulated run: what its sensors said where it kept that (``simulation.readings``), else the truth.

    Raises:
        ConfigurationError: the run kept too few rows.
    """
    columns = run.columns
    read = {key: columns.get(f"{key}{READ}", columns.get(key)) for key in READINGS}
    arrays = {key: values for key, values in read.items() if values is not None}
    return Log(columns["t"], arrays | {key: columns[key] for key in TORQUES}, name)
