"""The least tracking error that any controller could have: what the motors' largest force leaves of it.

Where the reference asks for more force than the motors can give, no gains help. The best that could be done is an
optimal control problem: torques within their limits, chosen by someone who knows the plant and all that the sea will
do, on ropes that do not stretch. Every real controller knows less, and has elastic ropes and noisy sensors in between.
"""

from functools import cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.errors import DualwinchError
from dualwinch.simulation.analysis.required_force import force_law, force_parameters, outside_at
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

EVERY = 40
"""Samples in a step of the optimal control problem."""

MILLIMETRES = 1e3
"""Scale of the deviation in the solver."""


def least_mse(experiment: Experiment, *, anticipating: bool = False) -> float:
    """Lower bound of the mean square error in m² of a run, whatever controls it; 0 where the motors can hold it.

    Minimises the mean of e² over the vehicle's motion, where the net force that it takes (`required_force`) is at most
    ``tension_max - tension_min`` either way (paper Section 3.1.1); speed and acceleration by central differences.

    Args:
        experiment: what is run.
        anticipating: whether the vehicle may leave its reference beforehand, for the sake of what is to come. A
            controller that sees only what is stays on it as long as it can; one with a preview may not.

    Raises:
        DualwinchError: the solver found no optimum.
    """
    limit = experiment.controller.limits.strength
    outside, parameters = outside_at(experiment, EVERY), force_parameters(experiment)
    beyond = np.abs(np.asarray(force_law()(outside, parameters), float).ravel()) > limit
    if not beyond.any():
        return 0.0
    instants = outside.shape[1]
    solver = _solver(instants, EVERY * experiment.simulation.sample_time)
    numbers = ca.vertcat(ca.vec(ca.DM(outside)), parameters)
    until = 2 if anticipating else max(2, int(beyond.argmax()) + 1)  # position and speed at the start
    bounds = [*[0.0] * until, *[np.inf] * (instants - until)]
    found = solver(x0=0.0, p=numbers, lbx=[-bound for bound in bounds], ubx=bounds, lbg=-limit, ubg=limit)
    if not solver.stats()["success"]:
        raise DualwinchError(f"least_mse: IPOPT stopped with {solver.stats()['return_status']}")
    return float(found["f"]) / MILLIMETRES**2


@cache
def _solver(instants: int, step: float) -> ca.Function:
    """The optimal control problem: deviations from the reference in mm at so many instants, `step` s apart."""
    law = force_law()
    deviation = ca.SX.sym("deviation", 1, instants)
    outside, parameters = ca.SX.sym("outside", 7, instants), ca.SX.sym("parameters", law.numel_in(1))
    e = deviation / MILLIMETRES
    before, now, after = e[:, :-2], e[:, 1:-1], e[:, 2:]
    t, x, v, a, *sea = ca.vertsplit(outside[:, 1:-1])
    moved = ca.vertcat(t, x + now, v + (after - before) / (2 * step), a + (after - 2 * now + before) / step**2, *sea)
    problem = {
        "x": ca.vec(deviation),
        "p": ca.vertcat(ca.vec(outside), parameters),
        "f": ca.sumsqr(deviation) / instants,
        "g": ca.vec(law(moved, parameters)),
    }
    quiet = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes"}}
    return ca.nlpsol("least_mse", "ipopt", problem, quiet)
