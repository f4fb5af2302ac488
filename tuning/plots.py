"""Figures of a search: its history, its best candidates, and the best compared with the paper's gains."""

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from dualwinch.model.quantities.quantity import behind_number
from dualwinch.model.quantities.tables import readable_unit
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.ensembles.result import Statistic, statistic_from
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metrics import metric_quantities
from dualwinch.simulation.plots.page import GivenAxes, new_page
from dualwinch.simulation.plots.style import (
    BLUE,
    GREY,
    INK,
    LIGHT,
    SKY,
    VERMILION,
    draw_limits,
    prefixed_unit,
    tension_unit,
)
from dualwinch.simulation.plots.traces import largest
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.problem import TEST, TuningProblem
from dualwinch.tuning.scoring.ranking import Evaluation, feasibility_first, pareto_front, undominated
from dualwinch.tuning.scoring.test_set import SelectionResult
from dualwinch.tuning.space import ContinuousDimension
from dualwinch.tuning.storage.record import finished_trial


def axis_title(statistic: Statistic) -> str:
    """Label of an axis: statistic and unit."""
    unit = readable_unit(statistic.unit)
    return f"{statistic.words} ({unit})" if unit else statistic.words


def short(name: str) -> str:
    """A dimension's name without the common prefix."""
    return name.removeprefix("controller.")


SHOWN_CANDIDATES = 40
"""Largest number of candidates in the figure of their gains."""

CHATTER = "mean.chatter"
"""Statistic that a single objective is drawn against."""

MANY = 3000
"""Largest number of points of a kind in a figure, evenly thinned."""


def history(problem: TuningProblem, trials: Sequence[Evaluation], *, ax: GivenAxes = None) -> Figure:
    """The first objective of every trial, and the best so far that satisfies the constraints."""
    objective = problem.objectives[0]
    values = np.array([trial.objectives[0] for trial in trials])
    feasible = np.array([trial.feasible for trial in trials])
    best = np.minimum.accumulate(np.where(feasible, values, np.inf))
    with new_page(ax, 3.4, "History of the search", f"{axis_title(objective)} of every trial") as page:
        (axes,) = page.panels()
        numbers = np.arange(len(trials))
        axes.plot(numbers, best, color=BLUE, drawstyle="steps-post", label="best so far")
        finite = np.isfinite(values)
        for group, colour, label in _by_feasibility(feasible):
            points = _thinned(numbers[group & finite])
            _dots(axes, points, values[points], colour, label)
        start = next((trial.objectives[0] for trial in trials if trial.point == problem.start), None)
        if start:
            axes.axhline(start, **START)
        _scale(axes.set_yscale, values[finite])
        axes.set(xlabel="trial", ylabel=axis_title(objective), xlim=(0, max(len(trials) - 1, 1)))
        page.legend()
    return page.figure


def importance(problem: TuningProblem, trials: Sequence[Evaluation]) -> Figure | None:
    """Importance of each gain for a candidate's being among the best tenth; ``None`` for too few trials.

    PED-ANOVA (Watanabe, Bansal and Hutter, IJCAI 2023, 4389), on the first objective.
    """
    shares = importances(problem, trials)
    if not shares:
        return None
    names = sorted(shares, key=shares.__getitem__)
    words = "Share of what tells the best tenth of the trials from the rest"
    with new_page(None, 0.9 + 0.24 * len(names), "Which gains matter", words) as page:
        (axes,) = page.panels()
        bars = axes.barh([short(name) for name in names], [shares[name] for name in names], color=BLUE, height=0.6)
        axes.bar_label(bars, [f"{100 * shares[name]:.0f} %" for name in names], padding=3, color=INK, fontsize=8)
        axes.set(xlabel="importance", xlim=(0, 1.12 * max(shares.values())))
        axes.grid(visible=False, axis="y")
    return page.figure


def importances(problem: TuningProblem, trials: Sequence[Evaluation]) -> dict[str, float]:
    """Name of a dimension → its importance, with the sum 1; empty for fewer than 20 trials."""
    import optuna

    finite = [trial for trial in trials if math.isfinite(trial.objectives[0])]
    if len(finite) < 20 or len(problem.space.dimensions) < 2:
        return {}
    study = optuna.create_study()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        single = [replace(each, objectives=each.objectives[:1], violations={}, pruned=False) for each in finite]
        study.add_trials([finished_trial(trial, problem.space) for trial in single])
        importances_by_name = optuna.importance.get_param_importances(
            study, evaluator=optuna.importance.PedAnovaImportanceEvaluator(), normalize=True
        )
    return (
        {name: float(value) for name, value in importances_by_name.items()}
        if sum(importances_by_name.values()) > 0
        else {}
    )


