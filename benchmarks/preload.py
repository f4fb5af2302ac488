"""What preload buys and costs: gains tuned with a constant and with a scheduled one, in scenarios nobody tuned on.

``python -m benchmarks.preload`` prints the table (five minutes); ``--write FILE`` puts it between the file's marks.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.document import command, markdown, publish, times
from dualwinch import tuning_problem
from dualwinch.analysis.preload import optimal_preload
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.coordinations.scheduled_preload import ScheduledPreload
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.simulation.batch.authority import force_demands
from dualwinch.simulation.ensembles.comparison import Comparison, compare
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.tuning.constraints import NO_HEAVIER, NO_PEAK, NO_SLACK, QUIET
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.tune import tune

ENSEMBLE = "sea"
"""Where gains are tuned and scored."""

ROLLOUTS, SEED = 20_000, 1
"""Length of a search, which on two cores takes about a minute, and its seed."""

TEST_SEED, SCENARIOS = 7, 200
"""Seed and number of the scenarios that score."""

SCHEDULED = "controller.coordination.kind=scheduled-preload"

LOWER = (2000.0, 2500.0)
"""Constant preloads in N that gains tuned without a bound on the load are tried with."""

BOUNDED, STEP = 50, 200
"""Scenarios for which the least load is solved for, and samples in a step of that."""

HEADINGS = (
    "",
    "preload (N)",
    "load over the paper's",
    "MSE below the paper's, within authority",
    "smallest tension (N)",
    "largest (N)",
    "chatter over the paper's",
)


def searched(problem: TuningProblem) -> Controller:
    """The best controller that a search finds."""
    return tune(problem, rollouts=ROLLOUTS).best.controller


def controllers() -> Iterator[tuple[str, Controller]]:
    """What is compared, by name: tuned alike, and the first of them with lower preloads."""
    usual = [NO_SLACK, NO_PEAK, QUIET]
    bounded = [*usual, NO_HEAVIER]
    sys.stderr.write("three searches\n")
    free = searched(tuning_problem(ensemble=ENSEMBLE, seed=SEED, constraints=usual))
    yield "constant, tuned", free
    for preload in LOWER:
        yield f"these gains at {preload:.0f} N", replace(free, limits=replace(free.limits, preload=preload))
    problem = tuning_problem(ensemble=ENSEMBLE, seed=SEED, constraints=bounded)
    yield "constant, tuned within that load", searched(problem)
    problem = tuning_problem(ensemble=ENSEMBLE, seed=SEED, constraints=bounded, settings=[SCHEDULED])
    yield "**scheduled, tuned within that load**", searched(problem)


def table() -> str:
    """The controllers in the test scenarios, as a Markdown table, and the least load below them."""
    ensemble = load_ensemble(ENSEMBLE)
    ensemble = replace(ensemble, experiment=replace(ensemble.experiment, controller=paper_controller()))
    result = compare({"paper": paper_controller(), **dict(controllers())}, ensemble, SCENARIOS, TEST_SEED)
    rows = [_row(result, contender) for contender in result.contenders]
    rows.append(["optimum", "–", f"{least_load(ensemble, result):.3f}", "–", "–", "–", "–"])
    return markdown(HEADINGS, rows)


def least_load(ensemble: Ensemble, result: Comparison) -> float:
    """Least continuous load over that of the paper's gains, in the first scenarios, but for those beyond authority."""
    paper = result.contenders["paper"].metrics["continuous_load"][:BOUNDED]
    scenarios = list(ensemble.scenarios(BOUNDED, TEST_SEED))
    least, theirs = [], []
    for scenario, load, demand in zip(scenarios, paper, force_demands(scenarios), strict=True):
        if demand.share <= 1:
            least.append(optimal_preload(scenario.experiment, every=STEP).continuous_load)
            theirs.append(load)
    return float(np.mean(least) / np.mean(theirs))


def _row(result: Comparison, name: str) -> list[str]:
    paper, metrics = result.contenders["paper"].metrics, result.contenders[name].metrics
    controller = result.contenders[name].controller
    error = result.mean_mse_within_authority("paper") / result.mean_mse_within_authority(name)
    scheduled = isinstance(controller.coordination, ScheduledPreload)
    lost = np.isnan(metrics["mse"]).sum()
    return [
        name,
        "scheduled" if scheduled else f"{controller.limits.preload:.0f}",
        f"{np.nanmean(metrics['continuous_load']) / np.mean(paper['continuous_load']):.3f}",
        f"{lost} runs lost" if lost else times(error) if error > 1 else "–",
        f"{np.nanmin(metrics['min_tension']):.0f}",
        f"{np.nanmax(metrics['peak_tension']):.0f}",
        f"{np.nanmean(metrics['chatter']) / np.mean(paper['chatter']):.2f}",
    ]


def main() -> None:
    """Tune, score, and print or write."""
    publish(command(__doc__).parse_args().write, {f"preload in {ENSEMBLE}": table()})


if __name__ == "__main__":
    main()
