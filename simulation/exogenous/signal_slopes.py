"""How signals from outside change with the numbers that shape them: exact derivatives, of the same draws."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from math import log

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from dualwinch.codegen.drivers.signals.kinds import NO_LIMIT, RandomSignal
from dualwinch.codegen.drivers.signals.signals import Signals
from dualwinch.codegen.source.expressions import built_once
from dualwinch.model.disturbance import Disturbance, given_signals
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.vehicle import Vehicle
from dualwinch.simulation.exogenous.signals import courses, random_signals
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.sensors import Sensors

Floats = NDArray[np.float64]


def shaped_by(key: str) -> tuple[str, ...]:
    """Names of the signals that a number shapes: as scale, standard deviation, correlation time or limit."""
    given = (name for name in given_signals(Disturbance()) if key == _scale(name))
    return (*given, *(name for name, shaping in _course_slopes() if shaping == key))


def check_shaped(experiment: Experiment, key: str) -> None:
    """Raise `ConfigurationError` where a number scales a signal of which there is nothing in an experiment."""
    given, drawn = given_signals(experiment.disturbance), random_signals(experiment)
    for name in shaped_by(key):
        if key == _scale(name):
            if not given[name][0].given:
                raise ConfigurationError(f"{key}: must scale a signal that is given")
        elif name not in drawn and _course_slope(experiment, name, key)[0]:
            raise ConfigurationError(f"{key} = 0: must be > 0 where it varies (without it nothing is drawn)")


def signal_slope(experiment: Experiment, name: str, key: str) -> Floats:
    """Derivative of a run's signal by a number that shapes it, (samples,).

    Where a random signal is at its limit, it follows the limit alone.

    Args:
        experiment: whose run.
        name: of the signal.
        key: of the number.
    """
    sample_time, samples = experiment.simulation.sample_time, experiment.samples
    if key == _scale(name):
        signal, unit = given_signals(experiment.disturbance)[name]
        t: Floats = np.arange(samples, dtype=np.float64) * sample_time
        return replace(signal, scale=1.0).sampled(t, unit)
    drawn = random_signals(experiment).get(name)
    if not isinstance(drawn, RandomSignal):
        return np.zeros(samples)
    by_sigma, by_time, by_limit = _course_slope(experiment, name, key)
    table = np.empty((samples, 1))
    Signals([replace(drawn, sigma=1.0, limit=NO_LIMIT)]).fill(table, 0)
    free = table[:, 0]
    slope = by_sigma * free
    if by_time:
        by_decay = drawn.decay * log(drawn.decay) ** 2 / sample_time
        slope += drawn.sigma * by_time * by_decay * _slope_by_decay(free, drawn)
    return np.where(np.abs(drawn.sigma * free) < drawn.limit, slope, by_limit * np.sign(free))


def _slope_by_decay(free: Floats, drawn: RandomSignal) -> Floats:
    """Derivative of a Gauss–Markov signal of standard deviation 1 by its decay, of the same white noise."""
    decay, before = drawn.decay, np.append(0.0, free[:-1])
    fed = before - decay / (1 - decay**2) * (free - decay * before)
    if not drawn.from_zero:
        fed[0] = 0.0  # stationary: the first sample is the noise's own
    return np.asarray(lfilter([1.0], [1.0, -decay], fed))


def _scale(name: str) -> str:
    return f"disturbance.{name}.scale"


GROUPS = {"sensors.": Sensors(), "disturbance.": Disturbance(), "plant.vehicle.": Vehicle()}
"""What the courses of random signals follow from, by what its keys begin with."""


@cache
def _keys() -> tuple[str, ...]:
    """Numbers that may shape a random signal."""
    known = (leaf for prefix, group in GROUPS.items() for leaf in describe(type(group), prefix).values())
    return tuple(leaf.key for leaf in known if leaf.kind is float)


def _course_slope(experiment: Experiment, name: str, key: str) -> list[float]:
    """Derivatives of a random signal's standard deviation, correlation time and limit by a number."""
    values = leaves(experiment)
    return _course_slopes()[name, key]([values[key] for key in _keys()]).full().ravel().tolist()


@built_once
def _course_slopes() -> Mapping[tuple[str, str], ca.Function]:
    """Random signal and number that shapes it → function of the values of all `_keys` that gives `_course_slope`."""
    symbols = {key: ca.SX.sym(key) for key in _keys()}
    sensors, sea, vehicle = (with_leaves(group, symbols, prefix) for prefix, group in GROUPS.items())
    every = ca.vertcat(*symbols.values())
    found = {}
    for name, course in courses(sensors, sea, vehicle).items():
        shape = ca.vertcat(course.sigma, course.time, course.limit)
        for key, symbol in symbols.items():
            slopes = ca.sparsify(ca.jacobian(shape, symbol))
            if slopes.nnz():
                found[name, key] = ca.Function("slopes", [every], [ca.densify(slopes)])
    return found
