"""What less chatter costs in tracking: gains tuned for several bounds on chatter, in scenarios that nobody tuned on.

``python -m benchmarks.traded`` prints the table (seven minutes); ``--write FILE`` puts it between the file's two marks,
``--plot FILE`` draws it.
"""

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from benchmarks.document import markdown, put
from controllers.controller import Controller
from dualwinch import tuning_problem
from dualwinch.ensembles import load_ensemble
from simulation.paired import Comparison
from simulation.paired_run import compare, paper_controller
from simulation.plots import save
from simulation.plots.style import BLUE, GREY, VERMILION, house_style, legend_below, new_figure
from tuning.constraint import NO_PEAK, NO_SLACK
from tuning.tune import tune

ALLOWED = (0.05, 0.1, 0.15, 0.25, 0.4)
"""Bounds on the mean chatter, over that of the paper's gains."""

SECONDS, SEED = 60.0, 1
"""Length of each search, choice and score included, and its seed."""

HELD_OUT_SEED, SCENARIOS = 7, 200
"""The scenarios that score all of them."""

HEADINGS = [
    "chatter allowed, over the paper's",
    "reached",
    "mean MSE below the paper's",
    "no controller, more than",
    "within reach",
    "largest tension (N)",
    "smallest (N)",
]

PAPER = "paper"


@dataclass(frozen=True)
class Point:
    """What gains came to in the held-out scenarios: chatter in N, mean square errors in m², tensions in N."""

    name: str
    chatter: float
    mse: float
    within_reach: float
    largest: float
    smallest: float


def tuned(allowed: float) -> Controller:
    """The best controller that keeps to a bound on chatter."""
    limits = [NO_SLACK, NO_PEAK, f"mean.chatter<={allowed}*paper"]
    return tune(tuning_problem(ensemble="sea", seed=SEED, constraints=limits), seconds=SECONDS).best.controller


def points(result: Comparison) -> list[Point]:
    """A point for every controller."""
    return [
        Point(
            name=name,
            chatter=float(np.mean(one.metrics["chatter"])),
            mse=float(np.mean(one.metrics["mse"])),
            within_reach=result.mean_mse_within_reach(name),
            largest=float(np.max(one.metrics["peak_tension"])),
            smallest=float(np.min(one.metrics["min_tension"])),
        )
        for name, one in result.contenders.items()
    ]


def table(found: list[Point], least: float) -> str:
    """Every tuned point as a row of a Markdown table; `least` is the mean MSE in m² that no controller falls below."""
    paper = found[0]
    return markdown(
        HEADINGS,
        [
            [
                one.name,
                f"{one.chatter / paper.chatter:.2f}",
                f"{paper.mse / one.mse:.3g} ×",
                f"{paper.mse / least:.3g} ×",
                f"{paper.within_reach / one.within_reach:.3g} ×",
                f"{one.largest:.0f}",
                f"{one.smallest:.0f}",
            ]
            for one in found[1:]
        ],
    )


def front(found: list[Point], least: float) -> Figure:
    """Mean square error against chatter."""
    paper, *ours = found
    words = f"{SCENARIOS} held-out scenarios of 'sea' (seed {HELD_OUT_SEED}), searches of {SECONDS:g} s"
    with house_style():
        figure = new_figure(3.8, "What less chatter costs", words)
        axes = figure.subplots()
        handles: list[Line2D | Patch] = []
        for key, label, colour in (("mse", "all scenarios", VERMILION), ("within_reach", "within reach", BLUE)):
            values = [getattr(one, key) for one in ours]
            handles += axes.plot([one.chatter for one in ours], values, color=colour, marker="o", ms=4, label=label)
            axes.plot(paper.chatter, getattr(paper, key), color=colour, marker="x", markersize=6)
        handles.append(axes.axhline(least, color=VERMILION, linestyle=(0, (4, 2)), label="all: no controller has less"))
        quarter = axes.axvline(0.25 * paper.chatter, color=GREY, linestyle=(0, (1, 1.5)))
        quarter.set_label("a quarter of the paper's chatter")
        axes.annotate("paper's gains", (paper.chatter, paper.mse), (-6, -12), textcoords="offset points", ha="right")
        axes.set(xlabel="mean chatter (N)", ylabel="mean MSE (m²)", yscale="log")
        legend_below(figure, [*handles, quarter])
    return figure


def main() -> None:
    """Tune, score, and print, write or draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="figure: .svg, .png or .pdf")
    arguments = parser.parse_args()
    controllers = {PAPER: paper_controller()}
    for allowed in ALLOWED:
        sys.stderr.write(f"tuning for a chatter of at most {allowed:g} of the paper's\n")
        controllers[f"{allowed:g}"] = tuned(allowed)
    sea = load_ensemble("sea")
    sea = replace(sea, experiment=replace(sea.experiment, controller=paper_controller()))
    result = compare(controllers, sea, SCENARIOS, HELD_OUT_SEED)
    found, least = points(result), float(result.least_mse.mean())
    text = table(found, least)
    print(text)
    if arguments.write:
        put(arguments.write, "traded", text)
    if arguments.plot:
        save(front(found, least), arguments.plot)


if __name__ == "__main__":
    main()
