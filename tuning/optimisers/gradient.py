"""Gauss–Newton steps within constraints and a trust region, from exact sensitivities of the rollouts.

At the best point so far the error e_k of every scenario is linear in the gains, and so is every constraint. The squares
of that error are minimised within the linear constraints and a box around the point (sequential quadratic programming,
Nocedal and Wright, Numerical Optimization, 2006, Chapters 10 and 18): a Levenberg–Marquardt step where no constraint
binds. How large a box may be trusted is not guessed: steps of several sizes are tried side by side. Constraints are
curved; how much shows where steps were tried, and the next ones keep that distance (second-order correction, ibid.,
Section 18.3).
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.quantity import with_leaves
from simulation.ensemble import Scenario
from simulation.experiment import Experiment
from simulation.sensitivities import Sensitivities, sensitivities
from tuning.evaluation import Evaluation
from tuning.problem import Problem, counts
from tuning.ranking import best_first
from tuning.space import Interval, Point
from tuning.statistic import Statistic

Floats = NDArray[np.float64]

STRIDE = 10
"""Every how many samples an error counts in the quadratic model."""

SCOUTS = 15
"""Points spread over the space before the first step, for a valley may lie far from the start."""

SIZES = 3
"""Steps tried side by side, each half as large as the one before."""

FIRST, LARGEST, SMALLEST = 0.2, 0.5, 1e-5
"""Half widths of the first, the largest and the smallest box, in shares of each range."""

ELASTIC = 100.0
"""What a unit of violated linear constraint costs, in units of the objective: above any multiplier."""

DAMPING = 1e-9
"""Share of the largest curvature added to every direction, so that one without effect stays where it is."""


@dataclass(frozen=True)
class Model:
    """Objective and constraints near a point of the unit cube, in the d dimensions that have a derivative.

    Attributes:
        slope, curvature: (d,), (d, d) of the objective as a share of its value.
        violations, slopes: (c,), (c, d) of the constraints' violations.
    """

    slope: Floats
    curvature: Floats
    violations: Floats
    slopes: Floats

    def bent(self, distance: Floats) -> "Model":
        """The model with constraints that are closer by a distance each, (c,)."""
        return replace(self, violations=self.violations + distance)


class Gradient:
    """Trust-region Gauss–Newton from the best of the start, some scouts and whatever it is told."""

    def __init__(self, problem: Problem, seed: int, scouts: int = SCOUTS) -> None:
        """The optimiser of a problem; the same seed gives the same candidates."""
        from scipy.stats import qmc

        self._scouts = qmc.Sobol(len(problem.space.dimensions), rng=seed)
        self._scouted, self._wanted = 0, scouts
        self._problem, self._space = problem, problem.space
        self._smooth = [place for place, one in enumerate(self._space.dimensions) if isinstance(one, Interval)]
        self._best: Evaluation | None = None
        self._size = FIRST
        self._model: Model | None = None
        self._bend = np.zeros(len(problem.bounded))
        self._corrected = False

    @property
    def converged(self) -> bool:
        """Whether no step that is still tried makes anything better."""
        return self._size < SMALLEST

    def restart(self) -> None:
        """Try large steps again."""
        self._size = FIRST

    def ask(self, count: int) -> list[Point]:
        """The start and scouts, then steps of several sizes from the best point."""
        if self._best is None:
            return [self._problem.start]
        if self._scouted < self._wanted:
            number = min(count, self._wanted - self._scouted)
            self._scouted += number
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # about counts that are no powers of two
                return [self._space.decoded(shares) for shares in self._scouts.random(number)]
        if self.converged:
            self.restart()
        centre = self._space.encoded(self._best.point)
        self._model = self._model or self._linearised(self._best.point)
        points: list[Point] = []
        for place in range(min(count, SIZES)):
            moved = centre.copy()
            size = self._size / 2**place
            moved[self._smooth] += step(self._model.bent(self._bend * size**2), centre[self._smooth], size)
            point = self._space.decoded(moved)
            for kept, dimension in enumerate(self._space.dimensions):
                if kept not in self._smooth:
                    point[dimension.name] = self._best.point[dimension.name]
            points.append(point)
        return points

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        """Go to the best, and try larger steps next where a large one has won, else smaller ones."""
        if not evaluations:
            return
        leader = evaluations[best_first(evaluations)[0]]
        learnt = self._learn_bend(evaluations)
        if self._best is None or best_first([self._best, leader])[0]:
            if self._best is not None:
                moved = np.abs(self._space.encoded(leader.point) - self._space.encoded(self._best.point)).max()
                self._size = float(np.clip(4 * moved, 10 * SMALLEST, LARGEST))
            self._best, self._model, self._corrected = leader, None, False
        elif learnt and not self._corrected:
            self._corrected = True
        else:
            self._size /= 2 ** (SIZES - 1)
            self._corrected = False

    def _learn_bend(self, evaluations: Sequence[Evaluation]) -> bool:
        """Learn how far constraints leave their linear model; whether that kept a step from being taken.

        The violation beyond the model is taken for a multiple, `_bend`, of the square of the step's size.
        """
        if self._best is None or self._model is None or not len(self._bend):
            return False
        found, kept = np.zeros_like(self._bend), False
        centre = self._space.encoded(self._best.point)
        for one in evaluations:
            moved = (self._space.encoded(one.point) - centre)[self._smooth]
            size = float(np.abs(moved).max(initial=0.0))
            if not 0 < size <= 1.01 * self._size:
                continue
            violations = np.array([one.violations[constraint.label] for constraint in self._problem.bounded])
            excess = violations - (self._model.violations + self._model.slopes @ moved)
            found = np.maximum(found, excess / size**2)
            kept = kept or (not one.feasible and one.objectives[0] < self._best.objectives[0])
        self._bend = found if found.any() else self._bend
        return kept and bool(found.any())

    def _linearised(self, point: Point) -> Model:
        problem = self._problem
        dimensions = [one for one in self._space.dimensions if isinstance(one, Interval)]
        keys = [key for one in dimensions for key in one.keys]
        values = dict(zip(self._space.keys, self._space.parameters(point), strict=True))
        scales = np.zeros((len(keys), len(dimensions)))
        for column, one in enumerate(dimensions):
            for key in one.keys:
                scales[keys.index(key), column] = _scale(one, values[key])
        scenarios = problem.tuning_scenarios
        run = sensitivities(keys, [[values[key] for key in keys]], self._with(point), stride=STRIDE)

        def slope(statistic: Statistic) -> Floats:
            counted = np.array([counts(statistic, one) for one in scenarios]) & (run.outcomes[0] == "completed")
            return _slope(statistic, run, counted) @ scales

        objective = problem.minimised[0]
        counted = np.array([counts(objective, one) for one in scenarios]) & (run.outcomes[0] == "completed")
        value = objective.over(run.metrics[objective.metric][0, counted])
        errors = run.slopes[0, counted].reshape(-1, len(keys)) @ scales
        errors = errors[np.isfinite(errors).all(axis=1)]
        square = float(np.nanmean(run.errors[0, counted] ** 2))
        violations = [
            one.violation(one.statistic.over(_counted(run, one.statistic, scenarios)), problem.margin(one))
            for one in problem.bounded
        ]
        signs = [(-1 if one.at_least else 1) / (abs(one.bound) or 1.0) for one in problem.bounded]
        return Model(
            slope=slope(objective) / value,
            curvature=2 * errors.T @ errors / len(errors) / square,
            violations=np.array(violations),
            slopes=np.array(
                [sign * slope(one.statistic) for sign, one in zip(signs, problem.bounded, strict=True)]
            ).reshape(-1, len(dimensions)),
        )

    def _with(self, point: Point) -> list[Experiment | Scenario]:
        """The tuning scenarios with the point's gains, those without a derivative among them."""
        settings = self._space.settings(point)
        return [
            replace(one, experiment=with_leaves(one.experiment, settings))
            if isinstance(one, Scenario)
            else with_leaves(one, settings)
            for one in self._problem.tuning_scenarios
        ]


