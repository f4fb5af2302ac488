"""The local model of a tuning problem at a point, from exact sensitivities of its rollouts."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.batch.sensitivities import Sensitivities, sensitivities
from dualwinch.simulation.batch.sensitivities import compile_ahead as sensitivities_ahead
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.margin_statistic import MarginStatistic
from dualwinch.tuning.optimisers.local_model import Model, closeness
from dualwinch.tuning.optimisers.margin_slopes import margin_slopes
from dualwinch.tuning.prepared import Prepared
from dualwinch.tuning.problem import Problem
from dualwinch.tuning.scoring.measured import measured
from dualwinch.tuning.scoring.runs import counts
from dualwinch.tuning.space import Interval, Point

Floats = NDArray[np.float64]

STRIDE = 10
"""Every how many samples an error counts in the curvature."""

STEEPEST = 1e6
"""Slope of a logarithm over a gain's range beyond which it is no guide: that of an unstable or chaotic run grows on."""


def compile_ahead(prepared: Prepared) -> None:
    """Compile what `linearise` calls; else its first call does. Nothing where no dimension has a derivative.

    Raises:
        DualwinchError: no compiler, or no usable cache folder.
    """
    keys, values = _smooth_keys(prepared.problem, prepared.problem.start)
    if keys:
        sensitivities_ahead(keys, values, prepared.scenarios[0])


def linearise(prepared: Prepared, scenarios: Sequence[Experiment | Scenario], point: Point) -> Model:
    """The model at a point of the space, over its dimensions that are intervals.

    Args:
        prepared: gives objective and constraints.
        scenarios: those of the problem that count (`tuning.optimisers.deciding`).
        point: of the space.

    Raises:
        KeyboardInterrupt: interrupted.
    """
    problem = prepared.problem
    dimensions = smooth(problem)
    keys, numbers = _smooth_keys(problem, point)
    values = dict(zip(keys, numbers, strict=True))
    scales = np.zeros((len(keys), len(dimensions)))
    for column, dimension in enumerate(dimensions):
        for key in dimension.keys:
            scales[keys.index(key), column] = _scale(dimension, values[key])
    moved = [_with(scenario, problem, point) for scenario in scenarios]
    run = sensitivities(keys, [numbers], moved, stride=STRIDE)
    if run.interrupted:
        raise KeyboardInterrupt

    def counted(statistic: Statistic) -> NDArray[np.bool_]:
        return np.array([counts(statistic, scenario) for scenario in scenarios]) & (run.outcomes[0] == "completed")

    def value(statistic: Statistic) -> float:
        return measured(statistic, run.metrics[statistic.metric][0, counted(statistic)])

    objective = problem.objectives[0]
    errors = run.slopes[0, counted(objective)].reshape(-1, len(keys)) @ scales
    errors = errors[np.isfinite(errors).all(axis=1)]
    square = float(np.nanmean(run.errors[0, counted(objective)] ** 2)) * max(len(errors), 1)

    def rows(statistic: Statistic | MarginStatistic) -> list[tuple[float, Floats]]:
        """Values of a statistic that may decide, and their slopes (d,)."""
        if isinstance(statistic, MarginStatistic):
            return margin_slopes(prepared, point, dimensions, statistic)
        metric, kept = statistic.metric, counted(statistic) & np.isfinite(run.metrics[statistic.metric][0])
        if statistic.kind == "worst" and kept.any():
            found = zip(run.metrics[metric][0, kept], run.gradients[metric][0, kept], strict=True)
        else:
            found = [(value(statistic), _slope(statistic, run, kept))]
        return [(float(reached), slope @ scales) for reached, slope in found]

    violations, slopes, belongs = _bounded(prepared, rows)
    return Model(
        slope=_usable(_slope(objective, run, counted(objective)) @ scales / (abs(value(objective)) or 1.0)),
        curvature=_usable(2 * errors.T @ errors / square, STEEPEST**2),
        violations=violations,
        slopes=slopes.reshape(-1, len(dimensions)),
        belongs=belongs,
    )


def smooth(problem: Problem) -> list[Interval]:
    """The dimensions of a problem that have a derivative."""
    return [dimension for dimension in problem.space.dimensions if isinstance(dimension, Interval)]


def _smooth_keys(problem: Problem, point: Point) -> tuple[list[str], list[float]]:
    """The keys of these, and their values at a point."""
    keys = [key for dimension in smooth(problem) for key in dimension.keys]
    values = dict(zip(problem.space.keys, problem.space.parameters(point), strict=True))
    return keys, [values[key] for key in keys]


def _bounded(
    prepared: Prepared, rows: Callable[[Statistic | MarginStatistic], list[tuple[float, Floats]]]
) -> tuple[Floats, Floats, NDArray[np.intp]]:
    """Violations, slopes and constraints of a model, from values of a statistic and their slopes."""
    violations, slopes, belongs = [], [], []
    for index, constraint in enumerate(prepared.constraints):
        share = (-1 if constraint.at_least else 1) / (abs(constraint.bound) or 1.0)
        for reached, slope in rows(constraint.statistic):
            violation = constraint.violation(reached, prepared.problem.margin(constraint))
            beyond, rate = closeness(constraint, violation)
            violations.append(beyond)
            slopes.append(_usable(rate * share * slope))
            belongs.append(index)
    return np.array(violations), np.array(slopes), np.array(belongs, dtype=np.intp)


def _usable(slopes: Floats, steepest: float = STEEPEST) -> Floats:
    """Slopes, those that are no guide set to 0."""
    return np.where(np.abs(slopes) < steepest, slopes, 0.0)


def _with(scenario: Experiment | Scenario, problem: Problem, point: Point) -> Experiment | Scenario:
    """A scenario with the point's gains, those without a derivative among them."""
    settings = problem.space.settings(point)
    return scenario.having(settings) if isinstance(scenario, Scenario) else with_leaves(scenario, settings)


def _slope(statistic: Statistic, run: Sensitivities, counted: Sequence[bool] | NDArray[np.bool_]) -> Floats:
    """(p,) derivatives of a statistic: the mean of all, or those of the scenario that decides."""
    values, slopes = run.metrics[statistic.metric][0, counted], run.gradients[statistic.metric][0, counted]
    if not len(values):
        return np.zeros(len(run.names))
    if statistic.kind == "mean":
        return slopes.mean(axis=0)
    return slopes[int(np.argmin(np.abs(values - measured(statistic, values))))]


def _scale(dimension: Interval, value: float) -> float:
    """Derivative of a gain by its share of the range."""
    if dimension.log:
        return float(value * np.log(dimension.upper / dimension.lower))
    return dimension.upper - dimension.lower
