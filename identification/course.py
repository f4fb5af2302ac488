"""A log on the samples of a filter: torques as they reach the motors, readings that say something new.

A reading that repeats the last one says little or nothing: encoders count in steps, and sensors that fall silent often
repeat themselves.
"""

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.log import TORQUES, Log
from dualwinch.identification.sensed import READINGS
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

ANGLES = ("theta_1", "theta_2")
"""Readings without noise, in steps."""

REPEATS = 20
"""Readings in a row that are exactly alike, from which on a sensor is taken for silent."""

LONGEST_GAP = 0.1
"""Longest time in s without a torque that is bridged by the last one."""


def samples_of(log: Log, experiment: Experiment) -> tuple[Floats, Floats]:
    """Inputs (samples, 4) and readings (samples, readings) of a log, for `codegen.drivers.prediction.FilterData`.

    Each reading goes to the nearest sample; where samples are said to jitter (``simulation.jitter``), a sample is when
    the log says, in the place of a multiple of the sample time. Torque commands are held until the next, and reach the
    motors ``simulation.delay_samples`` later; what the first of them did is not known, so the samples before are left
    out.

    Raises:
        ConfigurationError: no torque for longer than `LONGEST_GAP`, or hardly a sample is left.
    """
    step, late = experiment.simulation.sample_time, experiment.simulation.delay_samples
    numbers = np.rint((log.t - log.t[0]) / step).astype(int)
    count = int(numbers[-1]) + 1
    torques = np.column_stack([_held(log, name, numbers, count, step) for name in TORQUES])
    readings = np.full((count, len(READINGS)), np.nan)
    for column, name in enumerate(READINGS):
        if name in log.columns and not _doubled(name, log):
            values = log.columns[name]
            kept = np.isfinite(values)
            fresh = _counted(values[kept]) if name in ANGLES else _spoken(values[kept])
            readings[numbers[kept], column] = fresh
    t = _times(log.t, numbers, count, step) if experiment.simulation.jitter > 0 else log.t[0] + step * np.arange(count)
    durations = np.diff(t, append=t[-1] + step)
    arrived = torques[: count - late] if late else torques
    inputs = np.column_stack([t[late:], arrived, durations[late:]])
    return np.ascontiguousarray(inputs), np.ascontiguousarray(readings[late:])


def _times(t: Floats, numbers: NDArray[np.int_], count: int, step: float) -> Floats:
    """When every sample is: the time of its row, the last where it has several, and in between by their number."""
    last = np.append(np.diff(numbers) > 0, True)
    own = numbers[last] * step
    return np.arange(count) * step + np.interp(np.arange(count) * step, own, t[last] - own)


def _doubled(name: str, log: Log) -> bool:
    """Whether it is a drum speed beside an angle: most likely that angle's difference, half a sample late."""
    return name.startswith("omega") and name.replace("omega", "theta") in log.readings


def _held(log: Log, name: str, numbers: NDArray[np.int_], count: int, step: float) -> Floats:
    """A torque at every sample: that of the latest row that has one."""
    values = log.columns[name]
    rows = np.flatnonzero(np.isfinite(values))
    gaps = np.diff(numbers[rows], prepend=0, append=count - 1)
    spacing = float(np.median(np.diff(log.t)))
    longest = max(LONGEST_GAP, 2 * spacing)
    if gaps.max() * step > longest:
        at = int(np.argmax(gaps))
        begins = log.t[0] + step * (numbers[rows[at - 1]] if at else 0)
        raise ConfigurationError(
            f"{log.name}: {name}: none for {gaps.max() * step:g} s after t = {begins:g} s: must be <= {longest:g} s"
        )
    latest = np.clip(np.searchsorted(numbers[rows], np.arange(count), side="right") - 1, 0, None)
    return values[rows[latest]]


def _spoken(values: Floats) -> Floats:
    """Readings, without those of a sensor that repeats itself."""
    begins = np.flatnonzero(np.append(True, np.diff(values) != 0)) if len(values) else np.zeros(0, int)
    lengths = np.diff(begins, append=len(values))
    fresh = values.copy()
    for begin, length in zip(begins[lengths >= REPEATS], lengths[lengths >= REPEATS], strict=True):
        fresh[begin + 1 : begin + length] = np.nan
    return fresh


def _counted(values: Floats) -> Floats:
    """Angles of an encoder at those samples at which it counted.

    When a slow drum has just moved by one count, its angle is at that end of the count where it came from: at the edge,
    and by then as far beyond it as it goes in half a sample, one over the number of samples since the last count.
    """
    changes = np.flatnonzero(np.diff(values) != 0) + 1
    fresh = np.full_like(values, np.nan)
    if not len(changes):
        fresh[:1] = values[:1]
        return fresh
    moved = np.diff(values)[changes - 1]
    count = np.abs(moved).min()
    since = np.diff(changes, prepend=0).astype(float)
    single = np.abs(moved) < 1.5 * count
    edge = np.where(single, np.sign(moved) * count / 2 * (1 - 1 / np.maximum(since, 1.0)), 0.0)
    fresh[changes] = values[changes] - edge
    return fresh
