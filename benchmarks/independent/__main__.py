"""Gains judged by a machine that shares no code and no draw with the product, around the exported C controller.

``python -m benchmarks.independent best.toml`` prints the table (six minutes on two cores); ``--write FILE`` puts it
between the file's two marks. A reference that asks for more force than the ropes may pull with is left out.
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import SupportsFloat

import numpy as np

import dualwinch
from benchmarks.document import markdown, put, times
from benchmarks.independent.judge import Conditions, Judge, Runs
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment

CONDITIONS = {
    "`rig`": Conditions(),
    "`rig`, no outages": Conditions(outage_length=0.0),
    "`sea`": Conditions(imperfect=0.0, outage_length=0.0),
    "`rig`, all imperfections doubled": Conditions(imperfect=2.0, outage_length=0.4),
    "`rig`, torques two samples later": Conditions(delay=3),
    "`rig`, silent for 0.5 s in 5 s": Conditions(outage_length=0.5, outage_period=5.0),
    "the same, silence said (NaN)": Conditions(outage_length=0.5, outage_period=5.0, missing=True),
}

HEADINGS = (
    "paper's gains / tuned",
    "mean square error (mm²)",
    "below",
    "largest error (mm)",
    "largest tension (N)",
    "smallest (N)",
    "chatter (N)",
    "lost, slack or refused",
    "left out",
)


def judged(title: str, paper: Runs, tuned: Runs, strength: float) -> list[str]:
    """A row of the table."""
    kept = tuned.needed < strength
    scored = kept & paper.completed & tuned.completed
    errors = [1e6 * float(np.mean(runs.mse[scored])) for runs in (paper, tuned)]

    def beside(of: Callable[[Runs], SupportsFloat], form: str) -> str:
        return " / ".join(format(float(of(runs)), form) for runs in (paper, tuned))

    return [
        title,
        " / ".join(f"{float(f'{error:.2g}'):g}" for error in errors),
        times(errors[0] / errors[1]),
        beside(lambda runs: 1e3 * runs.largest_error[scored].max(), ".2f"),
        beside(lambda runs: runs.peak_tension[kept].max(), ".0f"),
        beside(lambda runs: runs.min_tension[kept].min(), ".0f"),
        beside(lambda runs: np.mean(runs.chatter[scored]), ".1f"),
        beside(lambda runs: np.sum(kept & ~runs.clean), ".0f"),
        f"{np.sum(~kept)}",
    ]


def main(words: Sequence[str] | None = None) -> int:
    """Run the command line; 0 done, 1 where the gains cannot be judged."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.independent",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("gains", type=Path, help="what `dualwinch tune` found: best.toml")
    parser.add_argument("--runs", type=int, default=60, metavar="INT", help="machines for each row (default: 60)")
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    arguments = parser.parse_args(words)
    if arguments.runs < 1:
        parser.error(f"--runs {arguments.runs}: must be a whole number from 1")
    try:
        tuned = dualwinch.load(arguments.gains)
        with TemporaryDirectory() as folder:
            text = table(tuned, range(1, arguments.runs + 1), Path(folder))
    except (ConfigurationError, ValueError, RuntimeError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(text)
    if arguments.write:
        put(arguments.write, "independent", text)
    return 0


def table(tuned: Experiment, seeds: range, folder: Path) -> str:
    """All conditions, the tuned gains and the paper's, and how far single precision is from double."""
    judges: Mapping[str, Judge] = {
        "paper": Judge(Experiment(controller=paper_controller()), _new(folder / "paper")),
        "tuned": Judge(tuned, _new(folder / "tuned")),
        "float": Judge(tuned, _new(folder / "float"), "float"),
    }
    rows, single = [], 0.0
    for title, conditions in CONDITIONS.items():
        runs = {}
        for name in ("paper", "tuned") if rows else judges:
            sys.stderr.write(f"{title.replace('`', '')}: {name}\n")
            runs[name] = judges[name].run(conditions, seeds)
        single = single or float(np.mean(runs["float"].mse) / np.mean(runs["tuned"].mse))
        rows.append(judged(title, runs["paper"], runs["tuned"], tuned.controller.limits.strength))
    return (
        f"{markdown(HEADINGS, rows)}\n\n*{len(seeds)} machines in each row. In single precision, the tuned gains' mean "
        f"square error in `rig` is {single:.3f} times as large.*"
    )


def _new(folder: Path) -> Path:
    folder.mkdir()
    return folder


if __name__ == "__main__":
    sys.exit(main())
