"""The cycle of a loop that is unstable at small amplitudes, against the simulated loop."""

import math

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.analysis.limit_cycle import LimitCycle, limit_cycle

STEEP = {"controller.nftsm.smoothing": 1e-7, "controller.nftsm.beta": 0.5}


def test_a_loop_that_is_stable_at_small_amplitudes_has_none() -> None:
    assert limit_cycle(dw.case(4)) is None
    assert limit_cycle(dw.override(dw.case(4), {"controller.kind": "pid-cascade"})) is None


def test_words_say_how_large_it_is_and_whether_it_matters() -> None:
    small = LimitCycle(1e-3, 10.0, 2e-3)
    assert small.position == pytest.approx(1e-3 / (20 * math.pi))
    assert (
        small.words == "a cycle of 16 µm at 10 Hz, in which the speed changes by less than its sensor's noise: harmless"
    )
    assert LimitCycle(3e-3, 10.0, 2e-3).words == "a cycle of 48 µm at 10 Hz, larger than the speed sensor's noise"


@pytest.mark.slow
def test_a_run_at_rest_ends_in_it() -> None:
    settings = STEEP | {"reference.kind": "way-points", "reference.points": (0.02,), "simulation.duration": 12.0}
    experiment = dw.override(dw.case(1), settings)
    cycle = limit_cycle(experiment)
    assert cycle is not None
    run = dw.simulate(experiment)
    last = np.asarray(run["v"])[-2000:]
    assert np.ptp(last) / 2 == pytest.approx(cycle.speed, rel=1.0)
