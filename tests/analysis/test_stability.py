"""The stability theorem's formulas against numbers worked out by hand."""

from dataclasses import astuple

import numpy as np
import pytest

from dualwinch.analysis.stability import (
    IDEAL,
    REAL,
    Bounds,
    auxiliary_weight_needed,
    bounds,
    claimed_decay,
    conditions,
    lyapunov_terms,
    switching_gain_needed,
)
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override

SEEN = Bounds(disturbance=0.06, disturbance_rate=0.13, speed_error=0.008, observer_gain=5.0)
"""About what Case 4 shows; 0.008^(2/3) = 0.04."""


def test_conditions_of_the_papers_gains_by_hand() -> None:
    """2·5·0.06/(3·0.05)·0.04 + 0.05 = 0.21 m/s², and 2·6000/1 = 12000."""
    sides = {
        (condition.name, condition.basis): (condition.left, condition.right, condition.holds)
        for condition in conditions(case(4), {IDEAL: SEEN})
    }
    assert sides["switching gain", IDEAL] == (0.5, pytest.approx(0.21), True)
    assert sides["observer gain", IDEAL] == (5.0, 0.13, True)
    assert sides["decay of Z_a", ""] == (1.0, 0.0, True)
    assert sides["weight of Z_a in the surface", ""] == (1e-5, 12000.0, False)
    assert sides["weight of Z_a in the force", ""] == (1e-5, 12000.0, False)


def test_a_gain_on_its_bound_satisfies_it_and_one_below_does_not() -> None:
    needed = switching_gain_needed(0.06, 0.008, 5 / 3, 0.05, 0.05)
    for k, holds in ((needed, True), (needed * (1 - 1e-12), False)):
        verdicts = conditions(override(case(4), {"controller.nftsm.k": k}), {IDEAL: SEEN})
        assert verdicts[0].holds is holds


def test_without_decay_no_weight_is_enough() -> None:
    assert auxiliary_weight_needed(6000.0, 0.0) == np.inf
    verdicts = conditions(override(case(4), {"controller.auxiliary.k_a": 0.0}), {IDEAL: SEEN})
    assert [condition.holds for condition in verdicts] == [True, True, False, False, False]


def test_without_an_observer_there_is_no_condition_on_it() -> None:
    assert "observer gain" not in {condition.name for condition in conditions(case(4, "nftsm"), {IDEAL: SEEN})}


def test_lyapunov_function_by_hand() -> None:
    """0.2²/2, 30²/2, 1e4·0.01²/(2·8), 3²/(2·5)."""
    terms = lyapunov_terms(s=0.2, Z_a=30.0, d_tilde=0.01, L1=8.0, l0=5.0, kf=5.0, mass=1e4)
    assert terms.total == pytest.approx(0.02 + 450 + 0.0625 + 0.9)
    assert lyapunov_terms(0.0, 0.0, 0.0, 5.0, 5.0, 0.0, 1e4).total == 0
    assert claimed_decay(0.2, 30.0, 0.01, eta=0.05, k_a=2.0, mass=1e4) == pytest.approx(-(0.002 + 1800 + 0.5))


def test_bounds_are_the_extremes_of_a_run() -> None:
    columns = {
        "v": np.array([0.0, 1.0, 2.0]),
        "v_ref": np.array([0.1, 1.0, 2.1]),
        "Z_a": np.array([0.0, 0.0, -2e4]),
        "L1": np.array([6.0, 5.5, 7.0]),
        "F1": np.array([1000.0, 1000.0, 2000.0]),
        "F2": np.array([1000.0, 1000.0, 1000.0]),
        "u_sat": np.array([0.0, 500.0, 1000.0]),
        "d_true": np.array([0.0, 1e-3, -2e-3]),
    }
    ideal, real = (bounds(columns, case(4), basis) for basis in (IDEAL, REAL))
    assert astuple(ideal) == pytest.approx((2e-3, 3.0, 0.3, 5.5))
    # 500 N missing at the second sample are 0.05 m/s² of 1e4 kg
    assert astuple(real) == pytest.approx((0.049, 49.0, 0.3, 5.5))
