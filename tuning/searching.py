"""Searches of gains with one budget, and how their candidates are scored."""

# ruff: noqa: F401

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
