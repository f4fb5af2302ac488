"""The formulas of docs/accuracy.md, worked out again: matrix exponentials, quadrature, roots.

Numbers in test names are those of the document.
"""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import quad, solve_ivp
from scipy.linalg import expm

from dualwinch.simulation.integrators.oscillator import (
    Oscillator,
    crossing,
    free_flight,
    swing,
    taut_series,
    twice_cosine_and_sine,
)

ROOT = Path(__file__).parents[3]
DOCUMENT = (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8")
SOURCES = sorted((ROOT / "simulation" / "integrators").glob("*.py"))

Floats = NDArray[np.float64]
sizes = st.floats(-2.0, 2.0)
frequencies = st.floats(0.2, 6.0)
dampings = st.floats(0.0, 3.0)


def linear_flow(kappa: float, damping: float, g: float, ramp: float, start: tuple[float, float], t: float) -> Floats:
    """(2,) s and s' at the time t of s'' = g + ramp t − kappa s − damping s', by a matrix exponential.

    The state holds s, s', the drive and its growth.
    """
    generator = np.array([[0, 1, 0, 0], [-kappa, -damping, 1, 0], [0, 0, 0, 1], [0, 0, 0, 0]], float)
    return np.asarray(expm(generator * t) @ np.array([*start, g, ramp]), np.float64)[:2]


def oscillator(
    *, kappa: float, drag: float = 0.0, drive: float = 0.0, start: tuple[float, float] = (1.0, 0.0), slack: bool = False
) -> Oscillator:
    """A rope of 5 N/m and 0.1 N a (m a step) whose length stays, so that nothing is left out in (7)."""
    return Oscillator(
        stretch=start[0],
        rate=start[1],
        drive=drive,
        sign=-1.0,
        spring=5.0,
        compliance=0.2,
        damper=0.1,
        stiffening=0.0,
        mobility=kappa / 5.0,
        drag=drag,
        slack=slack,
    )


def test_the_code_names_numbers_that_the_document_has() -> None:
    tags = [int(tag) for tag in re.findall(r"\\tag\{(\d+)\}", DOCUMENT)]
    assert tags == list(range(1, len(tags) + 1))
    named = set[int]()
    for source in SOURCES:
        for reference in re.findall(r"Eq\. ([\d, –]+)", source.read_text(encoding="utf-8")):
            named |= {int(number) for number in re.findall(r"\d+", reference)}
    assert named <= set(tags)
    assert len(named) >= 15


@given(st.floats(-30.0, 40.0))
def test_12_13_cosine_and_sine(square: float) -> None:
    root = np.sqrt(complex(square))
    cosine, sine = twice_cosine_and_sine(square)
    assert cosine == pytest.approx(2 * np.cos(root).real, rel=1e-8, abs=1e-8)
    assert sine == pytest.approx(2 * np.sinc(root / np.pi).real, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize(("oscillations", "error"), [(1, 5e-10), (2, 3e-6)])
def test_12_13_err_by_what_the_document_says(oscillations: int, error: float) -> None:
    angles = np.linspace(0.01, 2 * math.pi * oscillations, 300)
    found = np.array([twice_cosine_and_sine(angle**2) for angle in angles])
    exact = 2 * np.array([np.cos(angles), np.sinc(angles / np.pi)]).T
    assert error / 2 < np.abs(found - exact).max() < error


@given(frequencies, dampings, st.floats(-0.004, 0.004), sizes, sizes, sizes, sizes)
def test_7_to_11_the_flow_is_that_of_the_equation_for_q(
    frequency: float, damping: float, stiffening: float, stretch: float, rate: float, g: float, growth: float
) -> None:
    """From a start under a constant drive, and from rest under a growing one; underdamped and overdamped."""
    kappa = frequency**2
    coefficients = kappa - damping * stiffening, damping - 2 * stiffening
    first, last = 1 - stiffening / 2, 1 + stiffening / 2

    def at_end(g: float, ramp: float, stretch: float, rate: float) -> Floats:
        q, q_rate = linear_flow(*coefficients, g, ramp, (first * stretch, first * rate + stiffening * stretch), 1.0)
        return np.array([q / last, (q_rate - stiffening * q / last) / last])

    flow = swing(kappa, damping, stiffening)
    error = 10 * (1e-9 + abs(stiffening) ** 3)  # of C and S, with exp(stiffening) to the second order
    by_drive, by_ramp = error * (1 + 1 / kappa), error * (1 + 1 / kappa + damping / kappa**2)  # (10) divides
    assert np.array(flow.carried(stretch, rate, g)) == pytest.approx(at_end(g, 0.0, stretch, rate), abs=by_drive)
    assert np.array(flow.driven(growth)) == pytest.approx(at_end(1.0, growth, 0.0, 0.0), abs=by_ramp)


def test_6_what_is_left_out_is_of_third_order() -> None:
    """Against the equation with its changing stiffness, softer as said: half the step has an eighth of the error."""

    def error(h: float) -> float:
        kappa, damping, stiffening, g, start = 9.0 * h**2, 0.8 * h, 0.4 * h, 2.0 * h**2, (1.0, 0.5 * h)
        softer = kappa - 2 * stiffening**2

        def slope(t: float, s: Floats) -> list[float]:
            return [s[1], g - softer * (1 + stiffening * (t - 0.5)) * s[0] - damping * s[1]]

        exact = solve_ivp(slope, (0, 1), start, method="DOP853", rtol=1e-13, atol=1e-14).y[0, -1]
        return abs(swing(kappa, damping, stiffening).carried(*start, g)[0] - exact)

    assert math.log2(error(0.1) / error(0.05)) == pytest.approx(3, abs=0.2)


@given(frequencies, st.floats(0.0, 0.3), sizes, sizes, sizes, sizes)
def test_14_15_the_end_and_the_mean_tension(
    frequency: float, drag: float, stretch: float, rate: float, drive: float, a: float
) -> None:
    rope = oscillator(kappa=frequency**2, drag=drag, drive=drive, start=(stretch, rate))
    damping = rope.mobility * rope.damper + drag

    def state(t: float) -> Floats:
        return linear_flow(frequency**2, damping, drive - a, -drag * a, (stretch, rate), t)

    def tension(t: float) -> float:
        s, s_rate = state(t)
        return 5.0 * s + 0.1 * s_rate

    *end, mean = rope.end(a)
    assert end == pytest.approx(list(state(1.0)), abs=1e-6)
    scale = 1e-6 / rope.mobility  # the mean tension is a difference of speeds over the mobility
    assert mean == pytest.approx(quad(tension, 0, 1, epsabs=1e-10)[0], abs=1e-6 + 10 * scale)
    fixed, slope = rope.mean_pull()
    assert fixed - a * slope == pytest.approx(mean, abs=1e-9 + 1e-6 * scale)


@given(st.floats(1e-6, 0.3), sizes, sizes, sizes, sizes, st.floats(0.01, 1.0))
def test_20_21_free_flight(drag: float, stretch: float, rate: float, g: float, ramp: float, t: float) -> None:
    exact = linear_flow(0.0, drag, g, ramp, (stretch, rate), t)
    error = 4e-4 * (drag * t) ** 3 + 1e-12
    assert np.array(free_flight(stretch, rate, g, ramp, drag, t)) == pytest.approx(exact, abs=error)


@given(st.floats(0.1, 2.0), st.floats(0.0, 0.5), sizes, sizes, sizes, sizes, st.floats(0.0, 1.0))
def test_23_the_series(
    frequency: float, damping: float, stretch: float, rate: float, g: float, ramp: float, t: float
) -> None:
    """Good for a third of an oscillation, which is 2 rad."""
    exact = linear_flow(frequency**2, damping, g, ramp, (stretch, rate), t)
    found = taut_series(stretch, rate, g, ramp, frequency**2, damping, t)
    assert np.array(found) == pytest.approx(exact, abs=2e-2 * (frequency * t) ** 7 + 1e-9)


@given(st.floats(0.01, 2.0), sizes, st.floats(-2.0, -0.01), st.sampled_from([1.0, -1.0]))
def test_22_the_parabola_s_zero(start: float, slope: float, end: float, side: float) -> None:
    roots = np.roots([end - start - slope, slope, start])
    inside = [root.real for root in roots if abs(root.imag) < 1e-9 and 0 <= root.real <= 1]
    assume(len(inside) == 1)
    assert crossing(side * start, side * slope, side * end) == pytest.approx(inside[0], abs=1e-6)


def by_events(rope: Oscillator, a: float) -> Floats:
    """Stretch and rate at the end, by a solver that stops where the pull or the stretch changes its sign."""

    def pull(_: float, s: Floats, *_taut: bool) -> float:
        return rope.spring * s[0] + rope.damper * s[1]

    def stretch(_: float, s: Floats, *_taut: bool) -> float:
        return s[0]

    def slope(t: float, s: Floats, taut: bool) -> list[float]:  # SciPy passes it by position
        drive = rope.drive + rope.sign * a * (1 + rope.drag * t) - rope.drag * s[1]
        return [s[1], drive - taut * rope.mobility * pull(t, s)]

    for event in (pull, stretch):
        event.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
    t, state = 0.0, np.array([rope.stretch, rope.rate])
    taut = min(stretch(t, state), pull(t, state)) > 0
    while t < 1:
        run = solve_ivp(
            slope, (t, 1), state, args=(taut,), method="DOP853", rtol=1e-12, atol=1e-14, events=(pull, stretch)
        )
        t, state = run.t[-1], run.y[:, -1]
        if t < 1:
            ahead = state + 1e-9 * np.array(slope(t, state, taut))  # just behind the event
            taut = min(stretch(t, ahead), pull(t, ahead)) > 0
            state = ahead
            t += 1e-9
    return state


@pytest.mark.parametrize(
    ("start", "drive"),
    [((0.2, -0.6), -0.1), ((0.05, -0.3), 0.02), ((-0.2, 0.5), 0.1), ((-0.1, 0.4), -0.05)],
    ids=["slackens hard", "slackens", "tightens", "tightens late"],
)
def test_22_to_24_going_slack_and_tight(start: tuple[float, float], drive: float) -> None:
    """The moment is right to the second order, so that half the step has an eighth of the error."""

    def error(h: float) -> float:
        rope = oscillator(
            kappa=1.5 * h**2, drag=0.05 * h, drive=drive * h**2, start=(start[0] * h, start[1] * h), slack=True
        )
        end = np.array(rope.end(0.02 * h**2)[:2])
        return float(np.abs(end - by_events(rope, 0.02 * h**2)).max() / h)

    assert error(1.0) < 3e-3
    assert error(0.25) < error(1.0) / 4**2 + 1e-8


@given(frequencies, st.floats(0.1, 2.0), st.floats(0.0, 2 * math.pi), st.floats(0.0, 0.99))
def test_25_to_27_where_the_number_is_positive_the_rope_stays_taut(
    frequency: float, equilibrium: float, phase: float, share: float
) -> None:
    """Swings about an equilibrium, up to the widest that pass; a little wider and the number is no longer positive."""
    kappa, g = frequency**2, frequency**2 * equilibrium
    widest = g / math.sqrt(1.375 + 5.5 * 0.1**2 * kappa / 25)

    def swinging(amplitude: float) -> Oscillator:
        start = equilibrium + amplitude * math.cos(phase) / kappa, amplitude * math.sin(phase) / frequency
        return oscillator(kappa=kappa, drive=g, start=start)

    assert swinging(1.001 * widest).clearance(0.0) < 0
    rope = swinging(share * widest)
    assert rope.clearance(0.0) > 0
    damping, start = rope.mobility * rope.damper, (rope.stretch, rope.rate)
    states = np.array([linear_flow(kappa, damping, g, 0.0, start, t) for t in np.linspace(0, 1, 41)])
    assert states[:, 0].min() > 0
    assert (states @ (5.0, 0.1)).min() > 0
