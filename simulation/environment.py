"""Signals a run receives from outside, drawn sample by sample ahead of it: reference, sea, sensor noise."""

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from model.quantity import leaves
from model.reference import setpoint
from simulation.closed_loop import Exogenous
from simulation.experiment import Experiment
from simulation.sensors import Noise

Floats: TypeAlias = NDArray[np.float64]

CHANNELS: tuple[str, ...] = (
    "current",
    "normal force",
    "position noise",
    "speed noise",
    "tension 1 noise",
    "tension 2 noise",
)
"""Random signals; each has a stream of its own, so that switching one on leaves the others as they are."""


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


def exogenous_pieces(experiment: Experiment, length: int) -> Iterator[Floats]:
    """Everything a run receives from outside, in pieces of at most `length` samples.

    Drawn from ``disturbance.seed``: the same experiment gives the same bits, however it is divided.

    Yields:
        (samples, exogenous), columns in the closed loop's order.
    """
    sample_time, disturbance, sensors = experiment.simulation.sample_time, experiment.disturbance, experiment.sensors
    seeds = np.random.SeedSequence(disturbance.seed).spawn(len(CHANNELS))
    streams = dict(zip(CHANNELS, map(np.random.default_rng, seeds), strict=True))
    load_sigma = disturbance.normal_force_sigma * experiment.plant.vehicle.normal_force
    current = GaussMarkov(disturbance.current_sigma, disturbance.current_time, sample_time, streams["current"])
    load = GaussMarkov(load_sigma, disturbance.normal_force_time, sample_time, streams["normal force"])
    first, last = experiment.steady_window
    half = sample_time / 2
    for start in range(0, experiment.samples, length):
        n = min(length, experiment.samples - start)
        t = np.arange(start, start + n) * sample_time
        noise = [
            streams[channel].standard_normal(n) if sigma > 0 else 0.0
            for channel, sigma in (
                ("position noise", sensors.position_noise),
                ("speed noise", sensors.speed_noise),
                ("tension 1 noise", sensors.tension_noise),
                ("tension 2 noise", sensors.tension_noise),
            )
        ]
        limit = disturbance.current_limit
        signals = Exogenous(
            reference=setpoint(t, experiment.reference),
            noise=Noise(*noise),
            current=np.clip(current.draw(n), -limit, limit) if current.sigma > 0 else 0.0,
            normal_force_variation=load.draw(n) if load.sigma > 0 else 0.0,
            steady=((t >= first - half) & (t <= last + half)).astype(float),
        )
        columns = leaves(signals)
        table = np.empty((n, len(columns)))
        for place, column in enumerate(columns.values()):
            table[:, place] = column
        yield table


def exogenous_signals(experiment: Experiment) -> Floats:
    """Everything a run receives from outside in one piece, (samples, exogenous)."""
    return next(exogenous_pieces(experiment, experiment.samples))