def best_gains(problem: TuningProblem, trials: Sequence[Evaluation], verdict: SelectionResult) -> Figure:
    """The gains of the best candidates, a row for each gain from its lower to its upper bound.

    Also drawn are the selected gains and the start.
    """
    order = [index for index in feasibility_first(trials) if not trials[index].pruned][:SHOWN_CANDIDATES]
    dimensions = problem.space.dimensions
    rows = np.arange(len(dimensions))
    words = f"The {len(order)} best trials in every searched gain, between its bounds; best darkest"
    with new_page(None, 0.9 + 0.22 * len(dimensions), "Where the best lie", words) as page:
        (axes,) = page.panels()
        axes.hlines(rows, 0, 1, color=LIGHT, linewidth=0.7)
        for rank, index in reversed(list(enumerate(order))):
            shade = 0.1 + 0.6 * (1 - rank / len(order)) ** 2
            shares = problem.space.encoded(trials[index].point)
            axes.plot(shares, rows, "|", color=BLUE, alpha=shade, markersize=9, markeredgewidth=1.2)
        points = {START["label"]: (problem.start, VERMILION)} if verdict.improved else {}
        best = (verdict.best.point, BLUE) if verdict.improved else (problem.start, VERMILION)
        points[_named(verdict)["best"]] = best
        for label, (point, colour) in points.items():
            axes.plot(problem.space.encoded(point), rows, "o", color="white", markeredgecolor=colour, label=label)
        for row, dimension in enumerate(dimensions):
            ends = (
                (f"{dimension.lower:.3g}", f"{dimension.upper:.3g}")
                if isinstance(dimension, ContinuousDimension)
                else (dimension.choices[0], dimension.choices[-1])
            )
            for text, x, align in zip(ends, (-0.02, 1.02), ("right", "left"), strict=True):
                axes.text(x, row, text, ha=align, va="center", fontsize=7.5, color=GREY)
        axes.set_yticks(rows, [short(name) for name in problem.space.names])
        axes.set_xticks([])
        axes.grid(visible=False)
        axes.tick_params(axis="y", length=0)
        for spine in axes.spines.values():
            spine.set_visible(False)
        axes.set(ylim=(len(dimensions) - 0.5, -0.5), xlim=(-0.2, 1.12))
        page.legend()
    return page.figure


def front(problem: TuningProblem, constraints: Sequence[Constraint], trials: Sequence[Evaluation]) -> Figure:
    """Two statistics against each other: the first two objectives, or a single objective and the chatter.

    Constraints, with bounds as numbers, are drawn if they are on the second statistic.
    """
    across = problem.objectives[0]
    upward = problem.objectives[1] if len(problem.objectives) > 1 else statistic_from(CHATTER)
    complete = [trial for trial in trials if not trial.pruned]
    points = np.array([[trial.statistics[statistic.name] for statistic in (across, upward)] for trial in complete])
    finite = np.isfinite(points).all(axis=1)
    feasible = np.array([trial.feasible for trial in complete]) & finite
    words = f"{axis_title(upward)} against {axis_title(across)}, complete trials"
    with new_page(None, 3.8, "Trade-offs", words) as page:
        (axes,) = page.panels()
        for group, colour, label in _by_feasibility(feasible):
            group_points = points[_thinned(np.flatnonzero(group & finite))]
            _dots(axes, group_points[:, 0], group_points[:, 1], colour, label)
        if len(problem.objectives) > 1:
            edge, label = points[pareto_front(complete)], "Pareto front"
        else:
            edge, label = points[finite][undominated(*points[finite].T)], "lower edge of all trials"
        if len(edge):
            axes.plot(*edge.T, color=BLUE, marker="o", markersize=3, label=label)
        for constraint in constraints:
            if constraint.statistic == upward and not constraint.unbounded:
                words = f"bound in the search, {constraint.bound:.3g}{behind_number(upward.unit)}"
                axes.axhline(constraint.bound, color=GREY, linestyle=(0, (1, 1.5)), label=words)
        _scale(axes.set_xscale, points[finite, 0])
        _scale(axes.set_yscale, points[finite, 1])
        axes.set(xlabel=axis_title(across), ylabel=axis_title(upward))
        page.legend()
    return page.figure


def _scale(setter: Callable[[str], None], values: np.ndarray) -> None:
    if len(values) and values.min() > 0 and values.max() > 10 * values.min():
        setter("log")


