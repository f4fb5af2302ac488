"""Resample logs at the samples of the filter: torques at the motors, and readings that carry information.

A reading that repeats the last one carries little or no information: encoders count in steps, and failing sensors often
repeat themselves. If drums stick, standstill is excluded: there the direction of friction is unknown, and the filter,
which linearises friction at its estimate of the speed, would take the slope for information.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from dualwinch.toolbox import ConfigurationError, Experiment, sensing
from dualwinch.toolboxes.identification.log import TORQUES, Log, longest_step
from dualwinch.toolboxes.identification.options import DEFAULTS, ResamplingOptions
from dualwinch.toolboxes.identification.predictor import READINGS, RecordedExperiment

Floats = NDArray[np.float64]

ANGLES = ("theta_1", "theta_2")


_ROUNDING = np.sqrt(np.finfo(float).eps)
"""Rounding error of the time of a row in samples, at most: a row at a sample is not one of the sample before."""


def delays_of(sensors: sensing.Sensors) -> dict[str, float]:
    """Delay in s of each reading, as described."""
    encoders = dict.fromkeys(("theta_1", "theta_2", "omega_1", "omega_2"), sensors.encoder_delay)
    cells = dict.fromkeys(("F1", "F2"), sensors.tension_delay)
    return {"x": sensors.position_delay, "v": sensors.speed_delay} | cells | encoders


def counting(sensors: sensing.Sensors) -> tuple[str, ...]:
    """Readings that count in steps larger than their noise: drum angles, and a position that is rounded coarsely."""
    coarse = sensors.position_resolution / math.sqrt(12) > sensors.position_noise
    return (*ANGLES, "x") if coarse else ANGLES


@dataclass(frozen=True)
class LogSection:
    """A section of a log: resampled inputs (samples, inputs) and readings (samples, readings)."""

    name: str
    inputs: Floats
    readings: Floats

    @property
    def torques(self) -> Floats:
        """(samples, 2) commands in N m."""
        return self.inputs[:, 1:3]

    def upto(self, samples: int) -> "LogSection":
        """Its first samples."""
        return replace(self, inputs=self.inputs[:samples], readings=self.readings[:samples])


def sections_of(
    logs: Sequence[Log],
    experiment: Experiment,
    options: ResamplingOptions = DEFAULTS.resampling,
    *,
    standstill: bool = False,
) -> tuple[LogSection, ...]:
    """Resample all logs, with one section per interval of motion; with `standstill` each log as a whole.

    Sections are not cut further: disturbances at the end of a section and at the beginning of the next are the same,
    and a restarted filter would count them twice.

    Raises:
        ConfigurationError: as in `resampled`.
    """
    sections: list[LogSection] = []
    for log in logs:
        inputs, readings = resampled(log, experiment, options)
        all_samples = [slice(0, len(readings))]
        sections += [
            LogSection(log.name, np.ascontiguousarray(inputs[rows]), np.ascontiguousarray(readings[rows]))
            for rows in (all_samples if standstill else moving_intervals(readings, experiment, options))
        ]
    return tuple(sections)


def resampled(
    log: Log, experiment: Experiment, options: ResamplingOptions = DEFAULTS.resampling
) -> tuple[Floats, Floats]:
    """Resampled inputs (samples, inputs) and readings (samples, readings) of a log.

    Each reading is assigned to the sample nearest to its time less the described delay of its sensor. With jitter
    (``simulation.jitter``), sample times are those of the log, else multiples of the sample time. Torque commands are
    held until the next or, with ``options.between_rows``, at their mean between rows. They reach the motors
    ``simulation.delay_samples`` later; samples before the first arrival are dropped.

    Raises:
        ConfigurationError: too few rows, or no torque for longer than ``options.longest_gap``.
    """
    if len(log.t) < options.min_rows:
        raise ConfigurationError(f"{log.name}: has {len(log.t)} rows: must be {options.min_rows} or more")
    step, delay = experiment.simulation.sample_time, experiment.simulation.delay_samples
    recorder = experiment.recorder if isinstance(experiment, RecordedExperiment) else None
    numbers, elapsed = np.rint((log.t - log.t[0]) / step).astype(int), log.t - log.t[0]
    if recorder:
        elapsed = _even(elapsed, step)
        numbers = np.floor((recorder.phase + (1 + recorder.rate_error) * elapsed) / step + _ROUNDING).astype(int)
        numbers -= recorder.steps * (numbers[0] // recorder.steps)
    count = int(numbers[-1]) + 1
    commands = recorder.steps * (numbers // recorder.steps) if recorder else numbers
    commanded = np.column_stack([_held_torque(log, name, commands, count, step, options) for name in TORQUES])
    torques, shares = commanded, np.ones_like(commanded)
    if options.between_rows:
        torques, shares = _between_rows(commanded, numbers, options, step)
    rows, in_steps = np.full((len(log.t), len(READINGS)), np.nan), counting(experiment.sensors)
    for column, name in enumerate(READINGS):
        # if there is an angle too, a drum speed is most likely its difference, half a sample late
        is_difference = name.startswith("omega") and name.replace("omega", "theta") in log.readings
        if name in log.columns and not is_difference:
            values = log.columns[name]
            mask = np.isfinite(values)
            fresh = _counted(values[mask]) if name in in_steps else _without_repeats(values[mask], options.repeats)
            rows[mask, column] = fresh
    readings = np.full((count, len(READINGS)), np.nan)
    if recorder:  # the rows of a sample have different times: the one with most readings is used
        fullest = _fullest(numbers, np.isfinite(rows).sum(axis=1))
        readings[numbers[fullest]] = rows[fullest]
        at_row = np.zeros((count, 3))
        at_row[numbers[fullest], :2] = np.column_stack([elapsed - step * numbers, elapsed])[fullest]
        at_row[:, 2] = step * (np.arange(count) % recorder.steps)
    else:
        delays = delays_of(experiment.sensors)
        for column, name in enumerate(READINGS):
            sensed = numbers - round(delays[name] / step)
            valid = np.isfinite(rows[:, column]) & (sensed >= 0)
            readings[sensed[valid], column] = rows[valid, column]
        at_row = np.zeros((count, 0))
    t = _times(log.t, numbers, count, step) if experiment.simulation.jitter > 0 else log.t[0] + step * np.arange(count)
    durations = np.diff(t, append=t[-1] + step)
    arrived = torques[: count - delay] if delay else torques
    inputs = np.column_stack([t[delay:], arrived, durations[delay:], shares[: len(arrived)], at_row[delay:]])
    return np.ascontiguousarray(inputs), np.ascontiguousarray(readings[delay:])


def _times(t: Floats, numbers: NDArray[np.int_], count: int, step: float) -> Floats:
    """The time of every sample: that of its last row, interpolated in between."""
    last = np.append(np.diff(numbers) > 0, True)
    nominal = numbers[last] * step
    return np.arange(count) * step + np.interp(np.arange(count) * step, nominal, t[last] - nominal)


def _even(elapsed: Floats, step: float) -> Floats:
    """Times of rows without the jitter of their stamps: evenly spaced, where no stamp is off by half a sample."""
    rows = np.arange(len(elapsed))
    line = np.polyval(np.polyfit(rows, elapsed, 1), rows)
    return line - line[0] if np.abs(line - elapsed).max() < step / 2 else elapsed


def _fullest(numbers: NDArray[np.int_], counts: NDArray[np.int_]) -> NDArray[np.int_]:
    """The row with most readings, the last of equals, of every sample that has rows."""
    order = np.lexsort((np.arange(len(numbers)), counts, numbers))
    return order[np.diff(numbers[order], append=numbers[-1] + 1) > 0]


def _held_torque(
    log: Log, name: str, numbers: NDArray[np.int_], count: int, step: float, options: ResamplingOptions
) -> Floats:
    """A torque at every sample: that of the latest row with one."""
    values = log.columns[name]
    rows = np.flatnonzero(np.isfinite(values))
    gaps = np.diff(numbers[rows], prepend=0, append=count - 1)
    longest = longest_step(log.t, options.max_gap)
    if gaps.max() * step > longest:
        at = int(np.argmax(gaps))
        begins = log.t[0] + step * (numbers[rows[at - 1]] if at else 0)
        raise ConfigurationError(
            f"{log.name}: {name}: none for {gaps.max() * step:g} s after t = {begins:g} s: must be <= {longest:g} s"
        )
    latest = np.clip(np.searchsorted(numbers[rows], np.arange(count), side="right") - 1, 0, None)
    return values[rows[latest]]


def _between_rows(
    held: Floats, numbers: NDArray[np.int_], options: ResamplingOptions, step: float
) -> tuple[Floats, Floats]:
    """Torques that changed more often than they were logged, and the size of their chatter, (samples, 2) each.

    A torque acts at the sample of its row; until the next row its expected value is the mean of the last rows, with an
    unknown error. That mean has no later rows: in a closed loop they contain noise of later readings.
    """
    rows = held[numbers]
    width = options.torque_rows
    usual = uniform_filter1d(rows, width, axis=0, mode="nearest", origin=(width - 1) // 2)
    latest = np.searchsorted(numbers, np.arange(len(held)), side="right") - 1
    torques = usual[latest]
    off = (rows - usual) ** 2
    window = max(1, round(options.window * len(rows) / (step * len(held))))
    size = np.sqrt(np.maximum(uniform_filter1d(off, window, axis=0, mode="nearest"), 0.0))
    size = np.maximum(size, options.min_chatter * np.sqrt(np.mean(off)))
    torques[numbers] = rows
    return torques, size[latest]


def _without_repeats(values: Floats, repeats: int) -> Floats:
    """Readings, NaN where a sensor repeats a value `repeats` times or more."""
    changed = np.diff(values, prepend=np.nan) != 0
    lengths = np.diff(np.flatnonzero(changed), append=len(values))
    return np.where(changed | np.repeat(lengths < repeats, lengths), values, np.nan)


def _counted(values: Floats) -> Floats:
    """Readings of a sensor that counts at the samples at which its count changes, else NaN.

    When a slow drum has just moved by one count, its angle is at the edge of the former count, plus on average the
    motion of half a sample: half a count over the number of samples since the last change.
    """
    changes = np.flatnonzero(np.diff(values) != 0) + 1
    fresh = np.full_like(values, np.nan)
    if not len(changes):
        fresh[:1] = values[:1]
        return fresh
    jumps = np.diff(values)[changes - 1]
    count = np.abs(jumps).min()
    since = np.diff(changes, prepend=0).astype(float)
    single = np.abs(jumps) < 1.5 * count
    edge = np.where(single, np.sign(jumps) * count / 2 * (1 - 1 / np.maximum(since, 1.0)), 0.0)
    fresh[changes] = values[changes] - edge
    return fresh


def moving_intervals(
    readings: Floats, experiment: Experiment, options: ResamplingOptions = DEFAULTS.resampling
) -> list[slice]:
    """Intervals of samples in which the machine moves, from (samples, readings) of `resampled`.

    A single interval of all samples if no drum has Coulomb friction, or the machine hardly moves.
    """
    winches, step = (experiment.plant.winch_1, experiment.plant.winch_2), experiment.simulation.sample_time
    all_samples = [slice(0, len(readings))]
    if not any(winch.coulomb_friction for winch in winches):
        return all_samples
    positions = {"theta_1": winches[0].drum_radius, "theta_2": winches[1].drum_radius, "x": 1.0}
    for name, radius in positions.items():
        values = radius * readings[:, READINGS.index(name)]
        rows = np.flatnonzero(np.isfinite(values))
        if len(rows) > 1:
            break
    else:
        return all_samples
    half = max(1, round(options.window / 2 / step))
    position = np.interp(np.arange(-half, len(values) + half), rows, values[rows])
    fast = np.abs(position[2 * half :] - position[: -2 * half]) > options.standstill_speed * 2 * half * step
    edges = np.flatnonzero(np.diff(fast.astype(int), prepend=0, append=0))
    moves = [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2) if (b - a) * step >= options.min_move_time]
    return moves or all_samples
