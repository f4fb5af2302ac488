"""Stability margins of a loop that was cut open: gain, phase, delay and disk."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.quantities.quantity import Quantity

Floats = NDArray[np.float64]

LOWEST, POINTS = 1e-3, 4000
"""Lowest angular frequency looked at in rad/s, and points on the way up to half the sample rate."""

NEAR_A_POLE = 41
"""Points around every lightly damped pole, whose peak the other points may step over."""


@dataclass(frozen=True)
class Margins:
    """How much a loop bears before it becomes unstable; infinite where nothing of the kind makes it unstable."""

    stable: Annotated[bool, Quantity("", "whether the closed loop is stable; margins of one that is not mean little")]
    gain: Annotated[float, Quantity("1", "largest factor on the loop gain")]
    gain_frequency: Annotated[float, Quantity("rad/s", "frequency of the oscillation at that gain")]
    least_gain: Annotated[float, Quantity("1", "smallest factor on the loop gain, 0 where it may vanish")]
    least_gain_frequency: Annotated[float, Quantity("rad/s", "frequency of the oscillation at that gain")]
    phase: Annotated[float, Quantity("deg", "largest extra phase lag")]
    phase_frequency: Annotated[float, Quantity("rad/s", "gain crossover that bears the least lag")]
    delay: Annotated[float, Quantity("s", "largest extra delay")]
    delay_frequency: Annotated[float, Quantity("rad/s", "gain crossover that bears the least delay")]
    disk: Annotated[float, Quantity("1", "radius of the largest disk of simultaneous gain and phase changes, 0 to 2")]
    disk_gain: Annotated[float, Quantity("1", "factor the gain may rise or fall by while the phase shifts too")]
    disk_phase: Annotated[float, Quantity("deg", "phase that may shift either way while the gain changes too")]
    disk_frequency: Annotated[float, Quantity("rad/s", "frequency at which the disk touches")]


def margins(loop: LinearSystem) -> Margins:
    """Margins of a loop L with negative feedback, ``1/(1 + L)``.

    The disk is the balanced one: ``L`` times any ``(1 + d/2)/(1 - d/2)`` with |d| smaller than its radius is stable.

    Args:
        loop: discrete, one input, one output, e.g. of `simulation.analysis.linear_loop.linear_broken_loop`.

    Raises:
        ConfigurationError: a continuous system, or one of several inputs or outputs.
    """
    if loop.dt is None or loop.D.shape != (1, 1):
        raise ConfigurationError("margins need a discrete system of one input and one output")
    omega = frequencies(loop)

    def response(at: float) -> complex:
        return complex(loop.response(at)[0, 0, 0])

    values = loop.response(omega)[:, 0, 0]
    real_axis = [
        (w, -1 / response(w).real)
        for w in _crossings(omega, values.imag, lambda w: response(w).imag)
        if response(w).real < 0
    ]
    end = response(float(omega[-1]))
    if end.real < 0:  # at half the sample rate the response is real
        real_axis.append((float(omega[-1]), -1 / end.real))
    rising = min(((gain, w) for w, gain in real_axis if gain > 1), default=(math.inf, math.nan))
    falling = max(((gain, w) for w, gain in real_axis if gain < 1), default=(0.0, math.nan))
    crossovers = _crossings(omega, np.abs(values) - 1, lambda w: abs(response(w)) - 1)
    lags = [float(math.pi + np.angle(response(w))) % (2 * math.pi) for w in crossovers]
    phase = min(zip(lags, crossovers, strict=True), default=(math.inf, math.nan))
    delay = min(((lag / w, w) for lag, w in zip(lags, crossovers, strict=True)), default=(math.inf, math.nan))

    def reach(at: float) -> float:
        """|(S − T)/2|: over the disk's radius, one."""
        value = response(at)
        return abs((1 - value) / (1 + value)) / 2

    peak = _largest(omega, np.abs((1 - values) / (1 + values)) / 2, reach)
    disk = 1 / reach(peak)
    closed = loop.A - loop.B @ loop.C / (1 + loop.D[0, 0])
    return Margins(
        stable=bool(np.abs(np.linalg.eigvals(closed)).max(initial=0.0) < 1),
        gain=rising[0],
        gain_frequency=rising[1],
        least_gain=falling[0],
        least_gain_frequency=falling[1],
        phase=math.degrees(phase[0]),
        phase_frequency=phase[1],
        delay=delay[0],
        delay_frequency=delay[1],
        disk=disk,
        disk_gain=(1 + disk / 2) / (1 - disk / 2) if disk < 2 else math.inf,
        disk_phase=math.degrees(2 * math.atan(disk / 2)),
        disk_frequency=peak,
    )


def frequencies(loop: LinearSystem) -> Floats:
    """Angular frequencies in rad/s up to half the sample rate, dense around lightly damped poles."""
    if loop.dt is None:
        raise ConfigurationError("margins need a discrete system")
    highest = math.pi / loop.dt
    grids = [np.geomspace(LOWEST, highest, POINTS)]
    poles = loop.poles()
    for pole in poles[(np.abs(poles) > 0) & (poles.imag > 0)]:
        rate = np.log(pole) / loop.dt
        grids.append(rate.imag + abs(rate.real) * np.linspace(-5, 5, NEAR_A_POLE))
    omega = np.unique(np.concatenate(grids))
    return omega[(omega >= LOWEST) & (omega <= highest)]


def _crossings(omega: Floats, values: Floats, function: Callable[[float], float]) -> list[float]:
    """Where a function of the frequency changes its sign."""
    from scipy import optimize

    root: Any = optimize.brentq  # its stub knows neither plain floats nor the plain answer
    intervals = np.flatnonzero(values[:-1] * values[1:] < 0)
    return [float(root(function, omega[k], omega[k + 1], xtol=1e-13, rtol=1e-13)) for k in intervals]


def _largest(omega: Floats, values: Floats, function: Callable[[float], float]) -> float:
    """The frequency at which a function is largest."""
    from scipy.optimize import minimize_scalar

    highest = int(np.argmax(values))
    between = omega[max(highest - 1, 0)], omega[min(highest + 1, len(omega) - 1)]
    found: Any = minimize_scalar(lambda w: -function(w), bounds=between, method="bounded", options={"xatol": 1e-10})
    return float(found.x) if -found.fun > values[highest] else float(omega[highest])
