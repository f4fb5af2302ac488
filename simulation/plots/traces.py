"""Points of the lines of a run: every peak of long traces, and the tensions between two samples."""

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from dualwinch.model.plant import DisturbanceInputs, Plant, PlantState, Torques, derivative, tensions
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.results.result import Result

Floats = NDArray[np.float64]

PIXEL_COLUMNS = 900
"""Pixel columns of the widest panel on a screen; each keeps its smallest and its largest value."""

LARGEST_DRAWN = 1e12
"""Values beyond this, of runs that diverged, are not drawn: no axis could show them."""


def thin(t: Floats, values: Floats, columns: int = PIXEL_COLUMNS) -> tuple[Floats, Floats]:
    """Keep the smallest and the largest value of every pixel column, and both ends.

    Args:
        t: (rows,) times in ascending order.
        values: (rows,) signal; NaN where it has none.
        columns: pixel columns the line will span.

    Returns:
        Times and values of the points kept, in their order; all of them where they are few.
    """
    drawn = drawable(values)
    if len(t) <= 4 * columns:
        return t, drawn
    block = -(-len(t) // columns)
    indices = np.arange(-(-len(t) // block) * block).clip(max=len(t) - 1).reshape(-1, block)
    blocks = drawn[indices]
    missing = np.isnan(blocks)
    lowest = np.argmin(np.where(missing, np.inf, blocks), axis=1)
    highest = np.argmax(np.where(missing, -np.inf, blocks), axis=1)
    rows = np.arange(len(indices))
    kept = np.concatenate(([0, len(t) - 1], indices[rows, lowest], indices[rows, highest]))
    kept = np.unique(kept)
    return t[kept], drawn[kept]


def drawable(values: Floats) -> Floats:
    """A signal with NaN in place of what no axis could show."""
    return np.where(np.abs(values) <= LARGEST_DRAWN, values, np.nan)


def largest(values: Floats) -> float:
    """The largest magnitude of a signal that can be drawn; 0 where there is none."""
    return float(np.nanmax(np.abs(drawable(values)), initial=0.0))


def within(t: Floats, start: float, end: float) -> slice:
    """The rows whose time lies from `start` to `end`, both in the unit of `t`."""
    return slice(int(np.searchsorted(t, start, "left")), int(np.searchsorted(t, end, "right")))


def peaks(t: Floats, values: Floats, width: float) -> tuple[Floats, Floats]:
    """Largest magnitude in each interval of a `width`, at the interval's middle; NaN where it is zero or missing.

    Args:
        t: (rows,) times in ascending order.
        values: (rows,) signal.
        width: of an interval, in the unit of `t`.
    """
    if not len(t):
        return t, values
    interval = ((t - t[0]) / width).astype(int)
    starts = np.flatnonzero(np.diff(interval, prepend=-1))
    peak = np.fmax.reduceat(np.abs(drawable(values)), starts)
    return t[0] + (interval[starts] + 0.5) * width, np.where(peak > 0, peak, np.nan)


POINTS_A_SAMPLE = 20
"""Points a sample."""

CONSISTENT, SAME = 1e-4, 1.0
"""How far a drum may be from its next row in rad/s, and a tension from its own in N, where the rows say it all."""

DRUMS = ("theta_1", "omega_1", "theta_2", "omega_2")


def between_samples(result: Result, rows: slice) -> tuple[Floats, dict[str, Floats]]:
    """Times and tensions of both ropes in a stretch of a run, `POINTS_A_SAMPLE` a sample.

    From each row on the drums are integrated once more (Runge–Kutta, fourth order) under the torques of the row; the
    vehicle, ten tonnes that no rope shakes within a millisecond, moves along the cubic Hermite spline through its rows.
    Where that does not lead to the next row (motors with a lag, jittering samples, rows left out), the rows themselves
    are returned.

    Args:
        result: a run.
        rows: of its stretch.

    Returns:
        Times in s, and the tensions ``F1`` and ``F2`` in N, each (points,).
    """
    names = ("x", "v", "tau_1", "tau_2", "F1", "F2", *DRUMS)
    t, span = result["t"][rows], result.experiment.simulation.sample_time
    x, v, *held = columns = np.array([result[name][rows] for name in names])
    torques, F, drums = np.split(np.array(held), (2, 4))
    as_kept = t, {"F1": F[0], "F2": F[1]}
    if len(t) < 2 or not np.allclose(np.diff(t), span, rtol=1e-6) or not np.isfinite(columns).all():
        return as_kept
    step, forces = _drum_motion(result.experiment.plant)
    given = np.vstack([CubicHermiteSpline(t, x, v).c, torques[:, :-1]])
    at, found = np.vstack([drums[:, :-1], np.zeros(len(t) - 1)]), []
    for _ in range(POINTS_A_SAMPLE):
        found.append(forces(at, given).full())
        at = step(at, given, span / POINTS_A_SAMPLE).full()
    missed, apart = np.abs(at[:4] - drums[:, 1:]).max(), np.abs(found[0] - F[:, :-1]).max()
    if not (missed <= CONSISTENT and apart <= SAME):
        return as_kept
    fine = (t[:-1, np.newaxis] + span * np.arange(POINTS_A_SAMPLE) / POINTS_A_SAMPLE).ravel()
    finely = np.hstack([np.array(found).transpose(1, 2, 0).reshape(2, -1), F[:, -1:]])
    return np.append(fine, t[-1]), {"F1": finely[0], "F2": finely[1]}


def _drum_motion(plant: Plant) -> tuple[ca.Function, ca.Function]:
    """A step of the drums' motion, and the tensions, amid a sample.

    Both take the drums' states and the time since the row in s, and the coefficients of the vehicle's cubic and the
    torques.
    """
    at, given = ca.SX.sym("at", len(DRUMS) + 1), ca.SX.sym("given", 6)
    *drums, time = ca.vertsplit(at)
    *cubic, tau_1, tau_2 = ca.vertsplit(given)
    x = ca.polyval(ca.vertcat(*cubic), time)
    state = PlantState(x, ca.jacobian(x, time), *drums)
    rates = leaves(derivative(state, Torques(tau_1, tau_2), DisturbanceInputs(), plant))
    slope = ca.Function("slope", [at, given], [ca.vertcat(*(rates[name] for name in DRUMS), 1)])
    forces = ca.Function("forces", [at, given], [ca.vertcat(*tensions(state, plant))])
    return ca.simpleRK(slope, 1), forces
