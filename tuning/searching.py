"""Searches of gains with one budget, and how their candidates are scored."""

from dualwinch.tuning.baseline import default_coordination, default_estimator
from dualwinch.tuning.optimisers import check_method
from dualwinch.tuning.options import TuningOptions, default_method
from dualwinch.tuning.scoring import clock
from dualwinch.tuning.scoring.progress import (
    CERTIFYING,
    DRAWING,
    NO_PROGRESS,
    REFERENCES,
    SCORING,
    SEARCHING,
    SearchStatus,
    TuningProgress,
)
from dualwinch.tuning.scoring.ranking import Evaluation, undominated
from dualwinch.tuning.scoring.scorer import Scorer
from dualwinch.tuning.scoring.test_set import TestSet
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.space import own_bounds
from dualwinch.tuning.tune import tune
from dualwinch.tuning.tuning_problem import (
    COORDINATION,
    ESTIMATOR,
    configuration,
    definition_of,
    tuning_problem,
)

__all__ = [
    "CERTIFYING",
    "COORDINATION",
    "DRAWING",
    "ESTIMATOR",
    "NO_PROGRESS",
    "REFERENCES",
    "SCORING",
    "SEARCHING",
    "Evaluation",
    "Scorer",
    "SearchStatus",
    "TestSet",
    "TuningOptions",
    "TuningProgress",
    "check_method",
    "clock",
    "configuration",
    "default_coordination",
    "default_estimator",
    "default_method",
    "definition_of",
    "own_bounds",
    "prepare",
    "tune",
    "tuning_problem",
    "undominated",
]
