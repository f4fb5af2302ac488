"""The time origin of vortices in a log that was cut out of a run, by least squares of its smoothed readings."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from dualwinch.identification.log import Log
from dualwinch.identification.options import DEFAULTS, EstimationOptions
from dualwinch.identification.predictor import READINGS
from dualwinch.identification.resample import resampled
from dualwinch.model.disturbance import vortex_frequency
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

NEEDED = ("x", "F1", "F2")
"""Readings that show vortices."""


def with_vortex_origin(log: Log, experiment: Experiment, options: EstimationOptions = DEFAULTS) -> Log:
    """A log whose time counts from the origin of its vortices' phase, where it begins under way and shows them.

    The phase is proportional to the time since the run began (paper Section 4.3), which a log cut out of it lacks.

    1. Position and load cells are smoothed by a Gaussian, position is differentiated twice.
    2. The net force of the ropes is regressed on acceleration, direction, and drag with vortices, for each Strouhal
       number and origin of a grid (separable least squares).
    3. The best origin is taken where it leaves clearly less than the log's first row as origin.
    """
    search, step = options.vortices, experiment.simulation.sample_time
    if any(name not in log.readings for name in NEEDED) or experiment.disturbance.integrated_phase:
        return log
    inputs, readings = resampled(log, experiment, options.resampling)
    width, known = search.smoothing / step, dict[str, Floats]()
    for name in NEEDED:
        values = readings[:, READINGS.index(name)]
        there = np.flatnonzero(np.isfinite(values))
        known[name] = np.interp(np.arange(len(values)), there, values[there])
    rows = slice(int(search.reach * width), -int(search.reach * width), max(1, int(search.spacing / step)))

    def smooth(values: Floats, order: int = 0) -> Floats:
        return gaussian_filter1d(values, width, order=order, truncate=search.reach)[rows] / step**order

    v = smooth(known["x"], 1)
    moving = np.abs(v) > options.resampling.standstill_speed
    if moving.sum() < search.least_rows or not moving[0]:
        return log
    moving[np.flatnonzero(moving)[search.most_rows :]] = False
    a, net = smooth(known["x"], 2)[moving], smooth(known["F1"] - known["F2"])[moving]
    v, t = v[moving], (inputs[rows, 0] - inputs[0, 0])[moving]
    q, _ = np.linalg.qr(np.column_stack([a, np.sign(v)]))
    net = net - q @ (q.T @ net)
    most, given = float(np.max(np.abs(v))), experiment.disturbance
    left, origins = list[float](), list[float]()
    shares = np.linspace(1 - search.strouhal_share, 1 + search.strouhal_share, search.strouhal_points)
    at_first_row = np.inf
    for share in shares.tolist():
        # phase per speed and time
        turn = float(vortex_frequency(1.0, replace(given, strouhal=share * given.strouhal), experiment.plant.vehicle))
        before = np.arange(0.0, search.longest_before, search.phase_step / (turn * most))
        drag = v * np.abs(v) * (1 - given.vortex_amplitude * np.sin(turn * v * (t + before[:, np.newaxis])))
        drag = drag - (drag @ q) @ q.T
        squares = net @ net - (drag @ net) ** 2 / np.einsum("ij,ij->i", drag, drag)
        best = int(np.argmin(squares))
        left.append(float(squares[best]))
        origins.append(float(before[best]))
        at_first_row = min(at_first_row, float(squares[0]))
    chosen = int(np.argmin(left))
    if left[chosen] > search.least_gain * at_first_row:
        return log
    origin = origins[chosen]
    note = f"{log.name}: begins under way; its vortices are those of a run that began {origin:.3g} s before"
    return replace(log, t=log.t + origin, notes=(*log.notes, note))
