"""What a search is worth by its rollouts, with stability margins and without, and how much seeds differ.

``python -m benchmarks.searches`` prints the table; ``--write FILE`` puts it between the file's two marks. For each seed
there is one search of the most rollouts; a shorter one is what it had found by then, chosen and scored likewise. Gains
do not depend on the machine or on what else it does.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.document import markdown, put, times
from dualwinch.tuning.constraints import ROBUST, ROBUST_AT_REST
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.selection import select
from dualwinch.tuning.tune import tune
from dualwinch.tuning.tuning_problem import tuning_problem


def problem_of(name: str, seed: int, *, margins: bool) -> TuningProblem:
    """The usual problem in an ensemble, or that without margins."""
    usual = tuning_problem(ensemble=name, seed=seed)
    kept = [each.text for each in usual.constraints if margins or each.text not in {*ROBUST, *ROBUST_AT_REST}]
    return tuning_problem(ensemble=name, seed=seed, constraints=["none", *kept])


def gains(problem: TuningProblem, lengths: Sequence[int]) -> list[float]:
    """How many times the mean MSE within authority is below the paper's, after so many rollouts each."""
    whole = tune(problem, rollouts=max(lengths))
    spent = np.cumsum([trial.scenarios for trial in whole.trials])
    shares = spent / spent[-1]
    found = []
    for length in lengths:
        trials = whole.trials[: max(1, int((shares <= length / max(lengths)).sum()))]
        verdict = select(Evaluator(whole.training), trials) if length < max(lengths) else whole.verdict
        found.append(verdict.improvement("mean.mse", feasible=True))
    return found


def table(names: Sequence[str], lengths: Sequence[int], seeds: int) -> str:
    """A row for each ensemble and length: geometric mean of the seeds, and the least and the most of them."""
    rows = []
    for name in names:
        by_margins = [
            np.array([gains(problem_of(name, seed, margins=margins), lengths) for seed in range(seeds)])
            for margins in (True, False)
        ]
        for column, length in enumerate(lengths):
            cells = []
            for found in by_margins:
                values = found[:, column]
                cells += [
                    times(float(np.exp(np.log(values).mean()))),
                    f"{times(values.min())} to {times(values.max())}",
                ]
            rows.append([f"`{name}`", str(length), *cells])
    headings = ["ensemble", "rollouts", "MSE below the paper's", "seeds", "without margins", "seeds"]
    return f"{markdown(headings, rows)}\n\n*Geometric mean of {seeds} seeds, least and most; within authority.*"


def main() -> None:
    """Search, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ensembles", nargs="+", default=["sea", "rig", "site"], metavar="NAME")
    parser.add_argument("--rollouts", nargs="+", type=int, default=[2000, 6000, 20_000], metavar="N")
    parser.add_argument("--seeds", type=int, default=6, metavar="N", help="seeds 0 to N - 1 (6)")
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    chosen = parser.parse_args()
    text = table(chosen.ensembles, chosen.rollouts, chosen.seeds)
    print(text)
    if chosen.write:
        put(chosen.write, "searches", text)


if __name__ == "__main__":
    main()
