"""Margins against python-control, and against gains and delays put into the nonlinear simulation."""

import math
from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
from scipy.linalg import block_diag

from dualwinch.analysis import margin_survey
from dualwinch.analysis.linear_loop import linear_closed_loop, linear_open_loop
from dualwinch.analysis.margins import BOTH, Margins, complementary, margins
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.system import LinearSystem
from dualwinch.simulation.paper import case
from tests.simulation.inserted import run
from tests.tiers import all_but

PAPER = case(2)
KICK = {"motion.plant.v": 1e-7}
"""Small against the smoothing of 1e-5 m/s, so that the loop is the linear one."""


def loop(numerator: list[float], denominator: list[float], dt: float) -> LinearSystem:
    found: Any = control.ss(control.c2d(control.tf(numerator, denominator), dt))
    states = tuple(f"x{k}" for k in range(found.nstates))
    units = dict.fromkeys((*states, "in", "out"), "1")
    return LinearSystem(
        found.A, found.B, found.C, found.D, dt=dt, states=states, inputs=("in",), outputs=("out",), units=units
    )


def sampled(pole: float, gain: float, through: float) -> LinearSystem:
    """gain/(z − pole) + through."""
    A, B, C, D = (np.array([[value]]) for value in (pole, 1.0, gain, through))
    return LinearSystem(A, B, C, D, 1e-3, ("x",), ("in",), ("out",), dict.fromkeys(("x", "in", "out"), "1"))


def agrees(system: LinearSystem, found: Margins) -> None:
    """As python-control has it on grids of its own; it is slow on disks, so its grid is dense near ours only."""
    assert system.dt is not None
    highest = math.pi / system.dt * (1 - 1e-9)
    theirs = control.frd(system.to_control(), np.geomspace(1e-2, highest, 20_001))
    gain, phase, _, gain_at, phase_at, _ = control.stability_margins(theirs)
    assert (found.gain, found.gain_frequency) == pytest.approx((gain, gain_at), rel=1e-5)
    assert (found.phase, found.phase_frequency) == pytest.approx((phase, phase_at), rel=1e-5)
    near = found.disk_frequency * np.linspace(0.99, 1.01, 101)
    omega = np.unique(np.concatenate([np.geomspace(1e-2, highest, 200), near[near < highest]]))
    disk, disk_gain, disk_phase = control.disk_margins(system.to_control(), omega)
    assert found.disk == pytest.approx(disk, rel=1e-5)
    assert 20 * math.log10(found.disk_gain) == pytest.approx(disk_gain, rel=1e-4)
    assert found.disk_phase == pytest.approx(disk_phase, rel=1e-5)


@pytest.mark.parametrize("opening", ["u", "tau_2"])
def test_margins_of_the_papers_loop_are_those_of_python_control(opening: str) -> None:
    system = linear_open_loop(PAPER, 25.0, 0.5, opening)
    agrees(system, margins(system))


def test_margins_of_a_loop_with_a_sharp_resonance_are_those_of_python_control() -> None:
    assert not margins(loop([50], [1, 0.02, 100, 0], 1e-2)).stable
    system = loop([1], [1, 0.2, 100, 0], 1e-2)
    found = margins(system)
    assert found.stable
    agrees(system, found)


def test_margins_of_an_integrator_by_hand() -> None:
    """L = K Ts/(z − 1): unstable from K Ts = 2; the crossover is where 2 sin(w Ts/2) = K Ts."""
    found = margins(loop([10.0], [1, 0], 1e-2))
    crossover = 2 / 1e-2 * math.asin(0.05)
    assert found.gain == pytest.approx(2 / 0.1)
    assert found.phase_frequency == pytest.approx(crossover)
    assert found.phase == pytest.approx(90 - math.degrees(crossover * 1e-2 / 2))
    assert found.delay == pytest.approx(math.radians(found.phase) / crossover)
    assert found.least_gain == 0


def test_margins_at_standstill_of_a_lag_with_positive_feedback_by_hand() -> None:
    """L = −k/4/(z − 1/2): the closed loop's pole 1/2 + k/4 reaches 1 at k = 2."""
    found = margins(sampled(0.5, -0.25, 0.0))
    assert (found.stable, found.gain, found.gain_frequency) == (True, pytest.approx(2), 0)
    assert (found.phase, found.delay, found.disk) == (math.inf, math.inf, pytest.approx(2 / 3))


def test_least_gain_at_standstill_of_a_loop_that_feedback_makes_stable_by_hand() -> None:
    """L = k/(z − 3/2): the pole 3/2 − k is within the circle for k from 1/2 to 5/2."""
    found = margins(sampled(1.5, 1.0, 0.0))
    assert (found.stable, found.gain, found.least_gain) == (True, pytest.approx(2.5), pytest.approx(0.5))
    assert found.least_gain_frequency == 0


