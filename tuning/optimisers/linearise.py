"""Linearise objective and constraints at a point, in the active scenarios: the others need no gradient."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis.margin_survey import WorstMargin
from dualwinch.analysis.resonance import RESONANCE
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.simulation.batch.sensitivities import Sensitivities, sensitivities
from dualwinch.simulation.batch.sensitivities import compile_ahead as sensitivities_ahead
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.constraints import MarginStatistic, measured
from dualwinch.tuning.optimisers.local_model import LocalModel, scaled_violation
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.rollouts import counts, run_pairs
from dualwinch.tuning.scoring.training_set import TrainingSet
from dualwinch.tuning.space import ContinuousDimension, Point

HARDEST = 3
"""Number of active scenarios of a constraint on the worst case: the next worst ones may become the worst."""


def active_scenarios(prepared: TrainingSet, point: Point) -> list[Experiment | Scenario]:
    """The scenarios that count in an objective or a mean, and the worst of each constraint on the worst case, in order.

    The point is run in all scenarios, including those of the pool, if there are several.
    """
    scenarios, space = [*prepared.scenarios, *prepared.hard], prepared.problem.space
    if len(scenarios) <= HARDEST:
        return scenarios
    result = run_pairs(space.keys, [space.parameters(point)], scenarios, prepared.workers)
    completed = result.outcomes[0] == "completed"
    chosen = set[int]()
    bounded = [(constraint.statistic, constraint.at_least) for constraint in prepared.constraints]
    for statistic, at_least in [(objective, None) for objective in prepared.problem.objectives] + bounded:
        if not isinstance(statistic, Statistic):
            continue
        counted = [index for index, scenario in enumerate(scenarios) if counts(statistic, scenario)]
        if statistic.kind == "worst" and at_least is not None:
            values = result.metrics[statistic.metric][0]
            ran = [index for index in counted if completed[index]]
            counted = sorted(ran, key=lambda index: values[index], reverse=not at_least)[:HARDEST]
        chosen.update(counted)
    return [scenarios[index] for index in sorted(chosen)]


Floats = NDArray[np.float64]

CONTACTS = (
    "plant.vehicle.bristle_stiffness",
    *(f"plant.rope_{side}.hysteresis" for side in (1, 2)),
    *(f"plant.winch_{side}.backlash" for side in (1, 2)),
)
"""Keys of stick-slip and backlash; 0: none."""

APART = 1e-5
"""Step of finite differences, as a share of a gain's range."""

NEAR_WORST = 1.2
"""Largest ratio of a machine's margin to the worst at which it counts: the worst machine may change within a step."""


def margin_slopes(
    prepared: TrainingSet, point: Point, dimensions: Sequence[ContinuousDimension]
) -> dict[MarginStatistic, list[tuple[float, Floats]]]:
    """Margins of each machine near the worst, and their slopes over shares of the gains' ranges, by finite differences.

    Differences are computed only in loops with a margin near the worst.

    Returns:
        Margin → value and slopes (dimensions,) for each machine; an unstable loop has the value 0 and slopes 0.
    """
    surveyed, problem = prepared.margins, prepared.problem
    if surveyed is None:
        return {}
    of_machines = [statistic for statistic in problem.margins if statistic.margin == RESONANCE]
    of_loops = [statistic for statistic in problem.margins if statistic.margin != RESONANCE]
    steps, moved = [], [problem.space.parameters(point)]
    for dimension in dimensions:
        share = dimension.encoded(point[dimension.name])
        step = APART if share < 0.5 else -APART
        steps.append(step)
        moved.append(problem.space.parameters(point | {dimension.name: dimension.decoded(share + step)}))
    found: dict[MarginStatistic, list[tuple[float, Floats]]] = {}
    if of_loops:
        kinds = [statistic.margin for statistic in of_loops]
        here = _values(surveyed.of_loops(moved[:1], kinds), of_loops)
        near = np.flatnonzero((here <= NEAR_WORST * here.min(axis=1)[:, None]).any(axis=(0, 2)))
        there = _values(surveyed.of_loops(moved[1:], kinds, near), of_loops)
        for number, statistic in enumerate(of_loops):
            values = np.vstack([here[:, near, number], there[:, :, number]])
            found[statistic] = _slopes_of_machines(values, surveyed.loops[near, 0], steps)
    for statistic in of_machines:
        values = _values(surveyed.each(moved, [statistic.margin]), [statistic])[:, :, 0]
        found[statistic] = _slopes_of_machines(values, np.arange(values.shape[1]), steps)
    return found


def _values(margins: Sequence[Sequence[Mapping[str, WorstMargin]]], statistics: Sequence[MarginStatistic]) -> Floats:
    """Margins as an array (n, loops or machines, statistics)."""
    return np.array([[[statistic.of(of) for statistic in statistics] for of in row] for row in margins])


def _slopes_of_machines(
    values: Floats, machine: NDArray[np.intp], steps: Sequence[float]
) -> list[tuple[float, Floats]]:
    """The least margin of each machine near the worst, and its slopes.

    Args:
        values: (1 + d, loops): at a point, and a step away along each dimension.
        machine: (loops,) index of each loop's machine.
        steps: (d,) shares of the ranges.
    """
    worst, found = values[0].min(), []
    for number in np.unique(machine):
        least = values[:, machine == number].min(axis=1)
        if least[0] <= NEAR_WORST * worst:
            found.append((float(least[0]), (least[1:] - least[0]) / np.array(steps)))
    return found


STRIDE = 10
"""Interval in samples between the errors that count in the curvature."""

