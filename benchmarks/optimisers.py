"""Optimisers at equal rollouts, with the same cuts and certificate: what each seed's gains are worth in fresh draws.

``python -m benchmarks.optimisers`` prints the table; ``--write FILE`` puts it between the file's two marks. All gains
are scored in the same fresh draws and on the same fresh machines, which no search has seen. Gains do not depend on the
computer or on what else it does.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.document import markdown, put, times
from dualwinch.analysis.margin_survey import MarginSurvey
from dualwinch.tuning.constraints import MarginStatistic
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.result import TuningResult
from dualwinch.tuning.scoring.rollouts import run_pairs, worst_of
from dualwinch.tuning.scoring.scorer import Scorer
from dualwinch.tuning.scoring.training_set import controlled_as
from dualwinch.tuning.tune import tune
from dualwinch.tuning.tuning_problem import tuning_problem

FRESH_SEED = 987_654_321
"""Seed of the draws and machines that score."""

HEADINGS = (
    "seed",
    "optimiser",
    "best",
    "median MSE below the paper's",
    "draws with a violation",
    "stated",
    "machines below a margin",
    "rollouts",
)


class FreshSet:
    """Fresh draws of an ensemble with the paper's errors in them."""

    def __init__(self, problem: TuningProblem, draws: int, machines: int) -> None:
        self.draws = problem.drawn_ensemble.chosen(range(draws), FRESH_SEED)
        self.machines = machines
        experiment = problem.paper_experiment
        runs = run_pairs([], [[]], controlled_as(experiment, self.draws))
        self.paper = runs.metrics["mse"][0]

    def row(self, tuned: TuningResult) -> tuple[list[str], float]:
        """The cells of a result, and its median MSE below the paper's."""
        problem, best = tuned.problem, tuned.verdict.best
        scorer = Scorer(tuned.training)
        draws = controlled_as(problem.experiment, self.draws)
        runs = scorer.run([best.candidate], draws)
        ours = runs.metrics["mse"][0]
        violations = int((worst_of(runs, tuned.training.constraints) > 0).sum())
        median = float(np.nanmedian(self.paper) / np.nanmedian(ours))
        survey = MarginSurvey(draws[: self.machines], problem.space.keys, amplitudes=problem.margin_amplitudes)
        (margins,) = survey.each([problem.space.parameters(best.point)], [each.margin for each in problem.margins])
        below = sum(
            any(
                bound.violation(bound.statistic.of(of)) > 0
                for bound in tuned.training.constraints
                if isinstance(bound.statistic, MarginStatistic)
            )
            for of in margins
        )
        certificate = tuned.verdict.certificate
        stated = f"≤ {100 * certificate.supported:.2g} %" if certificate else "–"
        certified = "" if certificate and certificate.satisfied else ", not certified"
        return [
            "the start" if not tuned.verdict.improved else f"trial {best.number}{certified}",
            times(median),
            f"{violations} of {len(draws)}",
            stated,
            f"{below} of {self.machines}",
            str(tuned.cost.rollouts),
        ], median


def table(ensemble: str, methods: Sequence[str], seeds: Sequence[int], rollouts: int, draws: int) -> str:
    """A row for each seed and optimiser; below, the ratio of the largest to the smallest median of each optimiser."""
    fresh, rows, medians = None, [], {method: list[float]() for method in methods}
    for seed in seeds:
        for method in methods:
            problem = tuning_problem(ensemble=ensemble, seed=seed)
            fresh = fresh or FreshSet(problem, draws, problem.options.machines)
            tuned = tune(problem, method=method, rollouts=rollouts, test_scenarios=8)
            cells, median = fresh.row(tuned)
            rows.append([str(seed), method, *cells])
            medians[method].append(median)
            sys.stderr.write(f"{ensemble} {' | '.join(rows[-1])}\n")
            sys.stderr.flush()
    spread = "; ".join(
        f"{method}: geometric mean of the medians {times(float(np.exp(np.log(values).mean())))}, "
        f"largest over smallest {max(values) / min(values):.2f}"
        for method, values in medians.items()
        if len(values) > 1
    )
    columns = [index for index, name in enumerate(HEADINGS) if len(methods) > 1 or name != "optimiser"]
    shown = [[row[index] for index in columns] for row in (HEADINGS, *rows)]
    return f"{markdown(shown[0], shown[1:])}\n\n*`{ensemble}`, {rollouts} rollouts{spread and f'; {spread}'}.*"


def main() -> None:
    """Search, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ensemble", default="rig", metavar="NAME")
    parser.add_argument("--methods", nargs="+", default=["cmaes"], metavar="NAME")
    parser.add_argument("--seeds", nargs="+", type=int, default=[*range(6)], metavar="N")
    parser.add_argument("--rollouts", type=int, default=12000, metavar="N")
    parser.add_argument("--draws", type=int, default=1500, metavar="N", help="fresh draws that score (1500)")
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    chosen = parser.parse_args()
    text = table(chosen.ensemble, chosen.methods, chosen.seeds, chosen.rollouts, chosen.draws)
    print(text)
    if chosen.write:
        put(chosen.write, f"optimisers {chosen.ensemble}", text)


if __name__ == "__main__":
    main()
