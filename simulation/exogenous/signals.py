"""Exogenous signals of a run, drawn or read sample by sample, and their derivatives with respect to parameters."""

import hashlib
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal  # its exp gives the same bits everywhere
from functools import cache, lru_cache
from math import log
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.drivers.signals.draws import Words, philox
from dualwinch.codegen.drivers.signals.signals import (
    NO_LIMIT,
    Drawn,
    OutageSignal,
    RandomSignal,
    Signals,
    UniformSignal,
)
from dualwinch.codegen.source.expressions import built_once
from dualwinch.model.disturbance import Disturbance, given_signals
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.motions import no_departures
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.reference import Reference, departures, setpoint
from dualwinch.model.vehicle import Vehicle
from dualwinch.simulation.blocks import reference_inputs
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import exogenous_names
from dualwinch.simulation.sensors import Sensors, silence_of

DIGITS = sys.float_info.mant_dig
"""Bits of a draw and of a drawn seed: the precision of a float, which every file format can store."""

LARGEST_WORD = np.iinfo(np.uint64).max
"""Largest seed, and largest index in a stream."""


def stream_number(word: str) -> int:
    """The stream number of a name, such as ``"current"``: the first 64 bits of the SHA-256 of the name."""
    return int.from_bytes(hashlib.sha256(word.encode()).digest()[:8], "big")


def named_words(seed: int | Sequence[int], numbers: Sequence[int], names: Sequence[str]) -> Words:
    """Random words of `DIGITS` bits, one for each name and number, (names, numbers).

    Streams of different names or seeds are independent. There may be a seed for each number, such as that of a
    scenario; both are whole numbers from 0 to `LARGEST_WORD`.

    Raises:
        ConfigurationError: the seed is out of its range.
    """
    seeds = [seed] if isinstance(seed, int | np.integer) else seed
    for each in seeds:
        if not 0 <= each <= LARGEST_WORD:
            raise ConfigurationError(f"seed = {each}: must be a whole number from 0 to 2^64 - 1")
    keys = np.array(seeds, np.uint64)
    half, low = np.uint64(32), np.uint64(2**32 - 1)
    counts = np.array(numbers, np.uint64)
    streams = np.array([stream_number(name) for name in names], np.uint64)[:, np.newaxis]
    counter = counts & low, counts >> half, streams & low, streams >> half
    word_1, word_2, *_ = philox(counter, (keys & low, keys >> half))
    return (word_1 << half | word_2) >> np.uint64(64 - DIGITS)


def named_seed(seed: int, name: str) -> int:
    """A seed for a purpose, such as the draws of a validation set; independent for different names and seeds.

    Seeds are whole numbers from 0 to `LARGEST_WORD`.
    """
    return int(named_words(seed, [0], [f"seed: {name}"])[0, 0])


Floats: TypeAlias = NDArray[np.float64]

NO_COLUMNS: Mapping[str, NDArray[Any]] = MappingProxyType({})
"""Columns of a single experiment: none."""


class GaussMarkovSignal(NamedTuple):
    """A first-order Gauss–Markov signal; its numbers may be symbols."""

    sigma: Any
    """standard deviation."""
    time: Any = 0.0
    """correlation time in s; 0: white noise."""
    limit: Any = NO_LIMIT
    """limit of its magnitude."""
    from_zero: bool = False
    """whether it starts from zero; else it is stationary."""


def gauss_markov_signals(sensors: Sensors, sea: Disturbance, vehicle: Vehicle) -> dict[str, GaussMarkovSignal]:
    """The Gauss–Markov signals of a run by name; sensor noises have a standard deviation of 1."""
    return {
        "current": GaussMarkovSignal(sea.current_sigma, sea.current_time, sea.current_limit),
        "normal_force_variation": GaussMarkovSignal(
            sea.normal_force_sigma * vehicle.normal_force, sea.normal_force_time
        ),
        "noise.position": GaussMarkovSignal(_on(sensors.position_noise)),
        "noise.speed": GaussMarkovSignal(_on(sensors.speed_noise)),
        "noise.tension_1": GaussMarkovSignal(_on(sensors.tension_noise)),
        "noise.tension_2": GaussMarkovSignal(_on(sensors.tension_noise)),
        "noise.drift": GaussMarkovSignal(_on(sensors.position_drift), sensors.position_drift_time, from_zero=True),
    }


