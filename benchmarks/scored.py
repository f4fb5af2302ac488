"""Tuned gains in scenarios that nobody tuned on, beside the paper's: what the tables of searches are made of."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.document import markdown, times
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.simulation.ensembles.comparison import Comparison, compare
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.tune import tune

ROLLOUTS, SEED = 20_000, 1
"""Length of a search, which on two cores takes about a minute in the sea, and two on a rig; and its seed."""

TEST_SEED, SCENARIOS = 7, 200
"""Seed and number of the scenarios that score."""

HEADINGS = (
    "chatter over the paper's",
    "mean MSE below the paper's",
    "upper bound (ideal torques)",
    "within authority",
    "median",
    "largest tension (N)",
    "smallest (N)",
    "slack in",
)


@dataclass(frozen=True)
class Point:
    """What gains came to in the test scenarios: chatter in N, mean square errors in m², tensions in N.

    `slack` says in how many scenarios a rope was slack at any sample.
    """

    name: str
    chatter: float
    mse: float
    within_authority: float
    median: float
    largest: float
    smallest: float
    slack: str


@dataclass(frozen=True)
class Score:
    """Tuned gains and the paper's in the same scenarios, and the mean MSE in m² that no controller goes below."""

    paper: Point
    tuned: tuple[Point, ...]
    least: float

    def rows(self) -> list[list[str]]:
        """A row for each of the tuned gains, under their name and `HEADINGS`."""
        return [
            [
                score.name,
                f"{score.chatter / self.paper.chatter:.2f}",
                times(self.paper.mse / score.mse),
                times(self.paper.mse / self.least) if self.least else "–",
                times(self.paper.within_authority / score.within_authority),
                times(self.paper.median / score.median),
                f"{score.largest:.0f}",
                f"{score.smallest:.0f}",
                score.slack,
            ]
            for score in self.tuned
        ]

    def table(self, heading: str) -> str:
        """The rows as a Markdown table, the names under a heading."""
        return markdown([heading, *HEADINGS], self.rows())


def searched(problem: TuningProblem) -> Controller:
    """The best controller that a search of `ROLLOUTS` finds."""
    return tune(problem, rollouts=ROLLOUTS).best.controller


def scored(controllers: Mapping[str, Controller], seed: int = TEST_SEED) -> Score:
    """Controllers of the sea, by name, in the test scenarios of a seed."""
    sea = load_ensemble("sea")
    sea = replace(sea, experiment=replace(sea.experiment, controller=paper_controller()))
    result = compare({"paper": paper_controller(), **controllers}, sea, SCENARIOS, seed)
    paper, *ours = (_point(result, name) for name in result.contenders)
    return Score(paper, tuple(ours), result.least_errors.means[0])


def _point(result: Comparison, name: str) -> Point:
    metrics = result.contenders[name].metrics
    return Point(
        name=name,
        chatter=float(np.mean(metrics["chatter"])),
        mse=float(np.mean(metrics["mse"])),
        within_authority=result.mean_mse_within_authority(name),
        median=float(np.median(metrics["mse"])),
        largest=float(np.max(metrics["peak_tension"])),
        smallest=float(np.min(metrics["min_tension"])),
        slack=f"{np.count_nonzero(metrics['slack_share'])} of {len(result)}",
    )