def test_margins_of_a_slow_integrator_by_hand() -> None:
    """L = 5e-4/s and 1e-7/s: 90° at 5e-4 and 1e-7 rad/s."""
    for crossover in (5e-4, 1e-7):
        found = margins(loop([crossover], [1, 0], 1e-3))
        assert (found.phase, found.phase_frequency) == (pytest.approx(90), pytest.approx(crossover, rel=1e-6))


def test_margins_of_loops_without_states_by_hand() -> None:
    """Of L = 1 the gain is 1 everywhere: half a turn is too much, and a sample of delay at half the sample rate."""
    one = margins(sampled(0.0, 0.0, 1.0))
    assert (one.gain, one.phase, one.delay, one.disk) == (math.inf, 180, pytest.approx(1e-3), math.inf)
    none = margins(sampled(0.0, 0.0, -1.0))
    assert (none.stable, none.gain, none.phase, none.delay, none.disk) == (False, 1, 0, 0, 0)
    assert margins(sampled(0.0, 0.0, -0.5)).gain == pytest.approx(2)


def test_an_integrator_that_is_all_but_silent_may_vanish() -> None:
    assert margins(sampled(1.0, 1e-14, 0.0)).least_gain == 0.0
    assert margins(sampled(0.0, 0.0, 2.0)).disk == pytest.approx(6)


def test_a_loop_that_carries_nothing_bears_everything() -> None:
    """Cruise at 1.8 m/s: rope 2's winch rests on its lower limit and answers to nothing."""
    found = margins(linear_open_loop(PAPER, 25.0, 1.8, "tau_2"))
    assert found.gain == found.phase == found.delay == math.inf
    assert found.disk == pytest.approx(2)


@pytest.mark.parametrize("opening", ["u", "tau_1"])
def test_gain_margin_is_where_the_nonlinear_loop_starts_to_oscillate(opening: str) -> None:
    margin = margins(linear_open_loop(PAPER, 25.0, 0.0, opening)).gain
    below, above = (run(PAPER, 25.0, 0.0, KICK, 1200, opening=opening, gain=share * margin) for share in (0.95, 1.05))
    assert below.peaks[3] < 0.3 * below.peaks[1]
    assert above.peaks[3] > 3 * above.peaks[0]
    assert below.taut
    assert above.taut


def test_delay_margin_is_where_the_nonlinear_loop_starts_to_oscillate() -> None:
    """23.6 ms at the force command: 22 samples are borne, 25 are not."""
    margin = margins(linear_open_loop(PAPER, 25.0, 0.0)).delay
    assert margin == pytest.approx(23.6e-3, abs=1e-4)
    below, above = (run(PAPER, 25.0, 0.0, KICK, 2000, delay=samples) for samples in (22, 25))
    assert below.peaks[3] < 0.3 * below.peaks[1]
    assert above.peaks[3] > 3 * above.peaks[0]
    assert below.taut
    assert above.taut


