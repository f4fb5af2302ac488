"""What tuning for one minute and for five is worth in the sea, in scenarios that nobody tuned on.

``python -m benchmarks.tuned`` prints the table (eight minutes); ``--write FILE`` puts it between the file's two marks,
``--plot FILE`` draws what the longer search traded.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from benchmarks.document import markdown, put, times
from controllers.controller import Controller
from dualwinch import tuning_problem
from simulation.ensemble import Ensemble
from simulation.paired import Comparison
from simulation.paired_run import compare, paper_controller
from tuning.tune import Tuned, tune

MINUTES = (1, 5)
"""Lengths of the searches."""

SEED, HELD_OUT_SEEDS, SCENARIOS = 1, (7, 11, 12, 13, 14, 15), 200
"""Seed of the searches; seeds and number of the scenarios that score them."""

HEADINGS = [
    "seed",
    "tuned for",
    "mean MSE below the paper's",
    "no controller, more than",
    "within reach",
    "median",
    "chatter over the paper's",
    "largest tension (N)",
    "smallest (N)",
    "slack in",
]


def score(controllers: dict[str, Controller], ensemble: Ensemble, seed: int) -> list[list[str]]:
    """A row for each controller but the first, the paper's."""
    result = compare(controllers, ensemble, SCENARIOS, seed)
    names = list(controllers)
    return [_row(result, names[0], name) for name in names[1:]]


def _row(result: Comparison, paper: str, name: str) -> list[str]:
    theirs, ours = result.contenders[paper], result.contenders[name]
    before, after = theirs.summary(), ours.summary()
    least = float(result.least_mse.mean())
    mean = float(theirs.metrics["mse"].mean())
    within = result.mean_mse_within_reach(paper) / result.mean_mse_within_reach(name)
    return [
        str(result.seed),
        name,
        times(mean / float(ours.metrics["mse"].mean())),
        times(mean / least) if least else "–",
        times(within),
        times(before["median_mse"] / after["median_mse"]),  # pyright: ignore[reportOperatorIssue]
        f"{after['mean_chatter'] / before['mean_chatter']:.2f}",  # pyright: ignore[reportOperatorIssue]
        f"{after['max_tension']:.0f}",
        f"{after['min_tension']:.0f}",
        f"{after['slack_scenarios']} of {len(result)}",
    ]


def searched(minutes: int) -> Tuned:
    """A study of so many minutes, choice and score of the best included."""
    return tune(tuning_problem(ensemble="sea", seed=SEED), seconds=60.0 * minutes)


def table(studies: Sequence[Tuned]) -> str:
    """The held-out sets, each scored by every study, as a Markdown table."""
    controllers = {"paper": paper_controller()} | {
        f"{minutes} min": one.best.controller for minutes, one in zip(MINUTES, studies, strict=True)
    }
    ensemble = studies[0].problem.ensemble
    if ensemble is None:
        raise RuntimeError("the studies have no ensemble")
    plain = replace(ensemble, experiment=replace(ensemble.experiment, controller=paper_controller()))
    rows: list[list[str]] = []
    for seed in HELD_OUT_SEEDS:
        rows += score(controllers, plain, seed)
        sys.stderr.write(f"seed {seed} scored\n")
    trials = ", ".join(
        f"{len(one.trials)} trials, {one.progress.rollouts} rollouts in {minutes} min"
        for minutes, one in zip(MINUTES, studies, strict=True)
    )
    return f"{markdown(HEADINGS, rows)}\n\n*Search with seed {SEED}: {trials}.*"


def main() -> None:
    """Tune, score, and print, write or draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="figure: .svg, .png or .pdf")
    arguments = parser.parse_args()
    studies: list[Tuned] = []
    for minutes in MINUTES:
        sys.stderr.write(f"tuning for {minutes} min\n")
        studies.append(searched(minutes))
    text = table(studies)
    print(text)
    if arguments.write:
        put(arguments.write, "tuned", text)
    if arguments.plot:
        from simulation.plots import save
        from tuning.plots.search import front

        save(front(studies[-1].problem, studies[-1].trials), arguments.plot)


if __name__ == "__main__":
    main()
