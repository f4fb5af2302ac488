"""A local model of objective and constraints in logarithms, near a point of the unit cube, and steps that minimise it.

Errors, tensions and chatter change by factors when gains do, so their logarithms are far closer to linear over
logarithmic gains than the values themselves.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.scoring.ranking import Evaluation

Floats = NDArray[np.float64]

FAR = -0.9
"""Violation below which a constraint is far from active and is not scaled logarithmically."""

ELASTIC = 200.0
"""Penalty on a violation of 1 in a step, added to the objective's logarithm: larger than any multiplier."""

DAMPING = 1e-9
"""Share of the curvature's trace added to every direction, so that gains without effect do not change."""


@dataclass(frozen=True)
class LocalModel:
    """Objective and constraints near a point, in the d dimensions with a derivative.

    Attributes:
        slope: (d,) of the objective's logarithm.
        curvature: (d, d) of the objective as a share of its value, by Gauss–Newton.
        violations, slopes: (r,), (r, d) of the constraints (`scaled_violation`), positive where violated. A constraint
            on the worst case has a row for each scenario, because the worst scenario may change within a step.
        belongs: (r,) index of each row's constraint.
    """

    slope: Floats
    curvature: Floats
    violations: Floats
    slopes: Floats
    belongs: NDArray[np.intp]

    def closer(self, distances: Floats) -> "LocalModel":
        """The model with each constraint tightened by a distance (c,)."""
        return replace(self, violations=self.violations + distances[self.belongs])

    def predicted(self, step: Floats, constraints: int) -> Floats:
        """The violations (c,) after a step, by the linear model."""
        rows = self.violations + self.slopes @ step
        return np.array([rows[self.belongs == index].max() for index in range(constraints)])


def level(value: float) -> float:
    """The logarithm of an objective; for a negative one, minus the logarithm of its magnitude."""
    size = float(np.log(max(abs(value), np.finfo(float).tiny)))
    return size if value >= 0 else -size


def scaled_violation(constraint: Constraint, violation: float) -> tuple[float, float]:
    """Scaled violation of a constraint, and its derivative with respect to the violation.

    For an upper bound, with violation value/bound − 1, it is log(value/bound) unless far from the bound.
    """
    if constraint.at_least or constraint.bound <= 0 or violation < FAR:
        return violation, 1.0
    return float(np.log1p(violation)), 1 / (1 + violation)


def merit(evaluation: Evaluation, constraints: tuple[Constraint, ...], penalty: float) -> float:
    """Merit function: the objective's level plus a penalty on the worst violation; infinite for failed candidates."""
    known = {constraint.label for constraint in constraints}
    if evaluation.pruned or any(v > 0 for label, v in evaluation.violations.items() if label not in known):
        return float("inf")
    beyond = (scaled_violation(constraint, evaluation.violations[constraint.label])[0] for constraint in constraints)
    return level(evaluation.costs[0]) + penalty * max((0.0, *beyond))


def linear_step(model: LocalModel, centre: Floats, size: float) -> Floats:
    """Minimise the linear model within the constraints, a box of half width `size` and the unit cube.

    Constraints that cannot be satisfied within the box are violated as little as possible.
    """
    from scipy.optimize import linprog

    lower, upper = _box(centre, size)
    count = len(model.violations)
    found = linprog(
        np.append(model.slope, ELASTIC),
        A_ub=np.hstack([model.slopes, -np.ones((count, 1))]) if count else None,
        b_ub=-model.violations if count else None,
        bounds=[*zip(lower, upper, strict=True), (0, None)],
    )
    return np.clip(found.x[:-1], lower, upper)


def quadratic_step(model: LocalModel, centre: Floats, size: float) -> Floats:
    """`linear_step` with the objective's curvature: a Levenberg–Marquardt step if no constraint is active."""
    from scipy.optimize import minimize

    curvature = model.curvature + DAMPING * np.trace(model.curvature) * np.eye(len(centre))
    lower, upper = _box(centre, size)

    def value(x: Floats) -> tuple[float, Floats]:
        d, slack = x[:-1], x[-1]
        return (
            float(model.slope @ d + d @ curvature @ d / 2 + ELASTIC * slack),
            np.append(model.slope + curvature @ d, ELASTIC),
        )

    jacobian = np.hstack([-model.slopes, np.ones((len(model.violations), 1))])
    worst = max(0.0, float(model.violations.max(initial=0.0)))
    found = minimize(
        value,
        np.append(np.zeros(len(centre)), worst),
        jac=True,
        bounds=[*zip(lower, upper, strict=True), (0, None)],
        constraints={"type": "ineq", "fun": lambda x: jacobian @ x - model.violations, "jac": lambda _: jacobian},
        method="SLSQP",
        options={"maxiter": 200, "ftol": 1e-12},
    )
    return np.clip(found.x[:-1], lower, upper)


def sampling_covariance(curvature: Floats, rise: float, ends: tuple[float, float]) -> Floats:
    """Covariance (d, d) of points around a minimum at which the objective rises by a given share on average.

    Each principal axis of the curvature contributes equally: the flatter the objective, the wider.

    Args:
        curvature: (d, d) of the objective as a share of its value (`LocalModel`).
        rise: the mean relative rise.
        ends: the least and the largest standard deviation along an axis.
    """
    bends, axes = np.linalg.eigh(curvature)
    deviations = np.sqrt(2 * rise / len(bends) / np.maximum(bends, np.finfo(float).tiny)).clip(*ends)
    return (axes * deviations**2) @ axes.T


def _box(centre: Floats, size: float) -> tuple[Floats, Floats]:
    return np.maximum(-size, -centre), np.minimum(size, 1 - centre)
