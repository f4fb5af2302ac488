"""What less chatter costs in tracking: gains tuned for several bounds on chatter, in scenarios that nobody tuned on.

``python -m benchmarks.traded`` prints the table (six minutes); ``--write FILE`` puts it between the file's two marks,
``--plot FILE`` draws it.
"""

import argparse
import sys
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.document import put
from benchmarks.scored import ROLLOUTS, SCENARIOS, SEED, TEST_SEED, Score, scored, searched
from dualwinch import tuning_problem
from dualwinch.controllers.controller import Controller
from dualwinch.simulation.plots.page import new_page, save
from dualwinch.simulation.plots.style import BLUE, GREY, VERMILION
from dualwinch.tuning.constraints import NO_PEAK, NO_SLACK

ALLOWED = (0.05, 0.1, 0.15, 0.25, 0.4)
"""Bounds on the mean chatter, over that of the paper's gains."""


def front(score: Score) -> Figure:
    """Mean square error against chatter."""
    paper, ours = score.paper, sorted(score.tuned, key=lambda each: each.chatter)
    words = f"{SCENARIOS} test scenarios of 'sea' (seed {TEST_SEED}), searches of {ROLLOUTS} rollouts"
    with new_page(None, 3.8, "What less chatter costs", words) as page:
        (axes,) = page.panels()
        for key, label, colour in (("mse", "all scenarios", VERMILION), ("within_authority", "within authority", BLUE)):
            values = [getattr(score, key) for score in ours]
            axes.plot([score.chatter for score in ours], values, color=colour, marker="o", ms=4, label=label)
            axes.plot(paper.chatter, getattr(paper, key), color=colour, marker="x", markersize=6)
        axes.axhline(score.least, color=VERMILION, linestyle=(0, (4, 2)), label="all: no controller has less")
        axes.axvline(0.25 * paper.chatter, color=GREY, linestyle=(0, (1, 1.5)), label="paper's chatter / 4")
        axes.annotate("paper's gains", (paper.chatter, paper.mse), (-6, -12), textcoords="offset points", ha="right")
        axes.set(xlabel="mean chatter (N)", ylabel="mean MSE (m²)", yscale="log")
        page.legend()
    return page.figure


def main() -> None:
    """Tune, score, and print, write or draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="figure: .svg, .png or .pdf")
    arguments = parser.parse_args()
    controllers: dict[str, Controller] = {}
    for allowed in ALLOWED:
        sys.stderr.write(f"tuning for a chatter of at most {allowed:g} of the paper's\n")
        limits = [NO_SLACK, NO_PEAK, f"mean.chatter<={allowed}*paper"]
        controllers[f"{allowed:g}"] = searched(tuning_problem(ensemble="sea", seed=SEED, constraints=limits))
    score = scored(controllers)
    text = score.table("chatter allowed, over the paper's")
    print(text)
    if arguments.write:
        put(arguments.write, "traded", text)
    if arguments.plot:
        save(front(score), arguments.plot)


if __name__ == "__main__":
    main()
