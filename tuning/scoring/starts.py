"""The start of a search: of several, the one with the best gains in the training set."""

from dataclasses import replace

from dualwinch.analysis.design import designed
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.batch.workers import Workers
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.problem import DESIGN, DESIGNED, TuningProblem
from dualwinch.tuning.scoring.progress import DESIGNING, NO_PROGRESS, TuningProgress
from dualwinch.tuning.scoring.ranking import penalised_first
from dualwinch.tuning.scoring.scorer import Scorer
from dualwinch.tuning.scoring.training_set import TrainingSet, prepare


def prepare_best_start(
    problem: TuningProblem, workers: Workers = None, watch: TuningProgress = NO_PROGRESS
) -> TrainingSet:
    """`prepare` for the best of a problem's starts, by the exact penalty function; all are run in the same draws."""
    beginning, *alternatives = problem.beginnings
    prepared = [prepare(beginning, workers, watch), *(prepare(each, workers) for each in alternatives)]
    if len(prepared) == 1:
        return prepared[0]
    evaluations = [Scorer(training, workers).start() for training in prepared]
    return prepared[penalised_first(evaluations, problem.options.penalty)[0]]


def with_designed_start(problem: TuningProblem, watch: TuningProgress = NO_PROGRESS) -> TuningProblem:
    """The problem with the controller designed for the machine (`analysis.design`) as a start, unless it has none."""
    if problem.fixed is None:
        return problem
    watch.phase(DESIGNING)
    machine = problem.experiment if problem.ensemble is None else problem.drawn_ensemble
    # a light drum keeps its controller without damping: another structure would be compiled for the start alone
    keys = {*problem.fixed, *_zeros(problem.experiment)}
    seed, checks = problem.stream(DESIGN), problem.options.machines
    controller = designed(machine, kept=keys, seed=seed, checks=checks, compiled=True).controller
    if controller == problem.experiment.controller:
        return replace(problem, fixed=None, start_words=DESIGNED)
    return replace(problem, starts=(*problem.starts, controller), fixed=None, design=controller)


def _zeros(experiment: Experiment) -> set[str]:
    """Keys of damping and lead of the drums that are 0."""
    values = leaves(experiment)
    keys = (f"controller.winch_{winch}.{gain}" for winch in (1, 2) for gain in ("damping", "lead"))
    return {key for key in keys if values.get(key) == 0}