def step(model: Model, centre: Floats, size: float) -> Floats:
    """The step that minimises the model within the box of half width `size` and the unit cube.

    Constraints that cannot be met within the box are violated as little as possible.
    """
    from scipy.optimize import minimize

    count = len(centre)
    curvature = model.curvature + DAMPING * np.trace(model.curvature) * np.eye(count)
    lower, upper = np.maximum(-size, -centre), np.minimum(size, 1 - centre)

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
        np.append(np.zeros(count), worst),
        jac=True,
        bounds=[*zip(lower, upper, strict=True), (0, None)],
        constraints={"type": "ineq", "fun": lambda x: jacobian @ x - model.violations, "jac": lambda _: jacobian},
        method="SLSQP",
        options={"maxiter": 200, "ftol": 1e-12},
    )
    return np.clip(found.x[:-1], lower, upper)


def _counted(run: Sensitivities, statistic: Statistic, scenarios: Sequence[Experiment | Scenario]) -> Floats:
    kept = np.array([counts(statistic, one) for one in scenarios]) & (run.outcomes[0] == "completed")
    return run.metrics[statistic.metric][0, kept]


def _slope(statistic: Statistic, run: Sensitivities, counted: NDArray[np.bool_]) -> Floats:
    """(p,) derivatives of a statistic: the mean of all, or those of the scenario that decides."""
    values, slopes = run.metrics[statistic.metric][0, counted], run.gradients[statistic.metric][0, counted]
    if not len(values):
        return np.zeros(len(run.names))
    if statistic.kind == "mean":
        return slopes.mean(axis=0)
    return slopes[int(np.argmin(np.abs(values - statistic.over(values))))]


def _scale(dimension: Interval, value: float) -> float:
    """Derivative of a gain by its share of the range."""
    if dimension.log:
        return float(value * np.log(dimension.upper / dimension.lower))
    return dimension.upper - dimension.lower
