"""One entry of a race: tuned, then scored where nobody has been; and the paper's gains beside it."""

from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import numpy as np

from dualwinch.simulation.analysis.least_error import least_mse
from dualwinch.simulation.batch.scenarios import experiment_of
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning import clock
from dualwinch.tuning.prepared import prepare
from dualwinch.tuning.problem import Problem
from dualwinch.tuning.progress import SILENT, Watch
from dualwinch.tuning.race.front import COSTS, ERROR, front
from dualwinch.tuning.race.operations import operations
from dualwinch.tuning.race.scored import Paper, Point, Scored, Search, runs_of
from dualwinch.tuning.race.terms import UNSEEN, Entrant, Terms
from dualwinch.tuning.scoring.evaluation import Evaluation
from dualwinch.tuning.scoring.held_out import HeldOut
from dualwinch.tuning.scoring.plan import FULL
from dualwinch.tuning.scoring.scorer import Scorer
from dualwinch.tuning.tune import tune

UNSEEN_PHASE = "scoring in unseen scenarios"
STRESS_PHASE = "finding what breaks it first"
PAPER_PHASE = "scoring the paper's gains"
LEAST_PHASE = "finding the least possible error"
"""Phases beside those of tuning."""

Breaking = Callable[[Experiment], tuple[dict[str, Any], ...]]
"""Tells what breaks the gains of an experiment first, the first first."""


def scored(
    entrant: Entrant,
    terms: Terms,
    *,
    breaking: Breaking | None = None,
    threads: int | None = None,
    watch: Watch = SILENT,
) -> Scored:
    """Tune an entry, and score its best and its fronts in the unseen scenarios.

    Raises:
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted; nothing of it is of use.
    """
    began, problem = clock.now(), entrant.problem
    tuned = tune(
        problem,
        method=terms.method,
        rollouts=terms.rollouts,
        held_out=min(terms.held_out, FULL.held_out),
        threads=threads,
        keep=False,
        watch=watch,
    )
    watch.phase(UNSEEN_PHASE)
    scorer = Scorer(tuned.prepared, threads=threads)
    unseen = HeldOut(scorer, terms.held_out, terms.seed + UNSEEN)
    best = unseen.score(tuned.verdict.best.candidate)
    fronts = {cost: front(tuned.trials, cost) for cost in COSTS}
    candidates = [trial.candidate for found in fronts.values() for trial in found]
    points = iter(scorer.over(candidates, unseen.scenarios, constraints=unseen.constraints))
    rescored = {cost: tuple(_point(problem, next(points), cost) for _ in found) for cost, found in fronts.items()}
    broken = None
    if breaking:
        watch.phase(STRESS_PHASE)
        broken = breaking(tuned.best)
    return Scored(
        entry=entrant.entry,
        runs=runs_of(best.result, 0, best.evaluation.violations, operations(tuned.best)),
        gains=tuned.gains,
        fronts=rescored,
        search=Search(
            trials=len(tuned.trials),
            rollouts=tuned.progress.spent,
            gains=len(problem.space.dimensions),
            seconds=clock.now() - began,
            improved=tuned.verdict.improved,
            version=version("dualwinch"),
        ),
        stress=broken,
    )


def _point(problem: Problem, evaluation: Evaluation, cost: str) -> Point:
    means, gains = evaluation.statistics, problem.space.settings(evaluation.point)
    return Point(means[f"mean.{cost}"], means[f"mean.{ERROR}"], kept=evaluation.feasible, gains=gains)


def paper(problem: Problem, terms: Terms, *, threads: int | None = None, watch: Watch = SILENT) -> Paper:
    """The paper's gains in the unseen scenarios, and the least error there.

    Args:
        problem: any of the race; ensemble, constraints and seed are those of all.
        terms: how many scenarios.
        threads: default: one a core.
        watch: told of what is done.

    Raises:
        DualwinchError: no compiler, no usable cache folder, or no optimum found.
        KeyboardInterrupt: interrupted.
    """
    scorer = Scorer(prepare(problem, threads, watch), threads=threads)
    watch.phase(PAPER_PHASE)
    unseen = HeldOut(scorer, terms.held_out, terms.seed + UNSEEN)
    found = unseen.paper
    runs = runs_of(found.result, 0, found.evaluation.violations, operations(problem.paper_experiment))
    watch.phase(LEAST_PHASE)
    with_paper = problem.drawn(terms.held_out, terms.seed + UNSEEN, problem.paper_experiment)
    experiments = [experiment_of(scenario) for scenario in with_paper]
    least = np.array([least_mse(experiment) for experiment in experiments])
    foreseeing = np.array(
        [least_mse(each, anticipating=True) if bound else 0.0 for each, bound in zip(experiments, least, strict=True)]
    )
    return Paper(runs, least, foreseeing)
