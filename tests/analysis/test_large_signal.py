"""Large-signal stability: the first amplitude at which the rule or an eigenvalue of the loop crosses its limit."""

from pathlib import Path

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.analysis.margin_survey import MarginSurvey
from dualwinch.analysis.remarks import large_signal_remarks, loop_remarks
from dualwinch.analysis.resonance import LARGE_SIGNAL, RESONANCE

TUNED = dw.load(Path(__file__).parents[1] / "power_law_in_site.toml")
STEEP = dw.override(
    dw.case(4),
    {
        "controller.nftsm.beta": 0.13,
        "controller.nftsm.eta": 0.94,
        "controller.nftsm.k": 13.6,
        "controller.nftsm.phi": 0.01,
        "controller.observer.l0": 28.0,
    },
)


def test_drums_limit_the_speed_error_of_the_tuned_gains_where_the_rule_is_one() -> None:
    stability = dw.large_signal_stability(TUNED)
    below, above = (
        max(drum.gain for drum in dw.resonance_gains(TUNED, amplitudes=[factor * stability.amplitude]))
        for factor in (0.99, 1.01)
    )
    assert below < 1 < above
    assert stability.amplitude == pytest.approx(0.0768, abs=5e-4)
    assert stability.frequency == pytest.approx(dw.resonance_gains(TUNED)[0].frequency)
    (words,) = large_signal_remarks(TUNED)
    assert words.startswith(
        "stable up to speed errors of 7.68 cm/s; beyond, oscillation of drum 1 on its rope at 10.4 "
    )


def test_with_a_linear_speed_the_tuned_gains_are_stable_throughout() -> None:
    linear = dw.override(TUNED, {"controller.nftsm.linear_speed": 0.01})
    assert dw.large_signal_stability(linear).throughout
    small, large = ([drum.gain for drum in dw.resonance_gains(linear, amplitudes=[size])] for size in (1e-3, 0.3))
    assert small == pytest.approx([drum.gain for drum in dw.resonance_gains(TUNED, amplitudes=[1e-3])], rel=0.02)
    assert max(large) < 0.5


def test_eigenvalues_limit_it_where_the_loop_loses_stability_first() -> None:
    stability = dw.large_signal_stability(STEEP)
    below, above = (
        dw.amplitude_sweep(STEEP, amplitudes=[factor * stability.amplitude])[0].margins.stable
        for factor in (0.99, 1.01)
    )
    assert (below, above) == (True, False)
    assert 1e-4 < stability.amplitude < 0.01


def test_the_papers_loop_is_stable_throughout() -> None:
    stability = dw.large_signal_stability(dw.case(4), largest=0.2)
    assert stability.throughout
    assert (stability.amplitude, stability.largest) == (0.2, 0.2)
    assert np.isnan(stability.frequency)
    assert not list(large_signal_remarks(dw.case(4))), "its ropes have no mass"


def test_a_survey_has_the_margin_over_all_speed_errors_beside_that_of_small_ones() -> None:
    (worst,) = MarginSurvey([TUNED]).worst([[]], [RESONANCE, LARGE_SIGNAL])
    gains = [drum.gain for drum in dw.resonance_gains(TUNED, amplitudes=(1e-2, 0.3)) if drum.winch == 1]
    assert (worst[RESONANCE].value, worst[LARGE_SIGNAL].value) == pytest.approx((1 / gains[0], 1 / gains[1]))
    assert worst[LARGE_SIGNAL].amplitude == pytest.approx(0.3)


def test_a_loop_that_is_stable_at_small_amplitudes_has_no_cycle() -> None:
    assert all(np.isnan(dw.large_signal_stability(experiment).cycle) for experiment in (dw.case(4), STEEP, TUNED))


@pytest.mark.slow
def test_a_run_at_rest_ends_in_the_cycle_of_a_loop_that_is_unstable_there() -> None:
    gains = {"controller.nftsm.smoothing": 1e-7, "controller.nftsm.beta": 0.5}
    settings = gains | {"reference.kind": "way-points", "reference.points": (0.02,), "simulation.duration": 12.0}
    experiment = dw.override(dw.case(1), settings)
    stability = dw.large_signal_stability(experiment)
    assert stability.amplitude == 0.0
    (words,) = loop_remarks(experiment)
    assert f"; it ends in a cycle of {1e6 * stability.cycle / (2 * np.pi * stability.frequency):.2g} µm" in words
    last = np.asarray(dw.simulate(experiment)["v"])[-2000:]
    assert np.ptp(last) / 2 == pytest.approx(stability.cycle, rel=1.0)
