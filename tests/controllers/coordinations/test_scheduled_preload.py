from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.analysis.linear_loop import linear_open_loop
from dualwinch.analysis.margins import margins
from dualwinch.controllers.coordinations.scheduled_preload import ScheduledPreload, ScheduleOutput
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, Estimate
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Setpoint
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

LIMITS = Limits(preload=800.0)
BEHIND = 200 + 300
"""Tension in N that the rope behind keeps by default."""


def outputs(forces: Iterable[float], setpoint: Setpoint, part: ScheduledPreload) -> list[ScheduleOutput]:
    estimate, context = Estimate(0.0, 0.0, 1000.0, 1000.0, 0.0, 0.0, 0.0, 0.0), Context(Plant(), LIMITS, 1e-3)
    state, given_out = part.initial_state(), []
    for force in forces:
        state, output = part.step(state, force, estimate, setpoint, context)
        given_out.append(output)
    return given_out


def at_rest(forces: Iterable[float], part: ScheduledPreload | None = None) -> list[ScheduleOutput]:
    return outputs(forces, Setpoint(0.0, 0.0, 0.0), part or ScheduledPreload())


@given(st.floats(-4000, 4000))
def test_a_lasting_force_leaves_the_rope_behind_its_margin(force: float) -> None:
    last = at_rest([force] * 3000)[-1]
    assert min(last.F1_cmd, last.F2_cmd) == pytest.approx(BEHIND, abs=1)
    assert max(last.F1_cmd, last.F2_cmd) == pytest.approx(BEHIND + abs(force), abs=1)


@given(st.floats(0.2, 2), st.floats(-0.1, 0.1))
def test_what_the_reference_asks_for_is_known_at_once(v: float, a: float) -> None:
    """Of the paper's vehicle: 10 t, 490 N of friction, and a drag of 900 kg/m."""
    needed = 1e4 * a + 490 + 900 * v**2
    first = outputs([needed], Setpoint(0.0, v, a), ScheduledPreload())[0]
    assert first.preload == pytest.approx(abs(needed) + 2 * BEHIND)


def test_a_tremor_of_the_force_is_shared_by_both_ropes() -> None:
    """At 100 rad/s and 200 N: the sum hardly moves, each rope takes its half."""
    tremor = 200 * np.sin(100 * np.arange(5000) * 1e-3)
    late = at_rest(1500 + tremor)[4000:]
    F1, F2 = (np.array([getattr(output, name) for output in late]) for name in ("F1_cmd", "F2_cmd"))
    assert np.ptp(F1) == pytest.approx(200, rel=0.05)
    assert np.ptp(F2) == pytest.approx(200, rel=0.05)
    assert np.ptp(F1 + F2) == pytest.approx(2 * 200 / (100 * 0.3), rel=0.01)  # what a low-pass of 0.3 s lets through


@given(st.floats(0.02, 0.4))
def test_the_sum_falls_no_faster_than_it_may(rate: float) -> None:
    sums = [output.preload for output in at_rest([3000.0] * 2000 + [0.0] * 1000, ScheduledPreload(rate=rate))]
    fall = -np.diff(sums[2000:])
    assert fall.max() == pytest.approx(1e-3 * rate * LIMITS.tension_max, rel=1e-9)
    assert np.all(np.diff(sums[:2000]) >= 0)


@given(st.floats(-5800, 5800))
def test_the_force_keeps_its_reach_before_the_sum_has_risen(force: float) -> None:
    first = at_rest([0.0, force])[-1]
    assert first.F1_cmd - first.F2_cmd == pytest.approx(force, abs=1e-9)


def test_the_shared_preload_is_the_least_sum() -> None:
    experiment = override(
        case(4), {"controller.coordination.kind": "scheduled-preload", "controller.coordination.preload": 3000.0}
    )
    assert simulate(experiment)["preload"].min() == 3000


def test_less_load_than_the_constant_preload_that_keeps_the_same_margin() -> None:
    """Case 4 takes a force of 4.5 kN; with a constant preload that leaves the rope behind 300 N more than 200."""
    scheduled = override(
        case(4), {"controller.coordination.kind": "scheduled-preload", "controller.coordination.preload": 800.0}
    )
    constant = override(case(4), {"controller.coordination.preload": 5500.0})
    ours, theirs = (simulate(experiment).metrics for experiment in (scheduled, constant))
    assert min(ours.min_tension, theirs.min_tension) > 220
    assert ours.mse == pytest.approx(theirs.mse, rel=0.01)
    assert ours.continuous_load < 0.7 * theirs.continuous_load


def test_with_all_foreseen_it_is_the_least_sum_of_that_rate_that_is_large_enough() -> None:
    """Starts and stops of the paper's vehicle, known 2 s ahead at 0.4 s apart: never below, at most 0.4 s early."""
    rate, behind = 1500.0, 500.0
    motion = {
        "reference.kind": "way-points",
        "reference.points": (10.0, 12.0),
        "reference.pauses": (2.0, 2.0),
        "controller.coordination.kind": "scheduled-preload",
        "controller.coordination.preload": 1000.0,
        "controller.scheduled_preload.rate": rate / 6000,
        "controller.scheduled_preload.filter_time": 1e6,
        "controller.scheduled_preload.horizon": 2.0,
    }
    run = simulate(override(case(2), motion))
    v, a = run["v_ref"], run["a_ref"]
    enough = abs(1e4 * a + 490 * np.tanh(v / 0.01) + 900 * v * abs(v)) + 2 * behind
    least = enough.copy()
    for earlier in range(len(least) - 2, -1, -1):
        least[earlier] = max(least[earlier], least[earlier + 1] - 1e-3 * rate)
    for later in range(1, len(least)):
        least[later] = max(least[later], least[later - 1] - 1e-3 * rate)
    below = least - run["preload"]
    assert below.min() > -1
    assert below.max() < 0.4 * rate
    assert np.diff(run["preload"]).max() < 400
    assert np.all(run["preload"] > enough - 1)


def test_around_a_cruise_the_loop_is_that_of_a_constant_preload() -> None:
    """At 1 m/s and the same tensions: a force of 1390 N leaves 300 N above tension_min of a sum of 2390 N."""
    scheduled, constant = (
        margins(linear_open_loop(override(case(2), values), v=1.0))
        for values in (
            {"controller.coordination.kind": "scheduled-preload"},
            {"controller.coordination.preload": 2390.0},
        )
    )
    for name in ("gain", "phase", "delay", "disk"):
        assert getattr(scheduled, name) == pytest.approx(getattr(constant, name), rel=0.02), name
