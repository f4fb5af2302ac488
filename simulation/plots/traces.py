"""What is drawn of a run: every peak of long traces, and what goes on between two samples."""

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.model.plant import Plant, PlantState, tensions
from dualwinch.model.winch import drum_acceleration, winding
from dualwinch.simulation.results.result import Result

Floats = NDArray[np.float64]

COLUMNS = 900
"""Pixel columns of the widest panel on a screen; each keeps its smallest and its largest value."""

LARGEST = 1e12
"""Values beyond this, of runs that diverged, are not drawn: no axis could show them."""


def thin(t: Floats, values: Floats, columns: int = COLUMNS) -> tuple[Floats, Floats]:
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
    return np.where(np.abs(values) <= LARGEST, values, np.nan)


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


POINTS = 20
"""Points a sample."""

CONSISTENT, SAME = 1e-4, 1.0
"""How far a drum may be from its next row in rad/s, and a tension from its own in N, where the rows say it all."""

DRUMS = ("theta_1", "omega_1", "theta_2", "omega_2")
ENDS = ("x", "v", "next_x", "next_v")


def finely(result: Result, rows: slice) -> tuple[Floats, Floats, Floats]:
    """Times and tensions of both ropes in a stretch of a run, `POINTS` a sample.

    From each row on the drums are integrated once more, under the torques that the row holds; the vehicle, ten tonnes
    that no rope shakes within a millisecond, moves along the cubic through its rows. Where that does not lead to the
    next row (motors with a lag, jittering samples, rows left out), the rows themselves are returned.

    Args:
        result: a run.
        rows: of its stretch.

    Returns:
        Times in s, tensions F1 and F2 in N, each (points,).
    """
    kept = {name: result[name][rows] for name in ("t", "x", "v", "tau_1", "tau_2", "F1", "F2", *DRUMS)}
    t, span = kept["t"], result.experiment.simulation.sample_time
    as_kept = t, kept["F1"], kept["F2"]
    if len(t) < 2 or not np.allclose(np.diff(t), span, rtol=1e-6) or not all(map(_finite, kept.values())):
        return as_kept
    step = _substep(result.experiment.plant, span).map(len(t) - 1)
    drums = np.array([kept[name][:-1] for name in DRUMS])
    ends = np.array([kept["x"][:-1], kept["v"][:-1], kept["x"][1:], kept["v"][1:]])
    torques = np.array([kept["tau_1"][:-1], kept["tau_2"][:-1]])
    forces = []
    for point in range(POINTS):
        drums, pulls = (np.array(out) for out in step(drums, ends, torques, point / POINTS))
        forces.append(pulls)
    missed = np.abs(drums - np.array([kept[name][1:] for name in DRUMS])).max()
    at_rows = np.abs(forces[0] - np.array([kept["F1"][:-1], kept["F2"][:-1]])).max()
    if not (missed <= CONSISTENT and at_rows <= SAME):
        return as_kept
    fine = (t[:-1, np.newaxis] + span * np.arange(POINTS) / POINTS).ravel()
    pulled = np.array(forces).transpose(1, 2, 0).reshape(2, -1)
    last = [kept["F1"][-1], kept["F2"][-1]]
    return np.append(fine, t[-1]), np.append(pulled[0], last[0]), np.append(pulled[1], last[1])


def _finite(values: Floats) -> bool:
    return bool(np.isfinite(values).all())


def _substep(plant: Plant, span: float) -> ca.Function:
    """``(drums, ends, torques, share) -> (drums, tensions)``: one of `POINTS` steps of a sample, from its beginning."""
    drums, ends, torques = ca.SX.sym("drums", len(DRUMS)), ca.SX.sym("ends", len(ENDS)), ca.SX.sym("torques", 2)
    share = ca.SX.sym("share")

    def pulls(at: ca.SX, now: ca.SX) -> tuple[ca.SX, ca.SX]:
        begin_x, begin_v, next_x, next_v = ca.vertsplit(ends)
        x, v = _cubic(begin_x, begin_v, next_x, next_v, span, now)
        theta_1, omega_1, theta_2, omega_2 = ca.vertsplit(at)
        return tensions(PlantState(x, v, theta_1, omega_1, theta_2, omega_2), plant)

    def rate(at: ca.SX, now: ca.SX) -> ca.SX:
        force_1, force_2 = pulls(at, now)
        rates = []
        for (theta, omega), force, torque, winch in zip(
            ((at[0], at[1]), (at[2], at[3])),
            (force_1, force_2),
            ca.vertsplit(torques),
            (plant.winch_1, plant.winch_2),
            strict=True,
        ):
            rates += [omega, drum_acceleration(omega, force, torque, winch, winding(theta, winch).radius)]
        return ca.vertcat(*rates)

    h, part = span / POINTS, 1 / POINTS
    k1 = rate(drums, share)
    k2 = rate(drums + h / 2 * k1, share + part / 2)
    k3 = rate(drums + h / 2 * k2, share + part / 2)
    k4 = rate(drums + h * k3, share + part)
    moved = drums + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function("substep", [drums, ends, torques, share], [moved, ca.vertcat(*pulls(drums, share))])


def _cubic(x: ca.SX, v: ca.SX, next_x: ca.SX, next_v: ca.SX, span: float, share: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Position and speed on the cubic between two rows, at a share of the way."""
    bend = 3 * (next_x - x) - span * (2 * v + next_v)
    twist = span * (v + next_v) - 2 * (next_x - x)
    position = x + share * (span * v + share * (bend + share * twist))
    return position, v + share * (2 * bend + 3 * share * twist) / span
