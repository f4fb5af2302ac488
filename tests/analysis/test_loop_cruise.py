"""Steady motion of the closed loop: with every law, estimator and coordination, and held by runs from there."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from dualwinch.analysis.linear_loop import linear_closed_loop, linear_open_loop
from dualwinch.analysis.margins import margins
from dualwinch.analysis.operating_points import LoopOperatingPoint, loop_operating_point
from dualwinch.config.experiment_file import load
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.model.quantities.quantity import Mark
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from tests.tiers import each_choice, mostly_slow

X = 25.0
SEARCHED = Path(__file__).parents[2] / "benchmarks/independent/searched.toml"


def error_after(cruise: LoopOperatingPoint, v: float, samples: int) -> float:
    """Tracking error in m after some samples from the cruise, the reference going on at its speed."""
    state, outside = cruise.state.copy(), cruise.exogenous.copy()
    reference = cruise.loop.exogenous.index("reference.x")
    row = np.zeros(0)
    for _ in range(samples):
        following, row, _ = (np.array(value).ravel() for value in cruise.loop.step(state, outside, cruise.parameters))
        state = following
        outside[reference] += v * cruise.experiment.simulation.sample_time
    return row[cruise.loop.columns.index("e")]


SPEEDS = (0.0, 0.5, -1.2)
LEARNING = [name for name in ESTIMATORS if "calibrating" in name]
"""Costly estimators, which a quick test below has for one law."""


@pytest.mark.parametrize(
    ("law", "estimator", "v"),
    [
        *each_choice(POSITION_LAWS, [name for name in ESTIMATORS if name not in LEARNING], SPEEDS),
        *mostly_slow(product(POSITION_LAWS, LEARNING, SPEEDS), lambda _: False),
    ],
)
def test_there_is_no_error_where_the_nominal_model_is_right(law: str, estimator: str, v: float) -> None:
    """The cascade's speed is that of its position error: it stays behind by v/kp1 until its integral has filled."""
    experiment = override(case(4), {"controller.kind": law, "controller.estimator": estimator})
    cruise = loop_operating_point(experiment, X, v)
    assert cruise.row["e"] == pytest.approx(0, abs=3e-6)
    positions = cruise.state[cruise.loop.marked(Mark.POSITION)]
    assert positions == pytest.approx(X, abs=1e-4)
    assert cruise.row["u_sat"] == pytest.approx(cruise.row["F1"] - cruise.row["F2"], abs=1e-3)
    assert error_after(cruise, v, 200) == pytest.approx(cruise.row["e"], abs=1e-6)


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_every_coordination_rests(coordination: str) -> None:
    cruise = loop_operating_point(override(case(4), {"controller.coordination.kind": coordination}), X, 0.0)
    assert error_after(cruise, 0.0, 200) == pytest.approx(cruise.row["e"], abs=1e-6)


@pytest.mark.parametrize("estimator", ["kalman", "calibrating-kalman"])
@pytest.mark.parametrize("ramp", [0.0, 0.3])
def test_a_slow_integral_is_where_it_rests(estimator: str, ramp: float) -> None:
    """A disturbance that the filter follows slowly hardly changes in a sample, wherever it is."""
    gains = {"controller.kalman.ramp": ramp, "controller.kalman.compensation": 0.7, "controller.kalman.bandwidth": 2.0}
    wrong = {"controller.nominal.mass": 1.2e4, "controller.nominal.drag_coefficient": 0.4}
    experiment = override(case(4), {"controller.estimator": estimator} | gains | wrong)
    cruise = loop_operating_point(experiment, X, 1.5)
    assert abs(cruise.row["e"]) < 1e-3
    assert error_after(cruise, 1.5, 2000) == pytest.approx(cruise.row["e"], abs=1e-5)


def test_margins_with_the_calibrating_filter_are_those_of_a_run() -> None:
    """Gain that the loop bears in the nonlinear closed loop: 3.25 (see docs/stability.md for how that is found)."""
    plain, learning = (
        margins(linear_open_loop(override(case(4), {"controller.estimator": kind}), X, 0.5))
        for kind in ("kalman", "calibrating-kalman")
    )
    assert learning.stable
    assert learning.gain == pytest.approx(3.25, abs=0.01)
    assert learning.gain == pytest.approx(plain.gain, rel=1e-3)


@pytest.mark.parametrize(("x", "v"), [(0.1, 0.5), (25.0, 0.0), (25.0, -1.2), (49.9, 0.5), (49.9, -1.2)])
def test_what_is_left_is_rounding(x: float, v: float) -> None:
    """Between samples nothing changes by more than 1e-7, but for a short rope's rounding: 5 MN/m times 1e-14 m."""
    point = loop_operating_point(case(4), x, v)
    assert point.residual < (1e-7 if x < 49 else 1e-6)
    assert error_after(point, v, 200) == pytest.approx(point.row["e"], abs=1e-9)


@pytest.mark.slow
def test_at_speed_a_filter_that_learns_and_heavy_ropes_come_to_steady_motion() -> None:
    """From where full Newton steps go to and fro across the law's boundary layer for ever."""
    point = loop_operating_point(load(SEARCHED), X, 1.5)
    assert point.row["u"] == pytest.approx(2610, rel=1e-3)
    assert point.residual < 1e-7
    assert error_after(point, 1.5, 200) == pytest.approx(point.row["e"], abs=1e-6)


@pytest.mark.parametrize("x", [40.0, 46.8])
def test_at_rest_the_wheels_scale_is_nominal(x: float) -> None:
    """Nothing but the rounding of positions moves it there: Newton's method must not take that for a slope."""
    point = loop_operating_point(load(SEARCHED), x, 0.0)
    assert point.state[point.loop.states.index("controller.estimator.wheel.error")] == 0
    assert np.abs(linear_closed_loop(load(SEARCHED), x).poles()).max() < 1
