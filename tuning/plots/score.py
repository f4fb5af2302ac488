"""Figures of what the best is worth: a run before and after, and all held-out scenarios."""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metrics import metric_quantities
from dualwinch.simulation.plots.style import BLUE, GREY, VERMILION, house_style, legend_below, new_figure, time_axis
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.plots.names import shown_name, shown_unit
from dualwinch.tuning.problem import HELD_OUT, Problem
from dualwinch.tuning.scoring.verdict import Verdict

ROWS = 2500
"""Rows of a run that are drawn, at most."""

CONTENDERS = {"paper": ("paper's gains", VERMILION), "best": ("best", BLUE)}
"""Name of a score in a verdict → its label and colour."""

DISTRIBUTED = ("mse", "chatter", "peak_tension", "min_tension")
"""Figures of merit whose distribution is shown."""

BINS = 40


def before_and_after(problem: Problem, verdict: Verdict) -> Figure:
    """Error and tensions with the paper's controller and with the best, in one scenario.

    With an ensemble it is the held-out scenario in which the best does as in the middle of them.
    """
    runs, words = _runs(problem, verdict)
    experiment = problem.experiment
    limits = experiment.controller.limits
    with house_style():
        figure = new_figure(6.6, "The paper's gains and the best", words)
        panels = figure.subplots(4, 1, sharex=True, height_ratios=(1, 1, 1.2, 1.2))
        for axes, name in zip(panels, ("paper", "best"), strict=False):
            label, colour = CONTENDERS[name]
            axes.plot(runs[name]["t"], 1e3 * runs[name]["e"], color=colour, linewidth=0.8)
            axes.set(ylabel="e (mm)", title=f"tracking error, {label}")
        for rope, axes in enumerate(panels[2:], start=1):
            for name, (_, colour) in CONTENDERS.items():
                axes.plot(runs[name]["t"], 1e-3 * runs[name][f"F{rope}"], color=colour, linewidth=0.7)
            for limit in (limits.tension_min, limits.tension_max):
                axes.axhline(1e-3 * limit, color=GREY, linestyle=(0, (4, 2)), linewidth=0.8)
            axes.set(ylabel=f"F{rope} (kN)", title=f"tension of rope {rope}")
        time_axis(panels[-1], experiment)
        figure.align_ylabels()
        handles = [Line2D([], [], color=colour, label=label) for label, colour in CONTENDERS.values()]
        limit = Line2D([], [], color=GREY, linestyle=(0, (4, 2)), label="limits of the commands")
        legend_below(figure, [*handles, limit])
    return figure


def held_out(verdict: Verdict) -> Figure | None:
    """How figures of merit spread over the held-out scenarios; ``None`` without an ensemble."""
    if not verdict.held_out:
        return None
    scenarios = verdict.scored.scenarios
    with house_style():
        figure = new_figure(4.6, "Scenarios that nobody tuned on", f"Distribution over {scenarios} held-out scenarios")
        for axes, metric in zip(figure.subplots(2, 2).flat, DISTRIBUTED, strict=True):
            quantity = metric_quantities()[metric]
            values = {name: _completed(verdict, name, metric) for name in CONTENDERS}
            everything = np.concatenate(list(values.values()))
            log = bool(len(everything)) and everything.min() > 0 and everything.max() > 20 * everything.min()
            span = (np.log10(everything) if log else everything) if len(everything) else np.zeros(1)
            edges = np.linspace(span.min(), span.max() + 1e-9, BINS + 1)
            for name, (_, colour) in CONTENDERS.items():
                axes.hist(values[name], 10**edges if log else edges, color=colour, alpha=0.7, histtype="stepfilled")
            axes.set_xscale("log" if log else "linear")
            axes.set(xlabel=f"{shown_name(metric)} ({shown_unit(quantity.unit)})", ylabel="scenarios")
        handles = [Line2D([], [], color=colour, linewidth=5, label=label) for label, colour in CONTENDERS.values()]
        legend_below(figure, [*handles])
    return figure


def _completed(verdict: Verdict, name: str, metric: str) -> np.ndarray:
    result = verdict.scores[name].result
    values = result.metrics[metric][0, result.outcomes[0] == "completed"]
    return values[np.isfinite(values)]


def _runs(problem: Problem, verdict: Verdict) -> tuple[dict[str, dict[str, np.ndarray]], str]:
    """Rows of the paper's controller and of the best in one scenario, and which one it is in words."""
    experiments = {"paper": problem.paper_experiment, "best": problem.tuned(verdict.best.point)}
    index, words = 0, "The tuned experiment"
    if verdict.held_out:
        mse = verdict.scores["best"].result.metrics["mse"][0]
        index = int(np.argsort(mse)[len(mse) // 2])
        words = f"Held-out scenario {index}, in which the best does as in the middle of all"
    stride = max(1, -(-problem.experiment.samples // ROWS))
    runs: dict[str, dict[str, np.ndarray]] = {}
    for name, experiment in experiments.items():
        scenario: Experiment | Scenario = experiment
        if problem.ensemble is not None:
            scenario = replace(problem.ensemble, experiment=experiment).scenario(index, problem.seed + HELD_OUT)
        columns = rollout([], [[]], [scenario], stride=stride).columns
        runs[name] = {column: values[0, 0] for column, values in columns.items() if column in {"t", "e", "F1", "F2"}}
    return runs, words
