"""What runs come to: who counts in which statistic, and how far bounds may be exceeded where."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.ensembles.result import statistic_from
from dualwinch.tuning.constraints import constraints_from
from dualwinch.tuning.scoring.rollouts import beyond_authority_of, counts, over, worst_of
from dualwinch.tuning.selection_config import SelectionConfig

LEEWAY = SelectionConfig.leeway_beyond_authority
SEA = load_ensemble("sea")
PLAIN = SEA.scenario(0, 3)
HARD = replace(PLAIN, hard=True)
OVERWHELMING = replace(PLAIN, hard=True, beyond_authority=True)
BOUND = 5000.0
PEAK = constraints_from([f"worst.peak_tension<={BOUND:g}"], SEA.experiment)


def peaks(values: Sequence[float], outcomes: Sequence[str] = ()) -> BatchResult:
    """A row of runs with these peaks."""
    table = np.array([values])
    ended = np.array([list(outcomes) or ["completed"] * len(values)])
    return BatchResult(ended, np.zeros_like(table), {"peak_tension": table}, {})


def test_hard_scenarios_count_in_what_is_the_worst_and_overwhelming_ones_in_nothing() -> None:
    worst, mean = statistic_from("worst.peak_tension"), statistic_from("mean.peak_tension")
    scenarios = [PLAIN, HARD, OVERWHELMING, SEA.experiment]
    assert [counts(worst, scenario) for scenario in scenarios] == [True, True, False, True]
    assert [counts(mean, scenario) for scenario in scenarios] == [True, False, False, True]
    result = peaks([1000.0, 2000.0, 9000.0])
    assert over(worst, result, 0, scenarios[:3]) == 2000
    assert over(mean, result, 0, scenarios[:3]) == 1000


def test_worst_is_the_largest_excess_of_bounds_on_what_is_worst_and_infinite_where_a_run_did_not_end() -> None:
    result = peaks([0.9 * BOUND, 1.1 * BOUND, np.nan], ["completed", "completed", "diverged"])
    plain = [PLAIN] * 3
    assert worst_of(result, PEAK, plain) == pytest.approx(np.array([[-0.1, 0.1, np.inf]]))
    assert worst_of(result, (), plain) == pytest.approx(np.array([[-np.inf, -np.inf, np.inf]]))


def test_overwhelming_scenarios_may_exceed_bounds_by_a_little_and_have_to_end() -> None:
    scenarios = [HARD, OVERWHELMING, OVERWHELMING, OVERWHELMING]
    assert beyond_authority_of(scenarios).tolist() == [False, True, True, True]
    result = peaks(
        [1.04 * BOUND, 1.04 * BOUND, 1.06 * BOUND, 0.5 * BOUND], ["completed", "completed", "completed", "diverged"]
    )
    expected = np.array([[0.04, 0.04 - LEEWAY, 0.06 - LEEWAY, np.inf]])
    assert worst_of(result, PEAK, scenarios) == pytest.approx(expected)
    assert expected[0, 1] < 0 < expected[0, 2]
