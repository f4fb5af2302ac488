"""What a short and a long search are worth in the sea, in scenarios that nobody tuned on.

``python -m benchmarks.tuned`` prints the table (six minutes); ``--write FILE`` puts it between the file's two marks,
``--plot FILE`` draws the trade-offs that the longer search found.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.document import markdown, put
from benchmarks.scored import HEADINGS, ROLLOUTS, SEED, TEST_SEED, scored
from dualwinch import tuning_problem
from dualwinch.tuning.result import TuningResult
from dualwinch.tuning.tune import tune

LENGTHS = (ROLLOUTS, 5 * ROLLOUTS)
"""Rollouts of the searches."""

TEST_SEEDS = (TEST_SEED, 11, 12, 13, 14, 15)
"""Seeds of the scenarios that score them."""


def searched(rollouts: int) -> TuningResult:
    """A study whose search takes so many rollouts."""
    return tune(tuning_problem(ensemble="sea", seed=SEED), rollouts=rollouts)


def table(studies: Sequence[TuningResult]) -> str:
    """The test sets, each scored by every study, as a Markdown table."""
    controllers = {f"{length}": study.best.controller for length, study in zip(LENGTHS, studies, strict=True)}
    rows: list[list[str]] = []
    for seed in TEST_SEEDS:
        rows += [[str(seed), *row] for row in scored(controllers, seed).rows()]
        sys.stderr.write(f"seed {seed} scored\n")
    trials = " and ".join(str(len(study.trials)) for study in studies)
    found = markdown(["seed", "rollouts of the search", *HEADINGS], rows)
    return f"{found}\n\n*Searches with seed {SEED}: {trials} trials.*"


def main() -> None:
    """Tune, score, and print, write or draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="figure: .svg, .png or .pdf")
    arguments = parser.parse_args()
    studies: list[TuningResult] = []
    for length in LENGTHS:
        sys.stderr.write(f"tuning with {length} rollouts\n")
        studies.append(searched(length))
    text = table(studies)
    print(text)
    if arguments.write:
        put(arguments.write, "tuned", text)
    if arguments.plot:
        from dualwinch.simulation.plots.page import save
        from dualwinch.tuning.plots import front

        last = studies[-1]
        save(front(last.problem, last.training.constraints, last.trials), arguments.plot)


if __name__ == "__main__":
    main()
