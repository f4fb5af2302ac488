"""Normals of random words: against SciPy's quantiles, and their statistics."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import welch
from scipy.special import ndtri

from dualwinch.codegen.drivers.signals.draws import IN_TAIL, normals, words

COUNT = 2_000_000


@pytest.fixture(scope="module")
def draws() -> np.ndarray:
    return normals(words(3, 5, 0, COUNT))


def quantiles(drawn: np.ndarray) -> np.ndarray:
    """The normal quantile in the middle of each word's share of all, words taken as signed numbers."""
    distance = np.abs(drawn.astype(np.uint32).view(np.int32) + 0.5)
    return -np.sign(drawn.astype(np.uint32).view(np.int32) + 0.5) * ndtri((2.0**31 - distance) * 2.0**-32)


@pytest.mark.parametrize(
    "drawn",
    [
        np.arange(100_000, dtype=np.uint64),
        2**32 - 1 - np.arange(100_000, dtype=np.uint64),
        2**31 + np.arange(-100_000, 100_000).astype(np.uint64),
        2**31 - IN_TAIL + np.arange(-100_000, 100_000).astype(np.uint64),
        2**31 + IN_TAIL + np.arange(-100_000, 100_000).astype(np.uint64),
        np.random.default_rng(1).integers(0, 2**32, 500_000).astype(np.uint64),
    ],
)
def test_a_normal_is_the_quantile_of_its_word(drawn: np.ndarray) -> None:
    drawn = drawn % np.uint64(2**32)
    np.testing.assert_allclose(normals(drawn), quantiles(drawn), rtol=5e-7, atol=0)


def test_normals_are_symmetric_and_never_zero() -> None:
    drawn = words(1, 1, 0, 100_000)
    assert np.array_equal(normals(2**32 - 1 - drawn), -normals(drawn))
    assert np.abs(normals(np.array([0, 2**32 - 1], np.uint64))).min() > 0


def test_the_largest_are_six_standard_deviations() -> None:
    ends = normals(np.array([2**31, 2**31 - 1], np.uint64))
    assert ends == pytest.approx([-6.3379, 6.3379], abs=1e-3)


def test_moments(draws: np.ndarray) -> None:
    """Within five standard errors."""
    for power, moment, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96), (6, 15, 10170)):
        assert np.mean(draws**power) == pytest.approx(moment, abs=5 * np.sqrt(variance / COUNT))


def test_the_distribution_is_normal(draws: np.ndarray) -> None:
    assert stats.kstest(draws, "norm").pvalue > 1e-3
    counts, _ = np.histogram(stats.norm.cdf(draws), 1000, (0, 1))
    assert stats.chisquare(counts).pvalue > 1e-3


def test_the_moments_of_all_words_are_those_of_a_normal() -> None:
    """Of every 4099th word, against exact quantiles of the same words: what single precision changes."""
    every = np.arange(0, 2**32, 4099, dtype=np.uint64)
    ours, exact = normals(every), quantiles(every)
    for power in (1, 2, 3, 4, 6):
        assert np.mean(ours**power) == pytest.approx(np.mean(exact**power), rel=2e-7, abs=1e-8)
    assert np.abs(stats.norm.cdf(ours) - stats.norm.cdf(exact)).max() < 1e-7


@pytest.mark.parametrize("beyond", [2.0, 3.0, 4.0])
def test_tails(beyond: float, draws: np.ndarray) -> None:
    for side in (draws > beyond, draws < -beyond):
        expected = COUNT * stats.norm.sf(beyond)
        assert np.sum(side) == pytest.approx(expected, abs=5 * float(expected) ** 0.5)


def test_samples_are_not_correlated(draws: np.ndarray) -> None:
    for lag in (1, 2, 3, 4, 15, 16, 17, 32, 48, 63, 64, 65, 128):
        for before, after in ((draws[:-lag], draws[lag:]), (draws[:-lag] ** 2 - 1, draws[lag:] ** 2 - 1)):
            assert np.mean(before * after) == pytest.approx(0, abs=5 * float(np.var(before)) / COUNT**0.5)


def test_the_spectrum_is_flat(draws: np.ndarray) -> None:
    _, power = welch(draws, nperseg=512)
    segments = 2 * COUNT / 512 * 0.53  # half-overlapping Hann windows
    assert power[2:-1] / 2 == pytest.approx(np.ones(254), abs=6 / segments**0.5)


def test_streams_are_independent_of_each_other() -> None:
    names = [(seed, stream) for seed in (0, 1, 2**32, 2**63) for stream in (0, 1, 2**32, 2**63)]
    drawn = np.array([normals(words(*name, 0, 20_000)) for name in names])
    for signals in (drawn, drawn**2, np.abs(drawn)):
        correlations = np.corrcoef(signals) - np.eye(len(names))
        assert np.abs(correlations).max() < 5 / np.sqrt(20_000)
