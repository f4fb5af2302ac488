"""The least preload that a run needs: tensions over time of least load, least peak or least energy, as a bound.

Only the difference of both tensions moves the vehicle; their sum, the preload, is free, and loads the motors. How
little of it there could be is an optimal control problem: tensions and torques within their limits, chosen by someone
who knows plant and sea and all that is to come. A controller needs more, for what it does not know.

Where the vehicle has to stay exactly on its reference the problem is convex, a quadratic or linear program. An error
that is allowed makes it a nonlinear one, since drag and vortices are.

Ropes stretch as their tension says at once: their damping is left out, which is 1 kN s/m, where a stretch changes by
millimetres a second. Drums have the radius of the data sheet, and the friction of the vehicle's speed.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import Literal, TypeAlias, get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.errors import DualwinchError
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.tree import numbers
from dualwinch.model.ropes import compliance, kelvin_voigt, rope_lengths, tangent_rope
from dualwinch.model.scalar import absolute
from dualwinch.simulation.analysis.required_force import motor_torque, outside_at, outside_symbols, pull
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

Least: TypeAlias = Literal["load", "peak", "energy"]
"""What is to be least: `Metrics.continuous_load`, `Metrics.peak_tension` or `Metrics.energy`."""

EVERY = 40
"""Samples in a step of the optimal control problem."""

KILONEWTONS, MILLIMETRES = 1e-3, 1e3
"""Scales of tensions and deviations in the solver."""

STANDING = 1e-3
"""Speed in m/s below which a vehicle that may move otherwise takes some energy: the solver needs a slope at rest."""

AMONG_EQUALS = 1e-4
"""Weight of the load beside what is to be least: at rest no preload takes energy, and below the peak any is allowed."""


@dataclass(frozen=True, repr=False)
class LeastPreload:
    """Tensions and torques over time, each (instants,), and what they come to.

    Attributes:
        t: time in s.
        F1, F2: tensions in N.
        tau_1, tau_2: motor torques in N m.
        e: distance from the reference in m.
        continuous_load: root mean square of the motor torques, of both winches, in N m.
        peak_tension: largest tension of both ropes in N.
        energy: work of both motors in J, braking counted like driving.
    """

    t: Floats
    F1: Floats
    F2: Floats
    tau_1: Floats
    tau_2: Floats
    e: Floats
    continuous_load: float
    peak_tension: float
    energy: float

    @property
    def preload(self) -> Floats:
        """(instants,) Sum of both tensions in N."""
        return self.F1 + self.F2

    def __repr__(self) -> str:
        """What they come to."""
        return (
            f"LeastPreload of {self.t[-1]:g} s: continuous load {self.continuous_load:.4g} N m, "
            f"largest tension {self.peak_tension:.0f} N, energy {self.energy:.4g} J"
        )


def least_preload(
    experiment: Experiment,
    least: Least = "load",
    *,
    error: float = 0.0,
    torque_rate: float | None = None,
    elastic: bool = True,
    every: int = EVERY,
) -> LeastPreload:
    """Tensions that give a run its motion and load the motors least, whatever controls it.

    The vehicle's equation (paper Section 2.3) holds with F_1 − F_2, the drums' (Section 2.4) give the torques. Tensions
    lie within tension_min and tension_max, torques within those times lever, as the winches' controllers limit them.

    Args:
        experiment: motion, disturbance, plant and limits. Its controller plays no part.
        least: ``load``, ``peak`` or ``energy``; the load decides among equals.
        error: largest distance from the reference in m that is allowed.
        torque_rate: largest rate of each motor torque in N m/s (default: any).
        elastic: whether drums take up what the ropes stretch by, as their tensions change.
        every: samples in a step, at whose ends the equations hold.

    Raises:
        ConfigurationError: a value is out of its range.
        DualwinchError: no tensions within the limits give the motion, or the solver found none.
    """
    _check(experiment, least, error, torque_rate, every)
    step = every * experiment.simulation.sample_time
    outside, limits = outside_at(experiment, every), experiment.controller.limits
    instants, free = outside.shape[1], error > 0
    plant = _with_tangent_ropes(experiment)
    given = [*numbers(plant).values(), *numbers(experiment.disturbance).values()]
    solver, found_from = _problem(instants, step, least, elastic, free)
    p = ca.vertcat(ca.vec(ca.DM(outside)), ca.DM(given))
    tension = np.array([limits.tension_min, limits.tension_max]) * KILONEWTONS
    deviation = np.full(instants if free else 0, error * MILLIMETRES)
    deviation[:2] = 0.0  # position and speed at the start
    lower = np.concatenate([np.full(2 * instants, tension[0]), -deviation, [0.0]])
    upper = np.concatenate([np.full(2 * instants, tension[1]), deviation, [np.inf]])
    levers = np.array([winch.drum_radius / winch.gear_ratio for winch in (plant.winch_1, plant.winch_2)])
    torques = np.repeat(levers, instants - 2)
    change = np.full(2 * (instants - 3), np.inf if torque_rate is None else torque_rate * step)
    below = np.full(2 * instants, -np.inf)
    found = solver(
        x0=np.clip(tension.mean(), lower, upper),
        p=p,
        lbx=lower,
        ubx=upper,
        lbg=np.concatenate([np.zeros(instants + 2), torques * limits.tension_min, -change, below]),
        ubg=np.concatenate([np.zeros(instants + 2), torques * limits.tension_max, change, np.zeros(2 * instants)]),
    )
    if not solver.stats()["success"]:
        raise DualwinchError(
            f"least_preload: no tensions within {limits.tension_min:g} to {limits.tension_max:g} N"
            f"{'' if torque_rate is None else f', of torques that change by {torque_rate:g} N m/s at most,'} give the "
            f"motion to within {error:g} m (IPOPT: {solver.stats()['return_status']}); allow a larger error"
        )
    F1, F2, tau_1, tau_2, e, load, energy = (np.asarray(part, float).ravel() for part in found_from(found["x"], p))
    peak = float(max(F1.max(), F2.max()))
    return LeastPreload(outside[0], F1, F2, tau_1, tau_2, e, float(load[0]), peak, float(energy[0]))


def _check(experiment: Experiment, least: str, error: float, torque_rate: float | None, every: int) -> None:
    if least not in get_args(Least):
        raise ConfigurationError(f"least = {least!r}: must be one of {', '.join(get_args(Least))}")
    if not 0 <= error < np.inf:
        raise ConfigurationError(f"error = {error:g}: must be a finite number >= 0 m")
    if torque_rate is not None and not 0 < torque_rate < np.inf:
        raise ConfigurationError(f"torque_rate = {torque_rate:g}: must be a finite number > 0 N m/s")
    if every < 1 or experiment.samples < 4 * every:
        raise ConfigurationError(f"every = {every}: must be 1 to {experiment.samples // 4} (a quarter of the samples)")


def _with_tangent_ropes(experiment: Experiment) -> Plant:
    """The plant with ropes that are linear about half the preload, amid the track."""
    plant, tension = experiment.plant, experiment.controller.limits.preload / 2
    length = plant.track.length / 2 + plant.track.rope_offset
    rope_1, rope_2 = (tangent_rope(rope, tension, length) for rope in (plant.rope_1, plant.rope_2))
    return replace(plant, rope_1=rope_1, rope_2=rope_2)


@cache
def _problem(instants: int, step: float, least: Least, elastic: bool, free: bool) -> tuple[ca.Function, ca.Function]:
    """Solver of the optimal control problem, and what follows from its solution.

    It is in both tensions in kN, the distance from the reference in mm where that is free, and the peak in kN. The
    equations hold between the first and the last instant, with speeds and accelerations by central differences.
    """
    outside_now, parameters, disturbance, plant = outside_symbols()
    outside = ca.SX.sym("outside", 7, instants)
    F1, F2, e = (ca.SX.sym(name, 1, instants) for name in ("F1", "F2", "e"))
    top = ca.SX.sym("top")
    deviation = e / MILLIMETRES if free else ca.SX.zeros(1, instants)
    t, x, v, a, *sea = ca.vertsplit(outside[:, 1:-1])
    rate, bend = _differences(deviation, step)
    moved = ca.vertcat(t, x + deviation[:, 1:-1], v + rate, a + bend, *sea)
    needed = ca.Function("pull", [outside_now, parameters], [pull(outside_now, disturbance, plant)])(moved, parameters)

    torques, pulls = [], []
    lengths = rope_lengths(outside[1, :] + deviation, plant.track)
    ropes = ((plant.winch_1, plant.rope_1, 1), (plant.winch_2, plant.rope_2, -1))
    for tension, length, (winch, rope, way) in zip((F1 / KILONEWTONS, F2 / KILONEWTONS), lengths, ropes, strict=True):
        stretch = tension * compliance(length, kelvin_voigt(rope)) if elastic else ca.SX.zeros(1, instants)
        _, stretching = _differences(stretch, step)
        speed, acceleration = way * moved[2, :], way * moved[3, :] + stretching
        torque = motor_torque(speed, acceleration, tension[:, 1:-1], winch)
        torques.append(torque)
        pulls.append(torque * winch.gear_ratio / winch.drum_radius)
    square = (ca.sumsqr(torques[0]) + ca.sumsqr(torques[1])) / (2 * (instants - 2))
    pace, pulled = moved[2, :], pulls[0] + pulls[1]
    energy = step * ca.dot(pulled, absolute(pace))
    smooth = step * ca.dot(pulled, ca.sqrt(pace**2 + STANDING**2)) if free else energy
    goal = {"load": square / 100, "peak": top, "energy": smooth / 1e5}[least]
    ends = [tension[end] - tension[beside] for tension in (F1, F2) for end, beside in ((0, 1), (-1, -2))]
    changes = [torque[:, 1:] - torque[:, :-1] for torque in torques]
    above = (F1 - top, F2 - top)
    held = [KILONEWTONS * needed - (F1 - F2)[:, 1:-1]]
    unknown = ca.vertcat(ca.vec(F1), ca.vec(F2), *([ca.vec(e)] if free else []), top)
    p = ca.vertcat(ca.vec(outside), parameters)
    problem = {
        "x": unknown,
        "p": p,
        "f": goal + (0 if least == "load" else AMONG_EQUALS * square / 100),
        "g": ca.vertcat(*(ca.vec(part) for part in (*held, *ends, *torques, *changes, *above))),
    }
    options = {
        "print_time": False,
        "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 300, "tol": 1e-8 if free else 1e-10},
    }
    solver = ca.nlpsol("least_preload", "ipopt", problem, options)
    given = [F1 / KILONEWTONS, F2 / KILONEWTONS, *torques, deviation, ca.sqrt(square), energy]
    return solver, ca.Function("found", [unknown, p], given)


def _differences(values: ca.SX, step: float) -> tuple[ca.SX, ca.SX]:
    """First and second derivative between the first and the last of values that are `step` s apart."""
    before, now, after = values[:, :-2], values[:, 1:-1], values[:, 2:]
    return (after - before) / (2 * step), (after - 2 * now + before) / step**2
