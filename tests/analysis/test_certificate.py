"""Certificates of whole runs: V against the independent implementation, verdicts, and the search for gains."""

import numpy as np
import pytest

from dualwinch import plots
from dualwinch.analysis.stability import REAL, Certificate, certify, nearby_gains
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from tests.oracle.sampled import Scenario, run

SATISFYING = {
    "controller.nftsm.k": 1.0,
    "controller.observer.l0": 200.0,
    "controller.auxiliary.gamma": 12000.0,
    "controller.auxiliary.gamma_force": 12000.0,
}


@pytest.fixture(scope="module")
def case_4() -> Certificate:
    return certify(case(4))


@pytest.fixture(scope="module")
def case_3() -> Certificate:
    return certify(override(case(3), {"simulation.duration": 3.0}))


def test_v_along_a_run_is_that_of_the_independent_implementation(case_3: Certificate) -> None:
    """Case 3 from its hard start, where every term of V counts; d is the vortex force over the mass."""
    seen = run(Scenario("fando-nftsm", 3), 3000)
    v, t = seen["v"], seen["t"]
    vortex = 0.2 * 0.5 * 0.3 * 1000 * 6 * v * np.abs(v) * np.sin(2 * np.pi * 0.2 * v / 2 * t)
    d_tilde = vortex / 1e4 - seen["d_hat"]
    by_hand = seen["s"] ** 2 / 2 + seen["Z_a"] ** 2 / 2
    by_hand += 1e4 / (2 * seen["L1"]) * d_tilde**2 + (seen["L1"] - 5) ** 2 / (2 * 5)
    assert case_3.terms.total == pytest.approx(by_hand, rel=1e-4)
    rates = np.diff(by_hand) / 1e-3
    clear = np.abs(rates) > 1e-3 * np.abs(rates).max()
    assert clear.sum() > 1000
    assert case_3.rate[clear] == pytest.approx(rates[clear], rel=1e-2)
    assert case_3.decreasing == pytest.approx(np.mean(rates < 0), abs=1e-3)


def test_the_papers_gains_fall_short_of_the_papers_theorem(case_4: Certificate) -> None:
    failing = [condition.name for condition in case_4.conditions if not condition.holds and condition.basis != REAL]
    assert failing == ["weight of Z_a in the surface", "weight of Z_a in the force"]
    assert not case_4.certified
    assert 0.5 < case_4.decreasing < 0.7
    assert case_4.within_claim < case_4.decreasing


def test_gains_that_satisfy_every_condition_are_certified() -> None:
    found = certify(override(case(4), SATISFYING))
    assert found.certified
    assert found.certified_with_ropes
    assert nearby_gains(found).changes == {}


def test_where_the_force_is_never_cut_off_the_weights_of_z_a_may_be_anything(case_4: Certificate) -> None:
    near = nearby_gains(case_4)
    assert near.found
    assert set(near.changes) == {"controller.auxiliary.gamma", "controller.auxiliary.gamma_force"}
    assert np.array_equal(near.certificate.result["x"], case_4.result["x"])


def test_a_search_raises_gains_until_their_own_run_agrees() -> None:
    weak = {"controller.nftsm.k": 0.06, "controller.observer.l0": 0.05, "controller.observer.kf": 0.0}
    near = nearby_gains(certify(override(case(4), weak)))
    assert near.found
    assert {"controller.nftsm.k", "controller.observer.l0"} <= set(near.changes)
    again = certify(near.certificate.result.experiment)
    assert again.certified


def test_where_the_force_is_cut_off_no_gains_are_found_and_it_says_why(case_3: Certificate) -> None:
    """At the first sample u = 1e4 (0.03·1.5^(1/3) + 0.05·20·1.5^(5/3) + 0.5) = 25 000 N, 19 200 N beyond the limit."""
    near = nearby_gains(case_3)
    assert not near.found
    assert "the force saturates, at first by 1.92e+04 N" in near.reason
    assert all("diverged" in line for line in near.history[1:])


def test_without_an_observer_v_has_two_terms() -> None:
    found = certify(override(case(4, "nftsm"), {"simulation.duration": 1.0}))
    assert np.array_equal(found.terms.total, found.result["s"] ** 2 / 2)


def test_the_figure_shows_v_and_both_signs_of_its_rate(case_4: Certificate) -> None:
    value, rate = plots.lyapunov(case_4).axes
    assert len(value.lines) == 4  # Z_a stays zero
    largest = max(np.nanmax(np.asarray(line.get_ydata(), float)) for line in value.lines)
    assert largest == pytest.approx(case_4.terms.total.max())
    assert len(rate.lines) == 2