def _on(strength: Any) -> Any:
    """1 where a strength is positive, 0 where it is zero."""
    return ca.sign(strength) if isinstance(strength, ca.SX) else np.sign(strength)


class Sea(NamedTuple):
    """Disturbances of the vehicle at every sample, each (samples,): sums of random and given signals."""

    force: Floats
    """in N, along the track."""
    current: Floats
    """in m/s, along the track."""
    normal_force_variation: Floats
    """change of the force on the rail in N."""


def random_signals(experiment: Experiment, columns: Mapping[str, NDArray[Any]] = NO_COLUMNS) -> dict[str, Drawn]:
    """The random signals of an experiment by name; sensor noises have a standard deviation of 1.

    Each has its own stream, so that switching one on does not change the others. The experiment may represent n ones,
    with their numbers (n,) by key in `columns`.
    """
    simulation = with_leaves(experiment.simulation, columns, "simulation.")
    sensors = with_leaves(experiment.sensors, columns, "sensors.")
    sea = with_leaves(experiment.disturbance, columns, "disturbance.")
    vehicle = with_leaves(experiment.plant.vehicle, columns, "plant.vehicle.")
    signals: dict[str, Drawn] = {}
    for name, signal in gauss_markov_signals(sensors, sea, vehicle).items():
        if np.any(signal.sigma > 0):
            decay = _decay(simulation.sample_time, signal.time)
            number, sigma = stream_number(name), signal.sigma
            signals[name] = RandomSignal(simulation.seed, number, sigma, decay, signal.limit, signal.from_zero)
    seed, sample_time = simulation.seed, simulation.sample_time
    if simulation.jitter > 0:
        signals["noise.lateness"] = UniformSignal(seed, stream_number("noise.lateness"))
    if silence_of(sensors):
        period, length = (
            np.clip(np.rint(np.divide(time, sample_time)), 1, np.iinfo(np.int32).max).astype(np.int64)
            for time in (sensors.outage_period, sensors.outage_length)
        )
        signals["noise.silent"] = OutageSignal(seed, stream_number("noise.silent"), period, length)
    return signals


def _decay(sample_time: float, time: Any) -> Any:
    """Autocorrelation over one sample for correlation times in s; 0 for white noise."""
    if np.ndim(time):
        return np.array([_decay(sample_time, each) for each in time.tolist()])
    return float((Decimal(-sample_time) / Decimal(time)).exp()) if time else 0.0


@lru_cache(maxsize=4)
def _reference(
    reference: Reference, window: tuple[float, float], times: tuple[float, ...], sample_time: float, start: int, n: int
) -> dict[str, Floats]:
    """The reference, the flag of the steady state, and the previewed reference as departures from its extrapolation.

    Cached, as the scenarios of an ensemble share them.
    """
    t, half = np.arange(start, start + n) * sample_time, sample_time / 2
    point = setpoint(t, reference)
    columns = {
        "reference.x": point.x,
        "reference.v": point.v,
        "reference.a": point.a,
        "steady": (t >= window[0] - half) & (t <= window[1] + half),
    }
    if times:
        ahead = vars(departures(t, times, reference)).values()
        columns |= zip(
            leaves(no_departures(times), "ahead."), (each for of_times in ahead for each in of_times), strict=True
        )
    return {name: np.broadcast_to(values, n).astype(float) for name, values in columns.items()}


