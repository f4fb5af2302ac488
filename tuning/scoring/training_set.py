"""The training set of a tuning problem: a sample average with common random numbers.

Every candidate is run in the same random draws (Shapiro, Dentcheva and Ruszczyński, Lectures on Stochastic Programming,
2009, Chapter 5). The first cuts are hard draws: importance sampling by the force that a draw demands of the motors
(`simulation.batch.authority`). If force is nearly short, the vehicle falls behind and must recover without a peak or a
slack rope. Stability margins are those of the nominal machine and of the first two drawn ones.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis.margin_survey import MarginSurvey
from dualwinch.simulation.batch.authority import ForceDemand, force_demands
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.batch.workers import Workers, map_all, threads_of
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.results.outcomes import RunOutcomes
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.problem import TRAINING, TuningProblem
from dualwinch.tuning.scoring.progress import DRAWING, NO_PROGRESS, REFERENCES, TuningProgress
from dualwinch.tuning.scoring.rollouts import over, run_pairs

AnyScenario = TypeVar("AnyScenario", bound=Experiment | Scenario)

LARGEST_LAG = 0.01
"""Distance in m by which the vehicle may fall behind in a cut for lack of force: beyond, no gains keep the bounds."""

TRAINING_MACHINES = 2
"""Drawn machines on which margins are computed in training, besides the nominal one and those of the cuts."""


def beyond_authority_as_hard(scenarios: Sequence[AnyScenario], within: NDArray[np.bool_]) -> list[AnyScenario]:
    """The scenarios, those beyond the motors' authority as hard ones, which count in the worst case only.

    There the vehicle falls behind; the lag is most of the error and hardly depends on gains. If all scenarios are
    beyond it, none is marked, and an experiment without draws never is. `within` is (scenarios,).
    """
    return [
        replace(scenario, hard=True) if isinstance(scenario, Scenario) and not inside else scenario
        for scenario, inside in zip(scenarios, within | ~within.any(), strict=True)
    ]


def with_authority(demands: Sequence[ForceDemand], authority: float) -> NDArray[np.bool_]:
    """(n,) whether each draw demands less than a share of the motors' force."""
    return np.array([demand.share < authority for demand in demands], bool)


def training_scenarios(problem: TuningProblem) -> tuple[list[Scenario], list[Scenario]]:
    """The random draws, those beyond the motors' authority marked, and the hard draws."""
    options, ensemble, count = problem.options, problem.drawn_ensemble, problem.scenarios
    draws = ensemble.chosen(range(max(options.population, count + options.hard)), problem.stream(TRAINING))
    demands = force_demands(draws)
    random = beyond_authority_as_hard(draws[:count], with_authority(demands[:count], options.authority))
    order = sorted(
        range(count, len(draws)), key=lambda index: (demands[index].shortfall > LARGEST_LAG, -demands[index].share)
    )
    return random, [replace(draws[index], hard=True) for index in order[: options.hard]]


def survey(
    problem: TuningProblem,
    scenarios: Sequence[Experiment | Scenario],
    workers: Workers = None,
    experiment: Experiment | None = None,
) -> MarginSurvey | None:
    """Survey of the nominal machine and those of drawn scenarios; ``None`` if no margin is bounded.

    An `experiment` has another controller in place of the problem's, with fixed gains.
    """
    if not problem.margins:
        return None
    machines = [experiment or problem.experiment, *(each for each in scenarios if isinstance(each, Scenario))]
    keys = () if experiment else problem.space.keys
    return MarginSurvey(machines, keys, threads_of(workers), amplitudes=problem.margin_amplitudes)


def bounds_in(
    constraints: Sequence[Constraint],
    problem: TuningProblem,
    runs: Mapping[str, RunOutcomes],
    scenarios: Sequence[Experiment | Scenario],
) -> tuple[Constraint, ...]:
    """The constraints of a problem in scenarios, with factors applied to statistics of the reference there.

    `runs` are those of each reference, ``paper`` and ``start``, in the scenarios, one row. Bounds that have no
    reference among them, and those on margins, are as in `constraints`.
    """
    return tuple(
        constraint.given(over(constraint.statistic, runs[constraint.reference], 0, scenarios))
        if constraint.reference in runs and isinstance(constraint.statistic, Statistic)
        else bound
        for constraint, bound in zip(problem.constraints, constraints, strict=True)
    )


