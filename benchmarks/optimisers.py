"""Optimisers and objectives at equal budgets, with the same cuts and certificate: what each seed's gains are worth.

``python -m benchmarks.optimisers`` prints the table; ``--write FILE`` puts it between the file's two marks. All gains
are scored in the same fresh draws and on the same fresh machines, which no search has seen. With a budget of rollouts,
gains do not depend on the computer or on what else it does; with one of time (``--time 60``) they do.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from benchmarks.document import markdown, put, times
from dualwinch.analysis.margin_survey import MarginSurvey
from dualwinch.simulation.batch.authority import force_demands
from dualwinch.tuning.constraints import DEFAULT_OBJECTIVES, MarginStatistic
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.result import TuningResult
from dualwinch.tuning.scoring.rollouts import run_pairs, worst_of
from dualwinch.tuning.scoring.scorer import Scorer
from dualwinch.tuning.scoring.training_set import controlled_as, with_authority
from dualwinch.tuning.tune import tune
from dualwinch.tuning.tuning_problem import tuning_problem

FRESH_SEED = 987_654_321
"""Seed of the draws and machines that score."""

HEADINGS = (
    "seed",
    "optimiser",
    "objective",
    "best",
    "median MSE below the paper's",
    "geometric mean",
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
        self.within = with_authority(force_demands(self.draws), problem.options.authority)

    def row(self, tuned: TuningResult) -> tuple[list[str], float]:
        """The cells of a result, and its median MSE below the paper's."""
        problem, best = tuned.problem, tuned.verdict.best
        scorer = Scorer(tuned.training)
        draws = controlled_as(problem.experiment, self.draws)
        runs = scorer.run([best.candidate], draws)
        ours = runs.metrics["mse"][0]
        violations = int((worst_of(runs, tuned.training.constraints) > 0).sum())
        median = float(np.nanmedian(self.paper) / np.nanmedian(ours))
        geometric_mean = float(np.exp(np.nanmean(np.log(self.paper / ours)[self.within])))
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
            times(geometric_mean),
            f"{violations} of {len(draws)}",
            stated,
            f"{below} of {self.machines}",
            str(tuned.cost.rollouts),
        ], median


@dataclass(frozen=True)
class Race:
    """Searches of an ensemble with one budget.

    Attributes:
        ensemble: its name.
        methods: names of the optimisers.
        objectives: statistics that are minimised, each by itself.
        seeds: of the searches.
        rollouts: of each search; ``None``: limited by time.
        seconds: of each search; ``None``: limited by rollouts.
        settings: as of the command ``tune``.
    """

    ensemble: str
    methods: Sequence[str]
    objectives: Sequence[str]
    seeds: Sequence[int]
    rollouts: int | None
    seconds: float | None
    settings: Sequence[str] = ()

    def table(self, draws: int) -> str:
        """A row for each seed, optimiser and objective; below, for each of these the spread of the medians."""
        fresh, rows, medians = None, [], dict[tuple[str, str], list[float]]()
        for seed, method, objective in product(self.seeds, self.methods, self.objectives):
            problem = tuning_problem(ensemble=self.ensemble, seed=seed, objectives=[objective], settings=self.settings)
            fresh = fresh or FreshSet(problem, draws, problem.options.machines)
            tuned = tune(problem, method=method, rollouts=self.rollouts, seconds=self.seconds, test_scenarios=8)
            cells, median = fresh.row(tuned)
            rows.append([str(seed), method, objective, *cells])
            medians.setdefault((method, objective), []).append(median)
            sys.stderr.write(f"{self.ensemble} {' | '.join(rows[-1])}\n")
            sys.stderr.flush()
        numbers = {"optimiser": len(self.methods), "objective": len(self.objectives)}
        columns = [index for index, name in enumerate(HEADINGS) if numbers.get(name, 2) > 1]
        headings, *shown = ([row[index] for index in columns] for row in (HEADINGS, *rows))
        budget = f"{self.rollouts} rollouts" if self.seconds is None else f"{self.seconds:g} s"
        words = [f"`{self.ensemble}`, {budget}", *(_spread(names, values) for names, values in medians.items())]
        return f"{markdown(headings, shown)}\n\n*{'; '.join(filter(None, words))}.*"


def _spread(names: Sequence[str], medians: Sequence[float]) -> str:
    """Geometric mean and spread of several medians, in words."""
    if len(medians) < 2:
        return ""
    mean, spread = float(np.exp(np.log(medians).mean())), max(medians) / min(medians)
    words = f"geometric mean of the medians {times(mean)}, largest over smallest {spread:.2f}"
    return f"{', '.join(names)}: {words}"


def main() -> None:
    """Search, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ensemble", default="rig", metavar="NAME")
    parser.add_argument("--methods", nargs="+", default=["cmaes"], metavar="NAME")
    parser.add_argument("--objectives", nargs="+", default=[*DEFAULT_OBJECTIVES], metavar="STATISTIC")
    parser.add_argument("--set", nargs="+", default=[], metavar="KEY=VALUE", help="as of the command tune")
    parser.add_argument("--seeds", nargs="+", type=int, default=[*range(6)], metavar="N")
    parser.add_argument("--rollouts", type=int, default=12000, metavar="N", help="of each search (12000)")
    parser.add_argument("--time", type=float, metavar="S", help="of each search, in place of rollouts")
    parser.add_argument("--draws", type=int, default=1500, metavar="N", help="fresh draws that score (1500)")
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    chosen = parser.parse_args()
    rollouts = None if chosen.time else chosen.rollouts
    race = Race(chosen.ensemble, chosen.methods, chosen.objectives, chosen.seeds, rollouts, chosen.time, chosen.set)
    text = race.table(chosen.draws)
    print(text)
    if chosen.write:
        put(chosen.write, f"optimisers {chosen.ensemble}{' time' if chosen.time else ''}", text)


if __name__ == "__main__":
    main()
