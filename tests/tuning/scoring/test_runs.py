"""What runs come to: who counts in which statistic."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.ensembles.result import statistic_from
from dualwinch.tuning.constraints import constraints_from
from dualwinch.tuning.scoring.rollouts import counts, over, worst_of

SEA = load_ensemble("sea")
PLAIN = SEA.scenario(0, 3)
HARD = replace(PLAIN, hard=True)
BOUND = 5000.0
PEAK = constraints_from([f"worst.peak_tension<={BOUND:g}"], SEA.experiment)


def peaks(values: Sequence[float], outcomes: Sequence[str] = ()) -> BatchResult:
    """A row of runs with these peaks."""
    table = np.array([values])
    ended = np.array([list(outcomes) or ["completed"] * len(values)])
    return BatchResult(ended, np.zeros_like(table), {"peak_tension": table}, {})


def test_hard_scenarios_count_in_what_is_the_worst_alone() -> None:
    worst, mean = statistic_from("worst.peak_tension"), statistic_from("mean.peak_tension")
    scenarios = [PLAIN, HARD, SEA.experiment]
    assert [counts(worst, scenario) for scenario in scenarios] == [True, True, True]
    assert [counts(mean, scenario) for scenario in scenarios] == [True, False, True]
    result = peaks([1000.0, 2000.0])
    assert over(worst, result, 0, scenarios[:2]) == 2000
    assert over(mean, result, 0, scenarios[:2]) == 1000


def test_worst_is_the_largest_excess_of_bounds_on_what_is_worst_and_infinite_where_a_run_did_not_end() -> None:
    result = peaks([0.9 * BOUND, 1.1 * BOUND, np.nan], ["completed", "completed", "diverged"])
    assert worst_of(result, PEAK) == pytest.approx(np.array([[-0.1, 0.1, np.inf]]))
    assert worst_of(result, ()) == pytest.approx(np.array([[-np.inf, -np.inf, np.inf]]))
