"""Preloads side by side."""

import numpy as np
import pytest

from dualwinch.analysis.preload import Preloads, optimal_preload, preloads
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

SCHEDULED = override(case(4), {"controller.coordination.kind": "scheduled-preload"})
SHORT = {"simulation.duration": 1.0}


@pytest.fixture(scope="module")
def found() -> Preloads:
    return preloads(SCHEDULED)


def test_the_runs_are_those_of_the_experiment_with_other_preloads(found: Preloads) -> None:
    assert found.scheduled.metrics == simulate(SCHEDULED).metrics
    assert found.constant.metrics == simulate(case(4)).metrics


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


def test_no_constant_preload_is_better_than_one_that_the_schedule_never_leaves() -> None:
    """The force of Case 4 needs a sum of 5.6 kN: above that the schedule is a constant preload."""
    found = preloads(override(SCHEDULED, {"controller.coordination.preload": 7000.0}))
    assert dict(found.constant.metrics) == pytest.approx(dict(found.scheduled.metrics), rel=1e-9, abs=1e-12)
    assert found.best is not None
    assert found.best.experiment.controller.limits.preload == 7000.0
    assert found.saved == pytest.approx(0.0, abs=1e-9)


def test_the_best_constant_lies_at_the_edge_whatever_the_grid(found: Preloads, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dualwinch.analysis.preload.CONSTANTS", 41)
    other = preloads(SCHEDULED)
    assert found.best is not None
    assert other.best is not None
    first, second = (each.experiment.controller.limits.preload for each in (found.best, other.best))
    assert first == pytest.approx(second, abs=1.0)
    assert found.best.metrics.min_tension == pytest.approx(found.scheduled.metrics.min_tension, abs=0.1)


def test_another_coordination_is_run_as_configured() -> None:
    proportional = override(case(4), {"controller.coordination.kind": "proportional-tension"})
    found = preloads(SCHEDULED, configured=proportional)
    assert found.configured is not None
    assert found.configured.experiment == proportional
    assert found.configured.metrics == simulate(proportional).metrics
    assert list(found.runs) == ["as configured", "constant", "best constant", "scheduled"]
    (legend,) = found.plot().legends
    assert "as configured, 2000 N" in [text.get_text() for text in legend.get_texts()]


@pytest.mark.parametrize("configured", [case(4), SCHEDULED])
def test_what_is_configured_is_run_once(configured: Experiment) -> None:
    found = preloads(override(SCHEDULED, SHORT), configured=override(configured, SHORT))
    assert found.configured is None


def test_where_the_schedule_is_lost_nothing_compares_with_it() -> None:
    found = preloads(override(SCHEDULED, {"controller.winch_1.kp": 10.0, "controller.winch_2.kp": 10.0}))
    assert found.scheduled.outcome != "completed"
    assert found.best is None
    assert np.isnan(found.saved)
