"""The local model of a tuning problem at a point, from exact sensitivities of its rollouts."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.tree import with_leaves
from dualwinch.simulation.batch.sensitivities import Sensitivities, sensitivities
from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.optimisers.local_model import Model, closeness
from dualwinch.tuning.problem import Problem, counts
from dualwinch.tuning.scoring.statistic import Statistic
from dualwinch.tuning.space import Interval, Point

Floats = NDArray[np.float64]

STRIDE = 10
"""Every how many samples an error counts in the curvature."""

STEEPEST = 1e6
"""Slope of a logarithm over a gain's range beyond which it is no guide: that of an unstable or chaotic run grows on."""


def linearise(problem: Problem, point: Point) -> Model:
    """The model at a point of the space, over its dimensions that are intervals."""
    dimensions = [one for one in problem.space.dimensions if isinstance(one, Interval)]
    keys = [key for one in dimensions for key in one.keys]
    values = dict(zip(problem.space.keys, problem.space.parameters(point), strict=True))
    scales = np.zeros((len(keys), len(dimensions)))
    for column, one in enumerate(dimensions):
        for key in one.keys:
            scales[keys.index(key), column] = _scale(one, values[key])
    scenarios = [_with(one, problem, point) for one in (*problem.tuning_scenarios, *problem.stress_scenarios)]
    run = sensitivities(keys, [[values[key] for key in keys]], scenarios, stride=STRIDE)

    def counted(statistic: Statistic) -> NDArray[np.bool_]:
        return np.array([counts(statistic, one) for one in scenarios]) & (run.outcomes[0] == "completed")

    def value(statistic: Statistic) -> float:
        return statistic.over(run.metrics[statistic.metric][0, counted(statistic)])

    objective = problem.minimised[0]
    errors = run.slopes[0, counted(objective)].reshape(-1, len(keys)) @ scales
    errors = errors[np.isfinite(errors).all(axis=1)]
    square = float(np.nanmean(run.errors[0, counted(objective)] ** 2)) * max(len(errors), 1)
    violations, slopes, belongs = [], [], []
    for place, one in enumerate(problem.bounded):
        metric = one.statistic.metric
        kept = counted(one.statistic) & np.isfinite(run.metrics[metric][0])
        share = (-1 if one.at_least else 1) / (abs(one.bound) or 1.0)
        if one.statistic.kind == "worst" and kept.any():
            rows = zip(run.metrics[metric][0, kept], run.gradients[metric][0, kept], strict=True)
        else:
            rows = [(value(one.statistic), _slope(one.statistic, run, kept))]
        for reached, slope in rows:
            beyond, rate = closeness(one, one.violation(float(reached), problem.margin(one)))
            violations.append(beyond)
            slopes.append(_usable(rate * share * slope @ scales))
            belongs.append(place)
    return Model(
        slope=_usable(_slope(objective, run, counted(objective)) @ scales / (abs(value(objective)) or 1.0)),
        curvature=_usable(2 * errors.T @ errors / square, STEEPEST**2),
        violations=np.array(violations),
        slopes=np.array(slopes).reshape(-1, len(dimensions)),
        belongs=np.array(belongs, dtype=np.intp),
    )


def _usable(slopes: Floats, steepest: float = STEEPEST) -> Floats:
    """Slopes, those that are no guide set to 0."""
    return np.where(np.abs(slopes) < steepest, slopes, 0.0)


def _with(scenario: Experiment | Scenario, problem: Problem, point: Point) -> Experiment | Scenario:
    """A scenario with the point's gains, those without a derivative among them."""
    settings = problem.space.settings(point)
    if isinstance(scenario, Scenario):
        return replace(scenario, experiment=with_leaves(scenario.experiment, settings))
    return with_leaves(scenario, settings)


def _slope(statistic: Statistic, run: Sensitivities, counted: Sequence[bool] | NDArray[np.bool_]) -> Floats:
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
