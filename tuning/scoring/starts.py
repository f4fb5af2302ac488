"""The start of a search: of several, the one with the best gains in the training set."""

from dualwinch.simulation.batch.workers import Workers
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.progress import NO_PROGRESS, TuningProgress
from dualwinch.tuning.scoring.ranking import penalised_first
from dualwinch.tuning.scoring.scorer import Scorer
from dualwinch.tuning.scoring.training_set import TrainingSet, prepare


def prepare_best_start(
    problem: TuningProblem, workers: Workers = None, watch: TuningProgress = NO_PROGRESS
) -> TrainingSet:
    """`prepare` for the best of a problem's starts, by the exact penalty function; all are run in the same draws."""
    prepared = [prepare(each, workers, watch) for each in problem.beginnings]
    if len(prepared) == 1:
        return prepared[0]
    evaluations = [Scorer(training, workers).start() for training in prepared]
    return prepared[penalised_first(evaluations, problem.options.penalty)[0]]