def _given(experiment: Experiment, names: Sequence[str], start: int, n: int) -> list[Floats | None]:
    """Given signals by name in `n` samples from the sample `start` on; None for signals that are not given."""
    sample_time, columns = experiment.simulation.sample_time, {}
    if "steady" in names:
        window, times = experiment.steady_window, experiment.controller.preview
        columns |= _reference(experiment.reference, window, times, sample_time, start, n)
    t: Floats = np.arange(start, start + n, dtype=np.float64) * sample_time
    columns |= {
        name: signal.sampled(t, unit)
        for name, (signal, unit) in given_signals(experiment.disturbance).items()
        if signal.given
    }
    return [columns.get(name) for name in names]


def exogenous_pieces(
    experiment: Experiment, length: int, samples: int | None = None, names: Sequence[str] | None = None
) -> Iterator[Floats]:
    """The exogenous signals of a run, (samples, names), in pieces of at most `length` samples.

    Drawn from ``simulation.seed``: the same experiment gives the same bits for any length of pieces. By default all
    samples of the run, and all exogenous signals of the closed loop in its order.
    """
    names = exogenous_names(experiment.controller) if names is None else names
    end, random = experiment.samples if samples is None else samples, random_signals(experiment)
    signals = Signals([random.get(name) for name in names])
    for start in range(0, end, length):
        table = np.empty((min(length, end - start), len(names)))
        signals.give(_given(experiment, names, start, len(table)), start)
        signals.fill(table, start)
        yield table


def exogenous_sources(
    experiment: Experiment,
    columns: Mapping[str, NDArray[Any]],
    count: int,
    *,
    further: int = 0,
    names: Sequence[str] | None = None,
) -> list[Signals]:
    """Sources of the exogenous signals of runs, from which compiled code draws them as it runs.

    Args:
        experiment: source of common values, including all given signals.
        columns: key → numbers of the runs, (count,).
        count: number of runs.
        further: number of samples after the end of a run.
        names: names of the signals; default: all exogenous signals of the closed loop, in its order.
    """
    names = exogenous_names(experiment.controller) if names is None else names
    random = random_signals(experiment)
    signals = Signals([random.get(name) for name in names])
    signals.give(_given(experiment, names, 0, experiment.samples + further), 0)
    random_parts = random_signals(experiment, columns)
    return signals.of_many([random_parts.get(name) for name in names], count)


def exogenous_signals(experiment: Experiment) -> Floats:
    """The exogenous signals of a run in one piece, (samples, exogenous)."""
    return next(exogenous_pieces(experiment, experiment.samples))


def asked_motion(experiment: Experiment) -> dict[str, Floats]:
    """The reference at every sample as input of a controller, by the names of `simulation.blocks.reference_inputs`."""
    sample_time, reference = experiment.simulation.sample_time, experiment.reference
    t = np.arange(experiment.samples) * sample_time
    points = [setpoint(t + time, reference) for time in (0.0, *experiment.controller.preview)]
    columns = [np.broadcast_to(column, len(t)) for point in points for column in (point.x, point.v, point.a)]
    return dict(zip(reference_inputs(experiment.controller), columns, strict=True))


def sea_signals(experiment: Experiment) -> Sea:
    """Disturbances of the vehicle over a whole run, as in `exogenous_signals`."""
    return Sea(*next(exogenous_pieces(experiment, experiment.samples, names=Sea._fields)).T)


def shaped_by(key: str) -> tuple[str, ...]:
    """Names of the signals that a number shapes, as scale, standard deviation, correlation time or limit."""
    scales = (name for name in given_signals(Disturbance()) if key == _scale(name))
    return (*scales, *(name for name, shaping in _signal_slopes() if shaping == key))


