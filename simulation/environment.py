"""Signals a run receives from outside, drawn sample by sample ahead of it: reference, sea, sensor noise."""

import numpy as np
from numpy.typing import NDArray

from model.quantity import leaves
from model.reference import setpoint
from simulation.closed_loop import Exogenous
from simulation.experiment import Experiment
from simulation.sensors import Noise

CHANNELS: tuple[str, ...] = (
    "current",
    "normal force",
    "position noise",
    "speed noise",
    "tension 1 noise",
    "tension 2 noise",
)
"""Random signals; each has a stream of its own, so that switching one on leaves the others as they are."""


def gauss_markov(
    samples: int, sample_time: float, sigma: float, correlation_time: float, generator: np.random.Generator
) -> NDArray[np.float64]:
    """First-order Gauss–Markov signal of standard deviation sigma, stationary from its first sample.

    Args:
        samples: length.
        sample_time: in s.
        sigma: standard deviation.
        correlation_time: in s; the autocorrelation decays by 1/e over it.
        generator: source of the draws.
    """
    from scipy.signal import lfilter

    draws = generator.standard_normal(samples)
    decay = np.exp(-sample_time / correlation_time)
    draws[1:] *= np.sqrt(1 - decay**2)
    return sigma * np.asarray(lfilter([1.0], [1.0, -decay], draws))


def exogenous_signals(experiment: Experiment) -> NDArray[np.float64]:
    """Everything a run receives from outside, (samples, exogenous), columns in the closed loop's order.

    Drawn from ``disturbance.seed``: the same experiment gives the same bits.
    """
    n, sample_time = experiment.samples, experiment.simulation.sample_time
    disturbance, sensors = experiment.disturbance, experiment.sensors
    t = np.arange(n) * sample_time
    seeds = np.random.SeedSequence(disturbance.seed).spawn(len(CHANNELS))
    streams = dict(zip(CHANNELS, map(np.random.default_rng, seeds), strict=True))

    def noise(channel: str, sigma: float) -> NDArray[np.float64] | float:
        return streams[channel].standard_normal(n) if sigma > 0 else 0.0

    current: NDArray[np.float64] | float = 0.0
    if disturbance.current_sigma > 0:
        current = gauss_markov(n, sample_time, disturbance.current_sigma, disturbance.current_time, streams["current"])
        current = np.clip(current, -disturbance.current_limit, disturbance.current_limit)
    load: NDArray[np.float64] | float = 0.0
    if disturbance.normal_force_sigma > 0:
        sigma = disturbance.normal_force_sigma * experiment.plant.vehicle.normal_force
        load = gauss_markov(n, sample_time, sigma, disturbance.normal_force_time, streams["normal force"])
    first, last = experiment.steady_window
    half = sample_time / 2
    signals = Exogenous(
        reference=setpoint(t, experiment.reference),
        noise=Noise(
            position=noise("position noise", sensors.position_noise),
            speed=noise("speed noise", sensors.speed_noise),
            tension_1=noise("tension 1 noise", sensors.tension_noise),
            tension_2=noise("tension 2 noise", sensors.tension_noise),
        ),
        current=current,
        normal_force_variation=load,
        steady=((t >= first - half) & (t <= last + half)).astype(float),
    )
    columns = leaves(signals)
    table = np.empty((n, len(columns)))
    for place, column in enumerate(columns.values()):
        table[:, place] = column
    return table
