"""Signals a run receives from outside, drawn or read sample by sample ahead of it: reference, sea, sensor noise."""

from collections.abc import Iterator
from functools import lru_cache, partial
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.disturbance import given_signals
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.reference import Reference, Setpoint, setpoint
from dualwinch.simulation.exogenous.sensors import Noise
from dualwinch.simulation.exogenous.streams import stream
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import Exogenous

Floats: TypeAlias = NDArray[np.float64]

SIGNALS = len(leaves(Exogenous(Setpoint(0.0, 0.0, 0.0))))
"""Number of signals a sample receives."""

CHUNK = 2**14
"""Samples that are drawn at a time: what they need stays in a processor's cache."""


class GaussMarkov:
    """First-order Gauss–Markov signal, stationary from its first sample; drawn piece by piece."""

    def __init__(
        self, sigma: float, correlation_time: float, sample_time: float, generator: np.random.Generator
    ) -> None:
        """Set the signal up.

        Args:
            sigma: standard deviation.
            correlation_time: in s; the autocorrelation decays by 1/e over it.
            sample_time: in s.
            generator: source of the draws.
        """
        self.sigma, self.generator = sigma, generator
        self.decay = np.exp(-sample_time / correlation_time)
        self._carried: Floats | None = None

    def draw(self, samples: int) -> Floats:
        """The next samples (samples,); the same numbers however they are divided into pieces."""
        from scipy.signal import lfilter

        draws = self.generator.standard_normal(samples)
        fresh = draws[1:] if self._carried is None else draws
        fresh *= np.sqrt(1 - self.decay**2)
        carried = np.zeros(1) if self._carried is None else self._carried
        values, self._carried = lfilter([1.0], [1.0, -self.decay], draws, zi=carried)
        return self.sigma * np.asarray(values)


class Sea(NamedTuple):
    """What acts on the vehicle, sample by sample, each (samples,): random and given signals together."""

    force: Floats
    """in N, along the track."""
    current: Floats
    """in m/s, along the track."""
    normal_force_variation: Floats
    """change of the force on the rail in N."""


class _Outside:
    """The signals of an experiment, drawn chunk after chunk.

    Each has a stream of its own, so that switching one on leaves the others as they are.
    """

    def __init__(self, experiment: Experiment) -> None:
        simulation, sea, sensors = experiment.simulation, experiment.disturbance, experiment.sensors
        named = partial(stream, simulation.seed)
        load = sea.normal_force_sigma * experiment.plant.vehicle.normal_force
        self._current = GaussMarkov(sea.current_sigma, sea.current_time, simulation.sample_time, named("current"))
        self._load = GaussMarkov(load, sea.normal_force_time, simulation.sample_time, named("normal force"))
        self._noise = [
            (named("position noise"), sensors.position_noise),
            (named("speed noise"), sensors.speed_noise),
            (named("tension 1 noise"), sensors.tension_noise),
            (named("tension 2 noise"), sensors.tension_noise),
        ]
        self._experiment = experiment

    def sea(self, start: int, samples: int) -> Sea:
        """What acts on the vehicle from the sample `start` on, the next to be drawn."""
        disturbance = self._experiment.disturbance
        t: Floats = np.arange(start, start + samples, dtype=np.float64) * self._experiment.simulation.sample_time
        given = {name: signal.sampled(t, unit) for name, (signal, unit) in given_signals(disturbance).items()}
        limit = disturbance.current_limit
        if self._current.sigma > 0:
            given["current"] += self._current.draw(samples).clip(-limit, limit)
        if self._load.sigma > 0:
            given["normal_force_variation"] += self._load.draw(samples)
        return Sea(**given)

    def fill(self, table: Floats, start: int) -> None:
        """Fill a table (samples, exogenous) with the signals from the sample `start` on, the next to be drawn."""
        n, experiment = len(table), self._experiment
        sea = self.sea(start, n)
        x, v, a, steady = _reference(
            experiment.reference, experiment.steady_window, experiment.simulation.sample_time, start, n
        )
        signals = Exogenous(
            reference=Setpoint(x, v, a),
            noise=Noise(*(drawn.standard_normal(n) if sigma > 0 else 0.0 for drawn, sigma in self._noise)),
            current=sea.current,
            normal_force_variation=sea.normal_force_variation,
            force=sea.force,
            steady=steady,
        )
        for column, values in zip(table.T, leaves(signals, whole=True).values(), strict=True):
            column[:] = values


@lru_cache(maxsize=16)
def _reference(reference: Reference, window: tuple[float, float], sample_time: float, start: int, n: int) -> Floats:
    """Rows x, v, a and 1 in the steady state; kept, as the scenarios of an ensemble share them."""
    t, half = np.arange(start, start + n) * sample_time, sample_time / 2
    wanted = setpoint(t, reference)
    steady = (t >= window[0] - half) & (t <= window[1] + half)
    return np.array([wanted.x, wanted.v, np.broadcast_to(wanted.a, n), steady], dtype=float)


def exogenous_pieces(experiment: Experiment, length: int, samples: int | None = None) -> Iterator[Floats]:
    """Everything a run receives from outside, in pieces of at most `length` samples.

    Drawn from ``simulation.seed``: the same experiment gives the same bits, however it is divided.

    Args:
        experiment: what is run.
        length: of a piece.
        samples: how many in all (default: those of the run).

    Yields:
        (samples, exogenous), columns in the closed loop's order.
    """
    outside, end = _Outside(experiment), experiment.samples if samples is None else samples
    for start in range(0, end, length):
        table = np.empty((min(length, end - start), SIGNALS))
        for first in range(0, len(table), CHUNK):
            outside.fill(table[first : first + CHUNK], start + first)
        yield table


def exogenous_signals(experiment: Experiment) -> Floats:
    """Everything a run receives from outside in one piece, (samples, exogenous)."""
    return next(exogenous_pieces(experiment, experiment.samples))


def sea_signals(experiment: Experiment) -> Sea:
    """What acts on the vehicle over a whole run, as `exogenous_signals`."""
    return _Outside(experiment).sea(0, experiment.samples)
