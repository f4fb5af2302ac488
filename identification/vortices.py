"""Vortices in the smoothed readings of logs, by least squares: their time origin, Strouhal number and amplitude."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

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


@dataclass(frozen=True, eq=False)
class SmoothedMotion:
    """Smoothed readings of a log where it moves, (rows,) each.

    Attributes:
        t: time in s.
        v, a: speed and acceleration in m/s and m/s².
        net: net force of the ropes in N.
        at_once: whether the machine moves at the first row.
    """

    t: Floats
    v: Floats
    a: Floats
    net: Floats
    at_once: bool

    @property
    def base(self) -> Floats:
        """(rows, 2) what net forces have beside drag: acceleration and direction."""
        return np.column_stack([self.a, np.sign(self.v)])


def smoothed_motion(log: Log, experiment: Experiment, options: EstimationOptions = DEFAULTS) -> SmoothedMotion | None:
    """Position and load cells smoothed by a Gaussian, position differentiated twice; None: too few of them."""
    search, step = options.vortices, experiment.simulation.sample_time
    if any(name not in log.readings for name in NEEDED) or experiment.disturbance.integrated_phase:
        return None
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
    if moving.sum() < search.least_rows:
        return None
    a, net, t = smooth(known["x"], 2), smooth(known["F1"] - known["F2"]), inputs[rows, 0]
    return SmoothedMotion(t[moving], v[moving], a[moving], net[moving], bool(moving[0]))


def with_vortex_origin(log: Log, experiment: Experiment, options: EstimationOptions = DEFAULTS) -> Log:
    """A log whose time counts from the origin of its vortices' phase, where it begins under way and shows them.

    The phase is proportional to the time since the run began (paper Section 4.3), which a log cut out of it lacks.

    1. The net force of the ropes is regressed on acceleration, direction, and drag with vortices (`smoothed_motion`),
       for each Strouhal number and origin of a grid (separable least squares).
    2. The best origin is taken where it leaves clearly less than the log's first row as origin.
    """
    search, motion = options.vortices, smoothed_motion(log, experiment, options)
    if motion is None or not motion.at_once:
        return log
    rows = slice(search.most_rows)
    v, t = motion.v[rows], motion.t[rows] - log.t[0]
    q, _ = np.linalg.qr(motion.base[rows])
    net = motion.net[rows] - q @ (q.T @ motion.net[rows])
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


def vortex_starts(
    logs: Sequence[Log], experiment: Experiment, reach: float, options: EstimationOptions = DEFAULTS
) -> list[tuple[float, float]]:
    """Strouhal numbers and amplitudes of vortices at which logs are likely, the likeliest first.

    1. The net force of the ropes is regressed on acceleration, direction, drag, and drag times the sine of the
       vortices' phase, for each Strouhal number of a grid within `reach` of the described one.
    2. Each minimum of the squares that are left is one, where drag and amplitude are positive: the longer a log, the
       more there are. Those with clearly larger squares than the least are left out.
    """
    search, given = options.vortices, experiment.disturbance
    motions = [each for log in logs if (each := smoothed_motion(log, experiment, options))]
    if not motions or not given.strouhal:
        return []
    t, v, net = (np.concatenate([getattr(each, name) for each in motions]) for name in ("t", "v", "net"))
    known = np.column_stack([np.concatenate([each.base for each in motions]), v * np.abs(v)])
    turn = vortex_frequency(1.0, replace(given, strouhal=1.0), experiment.plant.vehicle) * v * t  # phase by number
    count = 2 + int(reach * np.max(np.abs(turn)) / search.phase_step)
    numbers = np.linspace(max(given.strouhal - reach, 0.0), given.strouhal + reach, 2 * count + 1)
    left, ratios = np.full(len(numbers), np.inf), np.zeros(len(numbers))
    for index, number in enumerate(numbers):
        rows = np.column_stack([known, v * np.abs(v) * np.sin(number * turn)])
        found = np.linalg.lstsq(rows, net)[0]
        left[index] = np.sum((net - rows @ found) ** 2)
        ratios[index] = -found[3] / found[2] if found[2] > 0 else 0.0
    lowest = np.r_[False, (left[1:-1] < left[:-2]) & (left[1:-1] <= left[2:]), False] & (ratios > 0)
    likely = np.flatnonzero(lowest & (left < search.nearly_least * left.min()))
    return [(float(numbers[each]), float(ratios[each])) for each in likely[np.argsort(left[likely])]]
