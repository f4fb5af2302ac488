"""Tensions of a run between two samples, from its rows."""

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from dualwinch.model.plant import DisturbanceInputs, Plant, PlantState, Torques, derivative, tensions
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.results.result import Result

Floats = NDArray[np.float64]

POINTS_A_SAMPLE = 20
"""Points per sample between rows."""

CONSISTENT, SAME = 1e-4, 1.0
"""Tolerances with which interpolation reproduces the rows: drum speed in rad/s, tension in N."""

DRUMS = ("theta_1", "omega_1", "theta_2", "omega_2")


def between_samples(result: Result, rows: slice) -> tuple[Floats, dict[str, Floats]]:
    """Times and tensions of both ropes in some rows of a run, with `POINTS_A_SAMPLE` points per sample.

    From each row on, the drums are integrated again (fourth-order Runge–Kutta) under the torques of the row; the
    vehicle, ten tonnes that no rope moves noticeably within a millisecond, follows the cubic Hermite spline through
    its rows. If that does not lead to the next row (motors with lag, jitter, omitted rows), the rows are returned.

    Returns:
        Times in s, and the tensions ``F1`` and ``F2`` in N, each (points,).
    """
    names = ("x", "v", "tau_1", "tau_2", "F1", "F2", *DRUMS)
    t, span = result["t"][rows], result.experiment.simulation.sample_time
    x, v, *held_signals = columns = np.array([result[name][rows] for name in names])
    torques, F, drums = np.split(np.array(held_signals), (2, 4))
    as_kept = t, {"F1": F[0], "F2": F[1]}
    if len(t) < 2 or not np.allclose(np.diff(t), span, rtol=1e-6) or not np.isfinite(columns).all():
        return as_kept
    step, forces = _drum_motion(result.experiment.plant)
    coefficients = np.vstack([CubicHermiteSpline(t, x, v).c, torques[:, :-1]])
    at, values = np.vstack([drums[:, :-1], np.zeros(len(t) - 1)]), []
    for _ in range(POINTS_A_SAMPLE):
        values.append(forces(at, coefficients).full())
        at = step(at, coefficients, span / POINTS_A_SAMPLE).full()
    missed, tension_gap = np.abs(at[:4] - drums[:, 1:]).max(), np.abs(values[0] - F[:, :-1]).max()
    if not (missed <= CONSISTENT and tension_gap <= SAME):
        return as_kept
    fine = (t[:-1, np.newaxis] + span * np.arange(POINTS_A_SAMPLE) / POINTS_A_SAMPLE).ravel()
    finely = np.hstack([np.array(values).transpose(1, 2, 0).reshape(2, -1), F[:, -1:]])
    return np.append(fine, t[-1]), {"F1": finely[0], "F2": finely[1]}


def _drum_motion(plant: Plant) -> tuple[ca.Function, ca.Function]:
    """Functions for a step of the drums' motion and for the tensions within a sample.

    Arguments of both are the drums' states and the time since the row in s, the coefficients of the vehicle's cubic,
    and the torques.
    """
    at, coefficients = ca.SX.sym("at", len(DRUMS) + 1), ca.SX.sym("given", 6)
    *drums, time = ca.vertsplit(at)
    *cubic, tau_1, tau_2 = ca.vertsplit(coefficients)
    x = ca.polyval(ca.vertcat(*cubic), time)
    state = PlantState(x, ca.jacobian(x, time), *drums)
    rates = leaves(derivative(state, Torques(tau_1, tau_2), DisturbanceInputs(), plant))
    slope = ca.Function("slope", [at, coefficients], [ca.vertcat(*(rates[name] for name in DRUMS), 1)])
    forces = ca.Function("forces", [at, coefficients], [ca.vertcat(*tensions(state, plant))])
    return ca.simpleRK(slope, 1), forces
