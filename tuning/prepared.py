"""A problem made ready for evaluation: its scenarios drawn, the paper's gains and the start run, bounds as numbers."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dualwinch.simulation.analysis.worst_margins import MarginSurvey
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.constraint import Constraint
from dualwinch.tuning.problem import Problem
from dualwinch.tuning.progress import DRAWING, REFERENCES, SILENT, Watch
from dualwinch.tuning.scoring.machines import hardest_machines, survey
from dualwinch.tuning.scoring.runs import over, run_pairs
from dualwinch.tuning.scoring.scenarios import Pick, drawn, pick

STRESS = 48
"""Number of the further hard scenarios; the best candidates are tried in the hardest of them."""


@dataclass(frozen=True)
class Prepared:
    """A problem with all that evaluating a candidate takes.

    Attributes:
        problem: what is tuned.
        scenarios: what every candidate is tried in, the same for all: typical and hard ones of the ensemble, or the
            experiment.
        stress: further hard ones, where the best of the candidates have to hold; none without an ensemble.
        constraints: the problem's, every bound a number.
        paper: the paper's controller in `scenarios`, one row.
        start: the start in `scenarios`, one row.
        margins: the machines on which stability margins of every candidate are looked at; ``None``: none is bounded.
    """

    problem: Problem
    scenarios: tuple[Experiment | Scenario, ...]
    stress: tuple[Experiment | Scenario, ...]
    constraints: tuple[Constraint, ...]
    paper: BatchResult
    start: BatchResult
    margins: MarginSurvey | None = None


def prepare(problem: Problem, threads: int | None = None, watch: Watch = SILENT) -> Prepared:
    """Draw the scenarios of a problem, and run the paper's controller and the start in them.

    What the search will call is compiled by then.

    Args:
        problem: what is tuned.
        threads: default: one a core.
        watch: told of both phases.

    Raises:
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted.
    """
    watch.phase(DRAWING)
    picks, more = _picks(problem)
    scenarios = _drawn(problem, picks, problem.experiment)
    watch.phase(REFERENCES)
    paper = run_pairs([], [[]], _drawn(problem, picks, problem.paper_experiment), threads)
    start = run_pairs(problem.space.keys, [problem.space.parameters(problem.start)], scenarios, threads)
    stress = _drawn(problem, more, problem.experiment) if more else ()
    hardest = hardest_machines(problem, [*scenarios, *stress], threads)
    bounds = []
    for constraint in problem.constraints:
        reached = 0.0
        if isinstance(constraint.statistic, Statistic):
            reached = over(constraint.statistic, paper, 0, scenarios)
        elif constraint.of_paper:
            drawn = _drawn(problem, [*picks, *more], problem.paper_experiment)
            machines = [problem.paper_experiment, *(drawn[index] for index in hardest)]
            worst = MarginSurvey(machines if problem.ensemble else machines[:1], threads=threads).worst([[]])[0]
            reached = constraint.statistic.of(worst)
        bounds.append(constraint.given(reached))
    return Prepared(
        problem=problem,
        scenarios=scenarios,
        stress=stress,
        constraints=tuple(bounds),
        paper=paper,
        start=start,
        margins=survey(problem, [[*scenarios, *stress][index] for index in hardest], threads),
    )


def _picks(problem: Problem) -> tuple[list[Pick], list[Pick]]:
    """Which scenarios candidates are tuned in, and in which further ones the best of them."""
    if problem.ensemble is None:
        return [], []
    ensemble = replace(problem.ensemble, experiment=problem.experiment)
    return pick(ensemble, problem.scenarios, STRESS, problem.seed)


def _drawn(problem: Problem, picks: Sequence[Pick], experiment: Experiment) -> tuple[Experiment | Scenario, ...]:
    if problem.ensemble is None:
        return (experiment,)
    ensemble = replace(problem.ensemble, experiment=experiment)
    return tuple(drawn(picks, ensemble, problem.seed))