STEEPEST = 1e6
"""Slope of a logarithm over a gain's range above which it is ignored: it grows without limit in an unstable run."""


def compile_ahead(problem: TuningProblem, scenario: Experiment | Scenario) -> None:
    """Compile the functions of `linearise` for scenarios like this one; nothing if no dimension has a derivative."""
    keys, values = _smooth_keys(problem, problem.start)
    if keys:
        sensitivities_ahead(keys, values, scenario)


def linearise(prepared: TrainingSet, scenarios: Sequence[Experiment | Scenario], point: Point) -> LocalModel:
    """The local model at a point of the space, over its continuous dimensions, by sensitivities of the closed loop.

    The scenarios are the active ones (`active_scenarios`).
    """
    problem = prepared.problem
    dimensions = smooth(problem)
    keys, numbers = _smooth_keys(problem, point)
    values = dict(zip(keys, numbers, strict=True))
    scales = np.zeros((len(keys), len(dimensions)))
    for column, dimension in enumerate(dimensions):
        for key in dimension.keys:
            scales[keys.index(key), column] = _scale(dimension, values[key])
    settings = problem.space.settings(point)  # all gains, including those without a derivative
    moved = [each.having(settings) if isinstance(each, Scenario) else with_leaves(each, settings) for each in scenarios]
    run = sensitivities(keys, [numbers], moved, stride=STRIDE, workers=prepared.workers)
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

    of_margins = margin_slopes(prepared, point, dimensions)

    def rows(statistic: Statistic | MarginStatistic) -> list[tuple[float, Floats]]:
        """Values of a statistic, for the worst case in each scenario or machine, and their slopes (d,)."""
        if isinstance(statistic, MarginStatistic):
            return of_margins[statistic]
        metric, kept = statistic.metric, counted(statistic) & np.isfinite(run.metrics[statistic.metric][0])
        if statistic.kind == "worst" and kept.any():
            found = zip(run.metrics[metric][0, kept], run.gradients[metric][0, kept], strict=True)
        else:
            found = [(value(statistic), _slope(statistic, run, kept))]
        return [(float(reached), slope @ scales) for reached, slope in found]

    violations, slopes, belongs = _bounded(prepared, rows)
    return LocalModel(
        slope=_usable(_slope(objective, run, counted(objective)) @ scales / (abs(value(objective)) or 1.0)),
        curvature=_usable(2 * errors.T @ errors / square, STEEPEST**2),
        violations=violations,
        slopes=slopes.reshape(-1, len(dimensions)),
        belongs=belongs,
    )


def smooth(problem: TuningProblem) -> list[ContinuousDimension]:
    """The dimensions of a problem with a derivative."""
    return [dimension for dimension in problem.space.dimensions if isinstance(dimension, ContinuousDimension)]


def gradients_guide(problem: TuningProblem) -> bool:
    """Whether gradients guide a search: a dimension has a derivative, and no machine sticks or rattles.

    With LuGre friction, hysteresis or backlash a run is smooth only between contacts. Its exact derivative says little
    of a step that a search takes, in which contacts change.
    """
    plant = leaves(problem.experiment.plant, "plant.")
    drawn = problem.ensemble.distributions if problem.ensemble else {}
    return bool(smooth(problem)) and not any(plant[key] or key in drawn for key in CONTACTS)


def _smooth_keys(problem: TuningProblem, point: Point) -> tuple[list[str], list[float]]:
    """The keys of the dimensions with a derivative, and their values at a point."""
    keys = [key for dimension in smooth(problem) for key in dimension.keys]
    values = dict(zip(problem.space.keys, problem.space.parameters(point), strict=True))
    return keys, [values[key] for key in keys]


def _bounded(
    prepared: TrainingSet, rows: Callable[[Statistic | MarginStatistic], list[tuple[float, Floats]]]
) -> tuple[Floats, Floats, NDArray[np.intp]]:
    """Violations, slopes and indices of constraints of a model, from values of statistics and their slopes."""
    violations, slopes, belongs = [], [], []
    for index, constraint in enumerate(prepared.constraints):
        share = (-1 if constraint.at_least else 1) / (abs(constraint.bound) or 1.0)
        for reached, slope in rows(constraint.statistic):
            violation = constraint.violation(reached, prepared.problem.margin(constraint))
            beyond, rate = scaled_violation(constraint, violation)
            violations.append(beyond)
            slopes.append(_usable(rate * share * slope))
            belongs.append(index)
    return np.array(violations), np.array(slopes), np.array(belongs, dtype=np.intp)


def _usable(slopes: Floats, steepest: float = STEEPEST) -> Floats:
    """Slopes, with 0 in place of those above `steepest`."""
    return np.where(np.abs(slopes) < steepest, slopes, 0.0)


def _slope(statistic: Statistic, run: Sensitivities, counted: Sequence[bool] | NDArray[np.bool_]) -> Floats:
    """(p,) derivatives of a statistic: the mean over scenarios, or those of the scenario nearest to its value."""
    values, slopes = run.metrics[statistic.metric][0, counted], run.gradients[statistic.metric][0, counted]
    if not len(values):
        return np.zeros(len(run.names))
    if statistic.kind == "mean":
        return slopes.mean(axis=0)
    return slopes[int(np.argmin(np.abs(values - measured(statistic, values))))]


def _scale(dimension: ContinuousDimension, value: float) -> float:
    """Derivative of a gain with respect to its share of the range."""
    if dimension.log:
        return float(value * np.log(dimension.upper / dimension.lower))
    return dimension.upper - dimension.lower
