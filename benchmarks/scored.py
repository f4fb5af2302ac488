"""Tuned gains in scenarios that nobody tuned on, beside the paper's: what the tables of searches are made of."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.document import markdown, times
from controllers.controller import Controller
from dualwinch.ensembles import load_ensemble
from simulation.paired_run import compare, paper_controller
from tuning.problem import Problem
from tuning.tune import tune

SECONDS, SEED = 60.0, 1
"""Length of each search, choice and score included, and its seed."""

HELD_OUT_SEED, SCENARIOS = 7, 200
"""The scenarios that score all of them."""

HEADINGS = (
    "chatter over the paper's",
    "mean MSE below the paper's",
    "no controller, more than",
    "within reach",
    "largest tension (N)",
    "smallest (N)",
)


@dataclass(frozen=True)
class Point:
    """What gains came to in the held-out scenarios: chatter in N, mean square errors in m², tensions in N."""

    name: str
    chatter: float
    mse: float
    within_reach: float
    largest: float
    smallest: float


@dataclass(frozen=True)
class Score:
    """Tuned gains and the paper's in the same scenarios, and the mean MSE in m² that no controller goes below."""

    paper: Point
    tuned: tuple[Point, ...]
    least: float

    def table(self, heading: str) -> str:
        """The tuned gains as rows of a Markdown table, their names under a heading."""
        rows = [
            [
                one.name,
                f"{one.chatter / self.paper.chatter:.2f}",
                times(self.paper.mse / one.mse),
                times(self.paper.mse / self.least),
                times(self.paper.within_reach / one.within_reach),
                f"{one.largest:.0f}",
                f"{one.smallest:.0f}",
            ]
            for one in self.tuned
        ]
        return markdown([heading, *HEADINGS], rows)


def searched(problem: Problem) -> Controller:
    """The best controller that a search of `SECONDS` finds."""
    return tune(problem, seconds=SECONDS).best.controller


def scored(controllers: Mapping[str, Controller]) -> Score:
    """Controllers of the sea, by name, in the held-out scenarios."""
    sea = load_ensemble("sea")
    sea = replace(sea, experiment=replace(sea.experiment, controller=paper_controller()))
    result = compare({"paper": paper_controller(), **controllers}, sea, SCENARIOS, HELD_OUT_SEED)
    paper, *ours = (
        Point(
            name=name,
            chatter=float(np.mean(one.metrics["chatter"])),
            mse=float(np.mean(one.metrics["mse"])),
            within_reach=result.mean_mse_within_reach(name),
            largest=float(np.max(one.metrics["peak_tension"])),
            smallest=float(np.min(one.metrics["min_tension"])),
        )
        for name, one in result.contenders.items()
    )
    return Score(paper, tuple(ours), float(result.least_mse.mean()))
