"""Rows on another time grid."""

import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.rows import CONTINUOUS

Floats = NDArray[np.float64]

SLIP = 1e-6
"""Share of the time between two rows by which an instant may miss a row through rounding."""

MOST = 10**8
"""Most instants of a grid that is given by its rate."""


def interpolation(columns: Iterable[str]) -> dict[str, str]:
    """Column → ``linear`` for what goes on between two samples, ``held`` for what is set at a sample."""
    return {name: "linear" if name in CONTINUOUS else "held" for name in columns}


def instants(t: Floats, rate: float | None, times: ArrayLike | None) -> Floats:
    """The instants of a grid, within the time that rows cover.

    Args:
        t: (rows,) time of the rows in s.
        rate: instants a second, from the first row on; or
        times: (n,) in s, ascending.

    Raises:
        ConfigurationError: neither or both are given, there are no rows, or a time lies outside.
    """
    if (rate is None) == (times is None):
        raise ConfigurationError("resample: give either rate or times")
    if not len(t):
        raise ConfigurationError("resample: the run kept no rows (stride = 0)")
    first, last = float(t[0]), float(t[-1])
    slip = SLIP * (float(t[1]) - first) if len(t) > 1 else 0.0
    if rate is not None:
        if not (math.isfinite(rate) and rate > 0 and (last - first) * rate < MOST):
            raise ConfigurationError(f"rate = {rate:g}: must be a finite number > 0 1/s, of at most {MOST:g} instants")
        count = math.floor((last - first + slip) * rate) + 1
        return np.minimum(first + np.arange(count) / rate, last)
    given = np.asarray(times, float)
    if given.ndim != 1 or not given.size:
        raise ConfigurationError(f"times: shape {given.shape} must be (n,), with at least one time")
    outside = ~((given >= first - slip) & (given <= last + slip))
    if outside.any():
        index = int(outside.argmax())
        raise ConfigurationError(f"times[{index}] = {given[index]:g}: must be {first:g} to {last:g} s, where rows are")
    if (np.diff(given) <= 0).any():
        index = int((np.diff(given) <= 0).argmax()) + 1
        raise ConfigurationError(f"times[{index}] = {given[index]:g}: must be > times[{index - 1}]")
    return given


def resampled(columns: Mapping[str, Floats], times: Floats) -> dict[str, Floats]:
    """Columns at other instants.

    Args:
        columns: name → (rows,), ``t`` among them.
        times: (n,) in s, as `instants` gives them.

    Returns:
        name → (n,), each by its `interpolation`; ``t`` is `times`.
    """
    t, kinds = columns["t"], interpolation(columns)
    slip = SLIP * (t[1] - t[0]) if len(t) > 1 else 0.0
    latest = np.maximum(np.searchsorted(t, times + slip, side="right") - 1, 0)
    found = {
        name: np.interp(times, t, values) if kinds[name] == "linear" else values[latest]
        for name, values in columns.items()
    }
    return found | {"t": times.copy()}