@pytest.mark.parametrize("v", all_but([0.5], [0.0, 0.5]))
def test_margins_of_both_torques_at_once_are_those_that_a_survey_finds(
    v: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(margin_survey, "survey_points", lambda _, **_words: [(25.0, v)])
    (worst,) = margin_survey.MarginSurvey([PAPER], openings=[BOTH]).worst([[]])
    found = margins(linear_open_loop(PAPER, 25.0, v, BOTH))
    assert {of.opening for of in worst.values()} == {BOTH}
    assert {kind: getattr(found, kind) for kind in worst} == pytest.approx(
        {kind: of.value for kind, of in worst.items()}, rel=1e-6
    )
    assert found.delay < margins(linear_open_loop(PAPER, 25.0, v, "tau_1")).delay


def test_responses_by_sums_over_poles_are_those_of_the_matrices() -> None:
    loop = linear_open_loop(PAPER, 25.0, 0.5, BOTH)
    assert loop.dt is not None
    closed = complementary(loop.A[None], loop.B[None], -loop.C[None], -loop.D[None], loop.dt)
    omega, one = np.geomspace(1e-2, 3e3, 50), np.zeros(50, np.intp)
    near = closed.loci(omega[None], exact=True)[0, 0]
    np.testing.assert_allclose(closed.loci(omega[None], exact=False)[0, 0], near, rtol=1e-7)
    for by_poles, by_solving in zip(
        closed.quick(omega, one, one, near), closed.exact(omega, one, one, near), strict=True
    ):
        np.testing.assert_allclose(by_poles, by_solving, rtol=1e-7)


def beside(one: LinearSystem, other: LinearSystem) -> LinearSystem:
    """Two loops of one signal each that do not touch."""
    A, B, C, D = (np.asarray(block_diag(getattr(one, name), getattr(other, name))) for name in "ABCD")
    states, inputs, outputs = ("x1", "x2"), ("in1", "in2"), ("out1", "out2")
    return LinearSystem(A, B, C, D, 1e-3, states, inputs, outputs, dict.fromkeys(states + inputs + outputs, "1"))


def test_two_loops_that_do_not_touch_have_the_margins_of_the_lesser() -> None:
    one, other = sampled(0.5, -0.25, 0.0), sampled(0.9, 0.4, 0.0)
    both = margins(beside(one, other))
    for kind in ("gain", "phase", "delay", "disk"):
        assert getattr(both, kind) == pytest.approx(min(getattr(margins(each), kind) for each in (one, other)))
    assert both.least_gain == max(margins(each).least_gain for each in (one, other))


def turned(pole: float, gain: float, through: float, degrees: float) -> LinearSystem:
    """(gain/(z − pole) + through) times a rotation, of the eigenvalues exp(±j degrees)."""
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    rotation, one = np.array([[cosine, -sine], [sine, cosine]]), np.eye(2)
    states, inputs, outputs = ("x1", "x2"), ("in1", "in2"), ("out1", "out2")
    units = dict.fromkeys(states + inputs + outputs, "1")
    return LinearSystem(pole * one, one, gain * rotation, through * rotation, 1e-3, states, inputs, outputs, units)


def test_loci_that_are_a_complex_pair_at_rest_do_not_cross_the_real_axis_there() -> None:
    """Of a rotation by 149° alone no gain makes −1; with a lag, the pole 1/2 + k exp(±31°j)/4 reaches the circle."""
    for size in (0.6, 3.0):
        found = margins(turned(0.0, 0.0, size, 149.0))
        assert (found.gain, found.least_gain) == (math.inf, 0.0)
        assert math.isnan(found.gain_frequency)
        assert math.isnan(found.least_gain_frequency)
    half = math.cos(math.radians(31)) / 2
    assert margins(turned(0.5, 0.25, 0.0, 149.0)).gain == pytest.approx(4 * (math.sqrt(half**2 + 0.75) - half))


@pytest.mark.parametrize(
    ("pole", "gain", "largest", "frequency"), [(0.5, -0.25, 2.0, 0.0), (0.9, 0.4, 4.75, math.pi / 1e-3)]
)
@pytest.mark.parametrize("apart", [0.0, 1e-17, -1e-17])
def test_loci_that_meet_are_real_at_rest_and_at_half_the_sample_rate(
    pole: float, gain: float, largest: float, frequency: float, apart: float
) -> None:
    """gain/(z − pole) twice, whose poles reach 1 and −1, coupled one way, and the other way by round-off."""
    one = sampled(pole, gain, 0.0)
    both = beside(one, one)
    coupled = margins(replace(both, C=both.C + np.array([[0.0, 1.0], [apart, 0.0]])))
    assert coupled.gain == pytest.approx(largest, rel=1e-6)
    assert coupled.gain_frequency == pytest.approx(frequency, abs=1e-4, rel=1e-6)


@pytest.mark.parametrize(("across", "back"), [(1e-3, -1e-13), (1.0, -1e-16), (-1.0, 1e-16)])
def test_loops_that_need_their_gain_at_rest_need_it_if_round_off_makes_them_a_complex_pair(
    across: float, back: float
) -> None:
    one = sampled(1.01, 0.3, 0.0)
    both = beside(one, one)
    found = margins(replace(both, C=both.C + np.array([[0.0, across], [back, 0.0]])))
    assert found.least_gain == pytest.approx(1 / 30, rel=1e-6)
    assert found.least_gain_frequency == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("at_rest", [0.0, -0.5, 0.5])
def test_a_loop_that_needs_its_gain_at_rest_may_stand_beside_one_that_does_not(at_rest: float) -> None:
    """Such as one of which nothing comes back: what matters is how far the other's gain may fall."""
    needs = sampled(1.02, 0.7, 0.0)
    other = sampled(0.5, 0.5 * at_rest, 0.0)
    found = margins(beside(needs, other))
    assert (found.stable, found.least_gain_frequency) == (True, 0)
    assert found.least_gain == pytest.approx(margins(needs).least_gain) == pytest.approx(0.02 / 0.7)


def test_margins_need_a_sampled_loop_of_one_signal_or_two() -> None:
    with pytest.raises(ConfigurationError, match="one input and one output, or two of each"):
        margins(linear_closed_loop(PAPER))
    for pole, through in ((math.nan, 0.0), (0.5, math.inf)):
        with pytest.raises(ConfigurationError, match="elements that are no finite numbers"):
            margins(sampled(pole, 1.0, through))
    with pytest.raises(ConfigurationError, match=r"dt = 0: must be > 0 s"):
        margins(control.ss([[0.0]], [[5e-4]], [[1.0]], [[0.0]], 0))  # pyright: ignore[reportArgumentType]
    with pytest.raises(ConfigurationError, match=r"is a TransferFunction: must be a discrete"):
        margins(control.tf([5e-7], [1.0, -1.0], 0.001))  # pyright: ignore[reportArgumentType]
