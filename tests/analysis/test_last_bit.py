"""Results of analyses on ten computers, which differ in the last bit: the same decisions, and close numbers."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import dualwinch as dw
from dualwinch.analysis.describing_function import describing_gain
from dualwinch.analysis.linear_loop import closed, fastest_growing
from dualwinch.analysis.margin_survey import MarginSurvey
from dualwinch.analysis.margins import MARGIN_KINDS
from dualwinch.analysis.remarks import loop_remarks
from dualwinch.analysis.resonance import MARGIN_AMPLITUDES
from dualwinch.model.linear.properties import dc_gains, is_controllable, is_stable, sufficient_sensors
from tests.last_bit import COMPUTERS, LAST_BIT, SEEDS, perturbed

PAPER = dw.case(2)
TUNED = dw.load(Path(__file__).parents[1] / "power_law_in_site.toml")


def integrators(count: int) -> dw.LinearSystem:
    """Lags, and a chain of integrators, which no control holds."""
    A = np.diag([1.0] * count + [0.9, 0.7, 0.5, 0.2]) + np.diag([1e-3] * (count + 3), 1)
    states = tuple(f"x{index}" for index in range(len(A)))
    B, C = np.eye(len(A))[:, [-1]], np.eye(len(A))[[0]]
    return dw.LinearSystem(
        A, B, C, np.zeros((1, 1)), 1e-3, states, ("u",), ("y",), dict.fromkeys((*states, "u", "y"), "1")
    )


def rotated(system: dw.LinearSystem, seed: int) -> dw.LinearSystem:
    """The same system in other states, with rounding errors in every element."""
    turn = np.linalg.qr(np.random.default_rng(seed).standard_normal(system.A.shape))[0]
    return replace(system, A=turn.T @ system.A @ turn, B=turn.T @ system.B, C=system.C @ turn)


@pytest.mark.parametrize("seed", SEEDS)
def test_rounding_errors_are_no_growth_and_growth_beyond_them_is(seed: int) -> None:
    """An integrator's eigenvalue is 1 within 1e-14, a double one within 1e-8: 1.33e-12 1/s over 1 ms are nothing."""
    for count in (1, 2):
        assert is_stable(rotated(integrators(count), seed))
        assert is_stable(perturbed(integrators(count), seed))
    system = integrators(1)
    grown = {rate: replace(system, A=system.A + np.diag([1e-3 * rate, 0, 0, 0, 0])) for rate in (1.33e-12, 1e-7, 0.002)}
    assert [is_stable(perturbed(each, seed)) for each in grown.values()] == [True, False, False]
    mode = fastest_growing(rotated(grown[0.002], seed), dw.Plant())
    assert mode is not None
    assert mode.rate.real == pytest.approx(0.002, rel=1e-4)


@pytest.mark.parametrize("opening", ["u", "tau_1", "torques"])
def test_margins_and_the_least_of_them_are_the_same(opening: str) -> None:
    system = dw.linear_open_loop(PAPER, 25.0, 0.5, opening)
    margins = dw.margins(system)
    for seed in SEEDS:
        near = dw.margins(perturbed(system, seed))
        assert near.stable == margins.stable
        for kind in (*MARGIN_KINDS, "least_gain"):
            assert getattr(near, kind) == pytest.approx(getattr(margins, kind), rel=1e-8), kind


@COMPUTERS
@pytest.mark.parametrize("v", [0.0, 0.5])
def test_linear_loops_are_the_same_with_the_same_states(v: float, seeds: range) -> None:
    system, open_loop = dw.linear_closed_loop(PAPER, 25.0, v), dw.linear_open_loop(PAPER, 25.0, v)
    poles = np.sort_complex(system.poles())
    for seed in seeds:
        experiment = perturbed(PAPER, seed)
        near = dw.linear_closed_loop(experiment, 25.0, v)
        assert near.states == system.states
        assert dw.linear_open_loop(experiment, 25.0, v).states == open_loop.states
        size = np.abs(system.A).max(axis=1, keepdims=True)
        assert np.abs(near.A / size - system.A / size).max() < 1e-6
        assert is_stable(near) == is_stable(system)
        assert np.abs(np.abs(near.poles()).max() - np.abs(poles).max()) < 1e-9


def unitless(gains: NDArray[np.float64]) -> NDArray[np.float64]:
    """Finite gains over the largest of their row, then of their column."""
    finite = np.where(np.isfinite(gains), gains, 0.0)
    finite = finite / np.maximum(np.abs(finite).max(axis=1, keepdims=True), 1e-300)
    return finite / np.maximum(np.abs(finite).max(axis=0), 1e-300)


@pytest.mark.parametrize("x", [5.0, 25.0])
def test_modes_of_the_plant_have_the_same_names_and_numbers(x: float) -> None:
    """At mid-track the modes of two equal ropes are a pair of the same damping, but of different frequencies."""
    system = dw.linearise(PAPER, x, 0.5)
    modes = dw.modes(system, PAPER.plant)
    properties, gains = [is_controllable(system), sufficient_sensors(system)], dc_gains(system)
    for seed in SEEDS:
        near = dw.linearise(perturbed(PAPER, seed), x, 0.5)
        moved = dw.modes(near, PAPER.plant)
        assert [mode.label for mode in moved] == [mode.label for mode in modes]
        assert [mode.rate for mode in moved] == pytest.approx([mode.rate for mode in modes], rel=1e-9, abs=1e-9)
        assert [is_controllable(near), sufficient_sensors(near)] == properties
        assert (np.isfinite(dc_gains(near)) == np.isfinite(gains)).all()
        # the condition number of a stiff rope beside a light drum is some 1e6
        np.testing.assert_allclose(unitless(dc_gains(near)), unitless(gains), atol=1e-8)


