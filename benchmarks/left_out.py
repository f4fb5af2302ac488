"""What parts of the controller are worth in the sea: gains tuned without one after another, scored as all others are.

``python -m benchmarks.left_out`` prints the table (five minutes); ``--write FILE`` puts it between its two marks.
"""

import argparse
import sys
from pathlib import Path

from benchmarks.document import put
from benchmarks.scored import SEED, scored, searched
from dualwinch import tuning_problem
from dualwinch.controllers.controller import Controller
from dualwinch.tuning.problem import TuningProblem


def without(*gains: str, settings: tuple[str, ...] = ()) -> TuningProblem:
    """The default problem of the sea, some gains left as they are, which is 0, and with some settings."""
    space = tuning_problem(ensemble="sea").space.names
    return tuning_problem(
        ensemble="sea", seed=SEED, settings=settings, space=[name for name in space if name not in gains]
    )


RAMP, COMPENSATION = "controller.kalman.ramp", "controller.kalman.compensation"

LEFT_OUT = {
    "nothing": without,
    "`controller.kalman.ramp`": lambda: without(RAMP),
    "`controller.kalman.compensation`": lambda: without(COMPENSATION),
    "both": lambda: without(RAMP, COMPENSATION),
    "the ropes' calibration": lambda: without(settings=("controller.estimator=kalman",)),
}
"""What is left out → the problem without it."""


def main() -> None:
    """Tune, score, and print or write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    arguments = parser.parse_args()
    controllers: dict[str, Controller] = {}
    for name, problem in LEFT_OUT.items():
        sys.stderr.write(f"tuning without {name}\n")
        controllers[name] = searched(problem())
    text = scored(controllers).table("left out")
    print(text)
    if arguments.write:
        put(arguments.write, "left out", text)


if __name__ == "__main__":
    main()
