"""Preloads side by side."""

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.analysis.preload import Preloads, optimal_preload, preloads
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

SCHEDULED = override(case(4), {"controller.coordination.kind": "scheduled-preload"})


@pytest.fixture(scope="module")
def found() -> Preloads:
    return preloads(SCHEDULED)


def test_the_runs_are_those_of_the_experiment_with_other_preloads(found: Preloads) -> None:
    assert found.scheduled.metrics == simulate(SCHEDULED).metrics
    assert found.constant.metrics == simulate(case(4)).metrics


def test_their_figure_names_all_of_them(found: Preloads) -> None:
    (legend,) = found.plot().legends
    words = " ".join(text.get_text() for text in legend.get_texts())
    assert all(name in words for name in (*found.runs, "optimum"))


@pytest.mark.slow
def test_the_least_is_that_of_the_experiment(found: Preloads) -> None:
    assert found.optimum.continuous_load == pytest.approx(optimal_preload(SCHEDULED).continuous_load)


def test_the_best_constant_is_as_good_as_the_schedule_and_a_smaller_one_is_not(found: Preloads) -> None:
    assert found.best is not None
    preload = found.best.experiment.controller.limits.preload
    assert found.best.metrics.mse <= 1.01 * found.scheduled.metrics.mse
    assert found.best.metrics.min_tension >= found.scheduled.metrics.min_tension
    smaller = simulate(override(case(4), {"controller.coordination.preload": preload - 150}))
    assert smaller.metrics.min_tension < found.scheduled.metrics.min_tension
    assert smaller.metrics.continuous_load < found.best.metrics.continuous_load


def test_the_schedule_lies_between_the_best_constant_and_the_least(found: Preloads) -> None:
    assert found.best is not None
    constant, scheduled = (run.metrics.continuous_load for run in (found.best, found.scheduled))
    bound = found.optimum.continuous_load
    assert bound < scheduled < 0.75 * constant
    assert found.saved == pytest.approx((constant - scheduled) / (constant - bound))
    assert found.saved > 0.7


def test_where_the_schedule_is_lost_nothing_compares_with_it() -> None:
    found = preloads(override(SCHEDULED, {"controller.winch_1.kp": 10.0, "controller.winch_2.kp": 10.0}))
    assert found.scheduled.outcome != "completed"
    assert found.best is None
    assert np.isnan(found.saved)


def test_a_preload_that_is_not_scheduled_is_refused() -> None:
    with pytest.raises(ConfigurationError, match='"differential-tension": must be "scheduled-preload" here'):
        preloads(case(4))