def test_operating_points_and_their_violations_are_the_same() -> None:
    for x, v in ((1.0, 0.0), (25.0, 1.8), (49.0, -0.5)):
        point = dw.operating_point(PAPER, x, v)
        for seed in SEEDS:
            near = dw.operating_point(perturbed(PAPER, seed), x, v)
            assert near.violations == point.violations
            assert pytest.approx([point.F1, point.F2], rel=1e-11) == [near.F1, near.F2]


@COMPUTERS
def test_steady_motion_and_the_worst_margins_are_the_same(seeds: range) -> None:
    survey = MarginSurvey([PAPER])
    (worst,) = survey.worst([[]])
    for seed in seeds:
        (near,) = MarginSurvey([perturbed(PAPER, seed)]).worst([[]])
        for kind, margin in worst.items():
            assert near[kind].value == pytest.approx(margin.value, rel=1e-7), kind
            assert near[kind].reason == margin.reason
            assert (near[kind].opening, near[kind].v) == (margin.opening, margin.v)
            assert near[kind].x == pytest.approx(margin.x)


def test_gains_at_resonances_and_describing_functions_are_the_same() -> None:
    gains, arguments = dw.resonance_gains(TUNED), np.array([0.01, 1.7, 3e-3])
    for seed in SEEDS:
        near = dw.resonance_gains(perturbed(TUNED, seed))
        assert [drum.gain for drum in near] == pytest.approx([drum.gain for drum in gains], rel=1e-12)
        assert [drum.verdict for drum in near] == [drum.verdict for drum in gains]
        assert describing_gain(*perturbed(arguments, seed)) == pytest.approx(describing_gain(*arguments), rel=1e-12)


@pytest.mark.slow
def test_certificates_and_nearby_gains_are_the_same() -> None:
    experiment = dw.override(dw.case(3), {"simulation.duration": 3.0})
    certificate = dw.certify(experiment)
    near = dw.nearby_gains(certificate)
    for seed in SEEDS:
        moved = dw.certify(perturbed(experiment, seed))
        assert [each.holds for each in moved.conditions] == [each.holds for each in certificate.conditions]
        assert moved.decreasing == pytest.approx(certificate.decreasing, abs=0.01)
        raised = dw.nearby_gains(moved)
        assert (raised.found, raised.changes.keys()) == (near.found, near.changes.keys())


def test_a_certificate_of_a_short_run_is_the_same() -> None:
    experiment = dw.override(dw.case(4), {"simulation.duration": 0.5})
    certificate = dw.certify(experiment)
    for seed in SEEDS:
        moved = dw.certify(perturbed(experiment, seed))
        assert [each.holds for each in moved.conditions] == [each.holds for each in certificate.conditions]
        sides = [(each.left, each.right) for each in certificate.conditions]
        # of two neighbouring samples a rate of change magnifies rounding by 1/Ts = 1000
        np.testing.assert_allclose([(each.left, each.right) for each in moved.conditions], sides, rtol=1e-6)


@COMPUTERS
@pytest.mark.parametrize("minimise", ["load", "peak"])
def test_an_optimal_preload_is_the_same(minimise: Any, seeds: range) -> None:
    optimum = dw.optimal_preload(PAPER, minimise, every=1000)
    for seed in seeds:
        near = dw.optimal_preload(perturbed(PAPER, seed), minimise, every=1000)
        figures = near.continuous_load, near.peak_tension, near.energy
        assert figures == pytest.approx((optimum.continuous_load, optimum.peak_tension, optimum.energy), rel=1e-6)


@pytest.mark.slow
def test_a_designed_controller_is_the_same_with_the_same_limits() -> None:
    machine = dw.load_ensemble("site").experiment
    design = dw.designed(machine)
    for seed in SEEDS:
        near = dw.designed(perturbed(machine, seed))
        assert [limit.cause for limit in near.limits] == [limit.cause for limit in design.limits]
        assert (near.shares, near.violations) == (design.shares, design.violations)
        assert near.bandwidth == pytest.approx(design.bandwidth, rel=1e-9)
        for kind, margin in design.margins.items():
            # least squares of the steady motion and a search on a grid of frequencies stand between
            assert near.margins[kind].value == pytest.approx(margin.value, rel=1e-5), kind


@pytest.mark.slow
def test_large_signal_stability_and_remarks_are_the_same() -> None:
    stability, remarks = dw.large_signal_stability(TUNED), list(loop_remarks(TUNED))
    for seed in SEEDS:
        experiment = perturbed(TUNED, seed)
        near = dw.large_signal_stability(experiment)
        assert near.amplitude == pytest.approx(stability.amplitude, rel=2e-4)
        assert str(near) == str(stability)
        assert list(loop_remarks(experiment)) == remarks
        assert MarginSurvey([experiment]).worst([[]], [*MARGIN_AMPLITUDES])[0].keys() == MARGIN_AMPLITUDES.keys()


def test_numbers_move_by_less_than_the_last_bits() -> None:
    """What the tests above rest on: values move, their structure does not, and a seed is a computer."""
    moved = perturbed(TUNED, 1)
    assert moved != TUNED
    assert moved == perturbed(TUNED, 1)
    assert moved.plant.vehicle.mass == pytest.approx(TUNED.plant.vehicle.mass, rel=LAST_BIT, abs=0)
    assert moved.simulation == TUNED.simulation
    assert closed(dw.linear_open_loop(PAPER)).states
