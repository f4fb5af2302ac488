"""Profile likelihoods, and where searches from several starts come to rest."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification.diagnostics import LikelihoodProfile
from dualwinch.toolboxes.identification.estimate import starts_of
from dualwinch.toolboxes.identification.identify import identify
from dualwinch.toolboxes.identification.result import IdentificationResult
from dualwinch.toolboxes.identification.unknowns import Prior, estimable_keys, unknown_parameters
from tests.simulation.batch.test_workers import Remote
from tests.toolboxes.identification.conftest import logged, machine

KEYS = ("plant.vehicle.mass", "plant.vehicle.drag_coefficient")


@pytest.fixture(scope="module")
def found() -> IdentificationResult:
    right = machine()
    nominal = override(right, {"plant.vehicle.mass": 1.1e4})
    return identify([logged(right)], KEYS, nominal, profiles=["plant.vehicle.mass"], starts=3, seed=4)


@pytest.mark.slow
def test_where_a_log_tells_enough_a_profile_is_the_parabola_of_the_deviation(found: IdentificationResult) -> None:
    (profile,) = found.profiles
    expected = ((profile.values - found.values[0]) / found.deviations[0]) ** 2
    np.testing.assert_allclose(profile.rise, expected, rtol=0.08, atol=0.05)  # drag makes it a little lopsided
    np.testing.assert_allclose(profile.interval, found.interval("plant.vehicle.mass"), rtol=2e-3)
    assert "95 % interval by its profile" in repr(found)


def test_where_it_does_not_rise_there_is_no_end() -> None:
    flat = LikelihoodProfile("a", np.array([-2.0, -1.0, 0.0, 1.0, 2.0]), np.array([16.0, 4.0, 0.0, 1.0, 1.5]))
    assert flat.interval == (pytest.approx(-np.sqrt(3.841459) / 2), np.inf)


def test_searches_from_several_starts_come_to_one_optimum(found: IdentificationResult) -> None:
    (optimum,) = found.optima
    assert optimum.searches == 3
    assert optimum.deviance == 0
    np.testing.assert_allclose(optimum.values, found.values)


@pytest.mark.slow
def test_starts_and_profiles_by_an_executor_are_the_same_bits(found: IdentificationResult) -> None:
    right, executor = machine(), Remote()
    nominal = override(right, {"plant.vehicle.mass": 1.1e4})
    profiled = {"profiles": ["plant.vehicle.mass"], "starts": 3, "seed": 4}
    there = identify([logged(right)], KEYS, nominal, workers=executor, **profiled)
    assert len(executor.sent) == 3, "two further starts and the profile"
    assert there.values.tolist() == found.values.tolist()
    assert there.covariance.tolist() == found.covariance.tolist()
    assert there.profiles[0].rise.tolist() == found.profiles[0].rise.tolist()
    assert there.optima == found.optima


def test_optima_that_differ_are_two() -> None:
    right = machine()
    one = identify([logged(right)], ["plant.vehicle.mass"], right)
    assert one.optima[0].searches == 1
    assert "optima" not in repr(one)
    two = replace(one, optima=(one.optima[0], replace(one.optima[0], values=(2e4,), deviance=12.0)))
    assert "2 distinct optima; the second is less likely, exp(-6)" in repr(two)
    assert "log-likelihood, less the best" in repr(two)


def test_starts_lie_within_what_is_known_and_what_is_possible() -> None:
    unknowns = unknown_parameters(
        estimable_keys([*KEYS], Experiment()), Experiment(), {"plant.vehicle.mass": Prior(1e4, 10.0)}
    )
    starts = np.array(starts_of(unknowns, 200, seed=1))
    np.testing.assert_array_equal(starts[0], [1e4, 0.3])
    assert starts[1:, 0].std() == pytest.approx(10, rel=0.2)
    assert starts[1:, 1].min() > 0.15 - 1e-9
    assert starts[1:, 1].max() < 0.6 + 1e-9


def test_what_is_not_fitted_has_no_profile() -> None:
    right = machine()
    with pytest.raises(ConfigurationError, match=r"--profile plant.vehicle.mass: is not fitted"):
        identify([logged(right)], ["plant.rope_1.modulus"], right, profiles=["plant.vehicle.mass"])