@dataclass(frozen=True)
class TrainingSet:
    """A tuning problem with its training scenarios.

    Attributes:
        problem: the tuning problem.
        scenarios: in which every candidate is run: random draws of the ensemble, or the experiment.
        hard: hard draws, the first cuts; none without an ensemble.
        constraints: the problem's, with bounds as numbers.
        paper: runs of the baseline controller in `scenarios`, one row.
        start: runs of the start in `scenarios` and `hard`, one row.
        margins: survey of the machines of the training set; ``None``: no margin is bounded.
        workers: for other computations in the scenarios.
    """

    problem: TuningProblem
    scenarios: tuple[Experiment | Scenario, ...]
    hard: tuple[Scenario, ...]
    constraints: tuple[Constraint, ...]
    paper: BatchResult
    start: BatchResult
    margins: MarginSurvey | None = None
    workers: Workers = None


def prepare(
    problem: TuningProblem,
    workers: Workers = None,
    watch: TuningProgress = NO_PROGRESS,
) -> TrainingSet:
    """Draw the training scenarios of a problem, and run the baseline controller and the start in them.

    This also compiles the rollouts and the margins of a search, in parallel. `watch` gets both phases.
    """
    watch.phase(DRAWING)
    scenarios: Sequence[Experiment | Scenario] = [problem.experiment]
    hard: Sequence[Scenario] = []
    if problem.ensemble is not None:
        scenarios, hard = training_scenarios(problem)
    watch.phase(REFERENCES)
    runs = [*scenarios, *hard]
    run_paper = partial(run_pairs, [], [[]], controlled_as(problem.paper_experiment, scenarios), workers)
    run_start = partial(run_pairs, problem.space.keys, [problem.space.parameters(problem.start)], runs, workers)
    compiling: list[Callable[[], Any]] = []
    if problem.bounds_loop_margins:
        threads, amplitudes = threads_of(workers), problem.margin_amplitudes
        compiling.append(MarginSurvey([problem.experiment], threads=threads, amplitudes=amplitudes).compile)
    start, *_, paper = map_all(lambda call: call(), [run_start, *compiling, run_paper], threads_of(workers))
    return TrainingSet(
        problem=problem,
        scenarios=tuple(scenarios),
        hard=tuple(hard),
        constraints=_numbers(problem, scenarios, paper, start.take(range(len(scenarios))), workers),
        paper=paper,
        start=start,
        margins=survey(problem, scenarios[:TRAINING_MACHINES], workers),
        workers=workers,
    )


def _numbers(
    problem: TuningProblem,
    scenarios: Sequence[Experiment | Scenario],
    paper: RunOutcomes,
    start: RunOutcomes,
    workers: Workers,
) -> tuple[Constraint, ...]:
    """The constraints of a problem with bounds as numbers in the training set."""
    bounds = bounds_in(problem.constraints, problem, {"paper": paper, "start": start}, scenarios)
    machines = controlled_as(problem.paper_experiment, scenarios[:TRAINING_MACHINES])
    margins: dict[str, Any] = {}
    for reference, experiment, is_drawn in (
        ("paper", problem.paper_experiment, machines),
        ("start", problem.experiment, scenarios[:TRAINING_MACHINES]),
    ):
        if any(bound.reference == reference for bound in bounds):
            surveyed = survey(problem, is_drawn, workers, experiment)
            margins[reference] = surveyed.worst([[]])[0] if surveyed else {}
    return tuple(
        bound.given(bound.statistic.of(margins[bound.reference]))
        if bound.reference and not isinstance(bound.statistic, Statistic)
        else bound
        for bound in bounds
    )


def controlled_as(experiment: Experiment, scenarios: Sequence[Experiment | Scenario]) -> list[Experiment | Scenario]:
    """The scenarios with the controller of an experiment; those with the same base still share one."""
    machines = {id(each.base): each.base for each in scenarios if isinstance(each, Scenario)}
    bases = {key: replace(machine, controller=experiment.controller) for key, machine in machines.items()}
    return [
        replace(each, base=bases[id(each.base)]) if isinstance(each, Scenario) else experiment for each in scenarios
    ]
