import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.simulation.exogenous.first_words import MOST, first_words
from dualwinch.simulation.exogenous.streams import stream

NAMES = ("plant.vehicle.mass", "together: ropes", "simulation.seed")


@given(
    seed=st.one_of(st.integers(0, 2**53), st.integers(0, 2**200)),
    numbers=st.lists(st.integers(0, MOST), min_size=1, max_size=4),
)
def test_words_are_those_of_numpys_generators(seed: int, numbers: list[int]) -> None:
    words = first_words(seed, numbers, NAMES)
    assert words.shape == (len(NAMES), len(numbers))
    for name, row in zip(NAMES, words, strict=True):
        for number, word in zip(numbers, row.tolist(), strict=True):
            assert word == stream(seed, number, name).bit_generator.random_raw()
            assert (word >> 11) * 2.0**-53 == stream(seed, number, name).random()
            assert word >> 11 == stream(seed, number, name).integers(2**53)


@pytest.mark.parametrize("seed", [0, 2**32 - 1, 2**32, 2**128 - 1, 2**128])
def test_seeds_of_one_word_and_of_more_than_the_pool_has(seed: int) -> None:
    assert int(first_words(seed, [0], ["a"])[0, 0]) == stream(seed, 0, "a").bit_generator.random_raw()


def test_words_are_spread_evenly() -> None:
    words = first_words(3, range(4000), NAMES) / 2.0**64
    assert np.abs(words.mean(axis=1) - 0.5).max() < 4 / np.sqrt(12 * 4000)
    assert np.abs(np.corrcoef(words) - np.eye(len(NAMES))).max() < 4.5 / np.sqrt(4000)
