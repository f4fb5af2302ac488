"""Searches of gains with one budget, and how their candidates are scored."""

from dualwinch.tuning.baseline import default_coordination, default_estimator
from dualwinch.tuning.optimisers import check_method, optimiser
from dualwinch.tuning.scoring import clock
from dualwinch.tuning.scoring.evaluation import Evaluator, Scorer
from dualwinch.tuning.scoring.progress import (
    CHOOSING,
    DRAWING,
    NO_PROGRESS,
    REFERENCES,
    SCORING,
    SEARCHING,
    SearchStatus,
    TuningProgress,
)
from dualwinch.tuning.scoring.ranking import Evaluation, undominated
from dualwinch.tuning.scoring.test_set import TestSet
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.selection_config import SCENARIOS, SampleSizes, default_method
from dualwinch.tuning.space import own_bounds
from dualwinch.tuning.storage.connection import is_database, shown
from dualwinch.tuning.storage.opening import join_store
from dualwinch.tuning.storage.parts import StudyName, recall
from dualwinch.tuning.study import search
from dualwinch.tuning.tune import tune
from dualwinch.tuning.tuning_problem import (
    COORDINATION,
    ESTIMATOR,
    configuration,
    definition_of,
    problem_from,
    tuning_problem,
)

__all__ = [
    "CHOOSING",
    "COORDINATION",
    "DRAWING",
    "ESTIMATOR",
    "NO_PROGRESS",
    "REFERENCES",
    "SCENARIOS",
    "SCORING",
    "SEARCHING",
    "Evaluation",
    "Evaluator",
    "SampleSizes",
    "Scorer",
    "SearchStatus",
    "StudyName",
    "TestSet",
    "TuningProgress",
    "check_method",
    "clock",
    "configuration",
    "default_coordination",
    "default_estimator",
    "default_method",
    "definition_of",
    "is_database",
    "join_store",
    "optimiser",
    "own_bounds",
    "prepare",
    "problem_from",
    "recall",
    "search",
    "shown",
    "tune",
    "tuning_problem",
    "undominated",
]
