import numpy as np
import pytest
from scipy import stats

from dualwinch.simulation.ensembles.ensemble import Choice, Distribution, LogUniform, Normal, Uniform

SHARES = (np.arange(20_000) + 0.5) / 20_000
"""As evenly spread as draws between 0 and 1 can be, so that moments are those of the distribution."""


def values(distribution: Distribution) -> np.ndarray:
    return np.array([distribution.quantile(share) for share in SHARES], dtype=float)


def test_uniform_has_its_moments_and_bounds() -> None:
    drawn = values(Uniform(0.18, 0.22))
    assert drawn.mean() == pytest.approx(0.2)
    assert drawn.std() == pytest.approx(0.04 / np.sqrt(12), rel=1e-6)
    assert 0.18 < drawn.min() < drawn.max() < 0.22


def test_log_uniform_has_the_moments_of_scipys_and_stays_within_its_bounds() -> None:
    drawn, scipys = LogUniform(2e-4, 8e-3), stats.loguniform(2e-4, 8e-3)
    found = values(drawn)
    assert found.mean() == pytest.approx(scipys.mean(), rel=1e-6)
    assert found.std() == pytest.approx(scipys.std(), rel=1e-6)
    assert drawn.quantile(0.0) == 2e-4
    assert max(drawn.quantile(share) for share in (0.99, 1 - 2**-53, 1.0)) <= 8e-3


@pytest.mark.parametrize(("low", "high"), [(1.0, 3.0), (1.9, 5.0), (-50.0, 50.0)])
def test_normal_has_the_moments_of_a_truncated_one(low: float, high: float) -> None:
    drawn = values(Normal(2.0, 0.5, low, high))
    mean, variance = stats.truncnorm.stats((low - 2) / 0.5, (high - 2) / 0.5, loc=2, scale=0.5, moments="mv")
    assert drawn.mean() == pytest.approx(float(mean), abs=1e-5)
    assert drawn.std() == pytest.approx(np.sqrt(variance), rel=1e-3)
    assert low <= drawn.min() < drawn.max() <= high


@pytest.mark.parametrize("share", [0.0, 1 - 2**-53])
def test_a_normal_far_out_stays_within_its_bounds(share: float) -> None:
    assert abs(Normal(0.0, 0.01, -1.0, 1.0).quantile(share)) <= 1.0


def test_a_choice_takes_each_value_equally_often() -> None:
    drawn = [Choice(("a", "b", "c", "d")).quantile(share) for share in SHARES]
    assert {name: drawn.count(name) for name in "abcd"} == dict.fromkeys("abcd", 5000)
    assert Choice((1, 2)).quantile(1.0) == 2