def _thinned(indices: np.ndarray) -> np.ndarray:
    return indices[:: -(-len(indices) // MANY) or 1]


START: dict[str, Any] = {"color": VERMILION, "linestyle": (0, (4, 2)), "linewidth": 0.9, "label": "start"}
"""Style of the start of a search."""


def _by_feasibility(feasible: np.ndarray) -> tuple[tuple[np.ndarray, str, str], ...]:
    """Masks of infeasible and of feasible trials, each with colour and label."""
    return (~feasible, LIGHT, "violates some"), (feasible, SKY, "satisfies the constraints")


def _dots(axes: Axes, x: np.ndarray, y: np.ndarray, colour: str, label: str) -> None:
    axes.plot(x, y, ".", markersize=3, color=colour, rasterized=True)
    axes.plot([], [], ".", markersize=7, color=colour, label=label)


ROWS = 2500
"""Largest number of drawn rows of a run."""

COLOURS = {"paper": VERMILION, "best": BLUE}
"""Name of a drawn score in a verdict → its colour."""


def _named(verdict: SelectionResult) -> dict[str, str]:
    """Name of a score in a verdict → its label."""
    return {"paper": "paper's gains", "best": "best" if verdict.improved else "start, kept"}


DISTRIBUTED = ("mse", "chatter", "peak_tension", "min_tension")
"""Metrics in the figure of distributions."""

BINS = 40


def before_and_after(problem: TuningProblem, verdict: SelectionResult) -> Figure:
    """Error and tensions with the paper's controller and with the best, in one scenario.

    With an ensemble it is the test scenario with the best's median error.
    """
    runs, words = _runs(problem, verdict)
    experiment, named = problem.experiment, _named(verdict)
    with new_page(None, 6.6, "The paper's gains and the best", words) as page:
        panels = page.panels(4, sharex=True, height_ratios=(1, 1, 1.2, 1.2))
        size, unit = force = tension_unit(
            experiment, *(largest(run[rope]) for run in runs.values() for rope in ("F1", "F2"))
        )
        for axes, name in zip(panels, ("paper", "best"), strict=False):
            label, colour = named[name], COLOURS[name]
            length, name_of_length = prefixed_unit("m", largest(runs[name]["e"]))
            axes.plot(runs[name]["t"], runs[name]["e"] / length, color=colour, linewidth=0.8, label=label)
            axes.set(ylabel=f"e ({name_of_length})", title=f"tracking error, {label}")
        for rope, axes in enumerate(panels[2:], start=1):
            for name, colour in COLOURS.items():
                tension = runs[name][f"F{rope}"] / size
                axes.plot(runs[name]["t"], tension, color=colour, linewidth=0.7, label=named[name])
            draw_limits(axes, experiment, force, label="limits of the commands,")
            axes.set(ylabel=f"F{rope} ({unit})", title=f"tension of rope {rope}")
        page.time_axes(panels, experiment, shaded=False)
        page.legend()
    return page.figure


def distributions(verdict: SelectionResult) -> Figure | None:
    """Distributions of metrics over the test scenarios; ``None`` without an ensemble."""
    if not verdict.has_test_set:
        return None
    words = f"Distribution over {verdict.scored.scenarios} scenarios that took no part in search and choice"
    with new_page(None, 4.6, "Test set", words) as page:
        for axes, metric in zip(page.panels(2, 2, "C"), DISTRIBUTED, strict=True):
            quantity = metric_quantities()[metric]
            factor, axis = quantity.scale, quantity.axis
            if quantity.shown_unit == "N":
                size, unit = prefixed_unit("N", *(largest(_completed(verdict, name, metric)) for name in COLOURS))
                factor, axis = 1 / size, f"{quantity.label} ({unit})"
            values = {name: factor * _completed(verdict, name, metric) for name in COLOURS}
            everything = np.concatenate(list(values.values()))
            log = bool(len(everything)) and everything.min() > 0 and everything.max() > 20 * everything.min()
            span = (np.log10(everything) if log else everything) if len(everything) else np.zeros(1)
            edges = np.linspace(span.min(), span.max() + 1e-9, BINS + 1)
            for name, colour in COLOURS.items():
                axes.hist(values[name], 10**edges if log else edges, color=colour, alpha=0.7, histtype="stepfilled")
            axes.set_xscale("log" if log else "linear")
            axes.set(xlabel=axis, ylabel="scenarios")
        named = _named(verdict)
        page.legend(*(Patch(facecolor=colour, alpha=0.7, label=named[name]) for name, colour in COLOURS.items()))
    return page.figure


def _completed(verdict: SelectionResult, name: str, metric: str) -> np.ndarray:
    result = verdict.scores[name].result
    values = result.metrics[metric][0, result.outcomes[0] == "completed"]
    return values[np.isfinite(values)]


def _runs(problem: TuningProblem, verdict: SelectionResult) -> tuple[dict[str, dict[str, np.ndarray]], str]:
    """Rows of a run with the paper's controller and one with the best, and their scenario in words."""
    experiments = {"paper": problem.paper_experiment, "best": problem.tuned(verdict.best.point)}
    index, words = 0, "The tuned experiment"
    if verdict.has_test_set:
        mse = verdict.scores["best"].result.metrics["mse"][0]
        index = int(np.argsort(mse)[len(mse) // 2])
        words = f"Test scenario {index}, with the best's median error"
    stride = max(1, -(-problem.experiment.samples // ROWS))
    runs: dict[str, dict[str, np.ndarray]] = {}
    for name, experiment in experiments.items():
        scenario: Experiment | Scenario = experiment
        if problem.ensemble is not None:
            scenario = replace(problem.ensemble, experiment=experiment).scenario(index, problem.stream(TEST))
        columns = rollout([], [[]], [scenario], stride=stride).columns
        runs[name] = {column: values[0, 0] for column, values in columns.items() if column in {"t", "e", "F1", "F2"}}
    return runs, words


__all__ = ["before_and_after", "best_gains", "distributions", "front", "history", "importance", "importances"]