def check_shaped(experiment: Experiment, key: str) -> None:
    """Raise `ConfigurationError` for a number that scales a signal absent from an experiment."""
    recordings, random = given_signals(experiment.disturbance), random_signals(experiment)
    for name in shaped_by(key):
        if key == _scale(name):
            if not recordings[name][0].given:
                raise ConfigurationError(f"{key}: must scale a signal that is given")
        elif name not in random and _signal_slope(experiment, name, key)[0]:
            raise ConfigurationError(f"{key} = 0: must be > 0 where it varies (without it nothing is drawn)")


def signal_slope(experiment: Experiment, name: str, key: str) -> Floats:
    """Derivative of a signal with respect to a number that shapes it, (samples,).

    A random signal at its limit depends only on the limit.
    """
    sample_time, samples = experiment.simulation.sample_time, experiment.samples
    if key == _scale(name):
        signal, unit = given_signals(experiment.disturbance)[name]
        t: Floats = np.arange(samples, dtype=np.float64) * sample_time
        return replace(signal, scale=1.0).sampled(t, unit)
    random = random_signals(experiment).get(name)
    if not isinstance(random, RandomSignal):
        return np.zeros(samples)
    by_sigma, by_time, by_limit = _signal_slope(experiment, name, key)
    table = np.empty((samples, 1))
    Signals([replace(random, sigma=1.0, limit=NO_LIMIT)]).fill(table, 0)
    free = table[:, 0]
    slope = by_sigma * free
    if by_time:
        by_decay = random.decay * log(random.decay) ** 2 / sample_time
        slope += random.sigma * by_time * by_decay * _slope_by_decay(free, random)
    return np.where(np.abs(random.sigma * free) < random.limit, slope, by_limit * np.sign(free))


def _slope_by_decay(free: Floats, drawn: RandomSignal) -> Floats:
    """Derivative of a Gauss–Markov signal of standard deviation 1 with respect to its decay, for fixed white noise."""
    from scipy.signal import lfilter  # takes a second, and only derivatives need it

    decay, before = drawn.decay, np.append(0.0, free[:-1])
    fed = before - decay / (1 - decay**2) * (free - decay * before)
    if not drawn.from_zero:
        fed[0] = 0.0  # stationary: the first sample is that of the noise
    return np.asarray(lfilter([1.0], [1.0, -decay], fed))


def _scale(name: str) -> str:
    return f"disturbance.{name}.scale"


SHAPING = {"sensors.": Sensors(), "disturbance.": Disturbance(), "plant.vehicle.": Vehicle()}
"""Prefix of keys → group of numbers that shape random signals."""


@cache
def _keys() -> tuple[str, ...]:
    """Numbers that may shape a random signal."""
    shaping_leaves = (leaf for prefix, group in SHAPING.items() for leaf in describe(type(group), prefix).values())
    return tuple(leaf.key for leaf in shaping_leaves if leaf.kind is float)


def _signal_slope(experiment: Experiment, name: str, key: str) -> list[float]:
    """Derivatives of a random signal's standard deviation, correlation time and limit with respect to a number."""
    values = leaves(experiment)
    return _signal_slopes()[name, key]([values[key] for key in _keys()]).full().ravel().tolist()


@built_once
def _signal_slopes() -> Mapping[tuple[str, str], ca.Function]:
    """Random signal and number that shapes it → function from the values of all `_keys` to `_signal_slope`."""
    symbols = {key: ca.SX.sym(key) for key in _keys()}
    sensors, sea, vehicle = (with_leaves(group, symbols, prefix) for prefix, group in SHAPING.items())
    every = ca.vertcat(*symbols.values())
    slopes_by_signal = {}
    for name, signal in gauss_markov_signals(sensors, sea, vehicle).items():
        shape = ca.vertcat(signal.sigma, signal.time, signal.limit)
        for key, symbol in symbols.items():
            slopes = ca.sparsify(ca.jacobian(shape, symbol))
            if slopes.nnz():
                slopes_by_signal[name, key] = ca.Function("slopes", [every], [ca.densify(slopes)])
    return slopes_by_signal
