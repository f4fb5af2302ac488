"""Describing functions against quadrature, and against limit cycles of the nonlinear simulation."""

import numpy as np
import pytest
from scipy.integrate import quad

from dualwinch.analysis.describing_function import amplitude_sweep, describing_gain
from dualwinch.analysis.linear_loop import linear_open_loop
from dualwinch.analysis.margins import margins
from dualwinch.controllers.laws.nftsm import NftsmGains, layer_width, odd_power
from dualwinch.simulation.paper import case
from tests.simulation.inserted import run

PAPER = case(2)


@pytest.mark.parametrize("exponent", [1 / 3, 5 / 3])
@pytest.mark.parametrize("amplitude", [1e-7, 1e-5, 1e-2])
def test_describing_gain_is_the_first_harmonic(exponent: float, amplitude: float) -> None:
    def harmonic(angle: float) -> float:
        return odd_power(amplitude * np.sin(angle), exponent, 1e-5) * np.sin(angle)

    first = 2 / np.pi * quad(harmonic, 0, np.pi, epsabs=0, epsrel=1e-10, limit=500)[0]
    assert describing_gain(amplitude, exponent, 1e-5) == pytest.approx(first / amplitude, rel=1e-8)


@pytest.mark.parametrize("amplitude", [1e-7, 1e-3, 0.3])
def test_describing_gain_of_a_widening_layer_is_the_first_harmonic(amplitude: float) -> None:
    def harmonic(angle: float) -> float:
        z = amplitude * np.sin(angle)
        return odd_power(z, 5 / 3, 1e-5) / layer_width(z, NftsmGains(linear_speed=0.01)) * np.sin(angle)

    first = 2 / np.pi * quad(harmonic, 0, np.pi, epsabs=0, epsrel=1e-10, limit=500)[0]
    assert describing_gain(amplitude, 5 / 3, 1e-5, 0.01) == pytest.approx(first / amplitude, rel=1e-6)


def test_small_amplitudes_give_the_jacobian_s_loop_and_large_ones_a_softer_one() -> None:
    jacobian = margins(linear_open_loop(PAPER, 25.0, 0.5))
    small, large = amplitude_sweep(PAPER, 25.0, 0.5, amplitudes=(1e-9, 1e-3))
    assert small.margins.gain == pytest.approx(jacobian.gain, rel=1e-6)
    assert small.margins.delay == pytest.approx(jacobian.delay, rel=1e-6)
    assert large.margins.gain > 7 * small.margins.gain
    assert large.margins.delay > 7 * small.margins.delay


@pytest.mark.parametrize(("amplitude", "within"), [(2e-5, 0.03), (5e-5, 0.06)])
def test_a_gain_beyond_the_margin_gives_the_limit_cycle_foretold(amplitude: float, within: float) -> None:
    """With the gain margin of an amplitude put in, the nonlinear loop settles at that amplitude from either side."""
    (point,) = amplitude_sweep(PAPER, 25.0, 0.0, amplitudes=(amplitude,))
    for start in (0.3, 2.0):
        found = run(PAPER, 25.0, 0.0, {"motion.plant.v": start * amplitude}, 2000, gain=point.margins.gain)
        assert found.peaks[3] == pytest.approx(amplitude, rel=within)
        assert found.taut
