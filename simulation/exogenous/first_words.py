"""The first word of many random streams at once: the bits of `simulation.exogenous.streams.stream`, array by array.

A draw of an ensemble is the first word of a stream of its own, which NumPy's `SeedSequence` and PCG64 take ten
microseconds to set up. Here scenarios and keys are axes of arrays, and a word takes a tenth of one.

Source: O'Neill, "PCG: A Family of Simple Fast Space-Efficient Statistically Good Algorithms for Random Number
Generation", 2014, and "Developing a seed_seq Alternative", 2015, as NumPy has them.
"""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.exogenous.streams import stream_number

Words: TypeAlias = NDArray[np.uint64]

WORD = 2**32 - 1
MOST = WORD
"""Largest number of a stream that is one word."""

POOL = 4
"""Words that a name is mixed into."""

FIRST_KEY, KEY_STEP, FIRST_OUTPUT_KEY, OUTPUT_KEY_STEP = 0x43B0D7E5, 0x931E8875, 0x8B51F9DD, 0x58F38DED
MIX_LEFT, MIX_RIGHT, SHIFT = 0xCA01F9DD, 0x4973F715, 16
"""Constants of `SeedSequence`, all modulo 2^32."""

MULTIPLIER = 0x2360ED051FC65DA44385DF649FCCF645
"""Of the 128-bit congruential generator in PCG64."""


def first_words(seed: int, numbers: Sequence[int], names: Sequence[str]) -> Words:
    """The first 64 bits of ``stream(seed, number, name)`` of each, (names, numbers).

    Args:
        seed: a whole number >= 0.
        numbers: whole numbers from 0 to `MOST`.
        names: words.
    """
    streams = np.array([stream_number(name) for name in names], np.uint64)[:, np.newaxis]
    counts = np.array(numbers, np.uint64)
    return _pcg64(_states(seed, [counts, streams & np.uint64(WORD), streams >> np.uint64(32)]))


class _Hash:
    """Hashes words one after the other, each with a key of its own."""

    def __init__(self, key: int, step: int) -> None:
        self._key, self._step = key, step

    def __call__(self, words: Words) -> Words:
        mixed = words ^ np.uint64(self._key)
        self._key = self._key * self._step & WORD
        return _folded(mixed * np.uint64(self._key))


def _folded(words: Words) -> Words:
    low = words & np.uint64(WORD)
    return low ^ (low >> np.uint64(SHIFT))


def _mixed(first: Words, second: Words) -> Words:
    return _folded(first * np.uint64(MIX_LEFT) - second * np.uint64(MIX_RIGHT))


def _states(seed: int, spawned: Sequence[Words]) -> list[Words]:
    """Eight words of 32 bits by which PCG64 starts: ``SeedSequence(seed, spawn_key=...).generate_state(8)``."""
    size = max(POOL, -(-seed.bit_length() // 32))
    entropy = [*(np.array([seed >> 32 * place & WORD], np.uint64) for place in range(size)), *spawned]
    hashed = _Hash(FIRST_KEY, KEY_STEP)
    pool = [hashed(word) for word in entropy[:POOL]]
    for source in range(POOL):
        for target in range(POOL):
            if source != target:
                pool[target] = _mixed(pool[target], hashed(pool[source]))
    for word in entropy[POOL:]:
        pool = [_mixed(mixed, hashed(word)) for mixed in pool]
    hashed = _Hash(FIRST_OUTPUT_KEY, OUTPUT_KEY_STEP)
    return [hashed(pool[place % POOL]) for place in range(2 * POOL)]


def _pcg64(words: Sequence[Words]) -> Words:
    """The first word of PCG64, from the state and the increment that eight words give it."""
    halves = [low | high << np.uint64(32) for low, high in zip(words[::2], words[1::2], strict=True)]
    start, (high, low) = (halves[0], halves[1]), halves[2:]
    one = np.uint64(1)
    increment = high << one | low >> np.uint64(63), low << one | one
    state = _stepped(_sum(start, increment), increment)
    high, low = _stepped(state, increment)
    folded, turn = high ^ low, high >> np.uint64(58)
    return folded >> turn | folded << (-turn & np.uint64(63))


def _stepped(state: tuple[Words, Words], increment: tuple[Words, Words]) -> tuple[Words, Words]:
    high, low = state
    times = np.uint64(MULTIPLIER >> 64), np.uint64(MULTIPLIER & (2**64 - 1))
    product = _high_product(low, times[1]) + high * times[1] + low * times[0], low * times[1]
    return _sum(product, increment)


def _sum(first: tuple[Words, Words], second: tuple[Words, Words]) -> tuple[Words, Words]:
    low = first[1] + second[1]
    return first[0] + second[0] + (low < first[1]), low


def _high_product(first: Words, second: np.uint64) -> Words:
    """The upper 64 bits of a product of 64-bit words."""
    half, low = np.uint64(32), np.uint64(WORD)
    a, b, c, d = first >> half, first & low, second >> half, second & low
    middle = a * d + (b * d >> half)
    other = b * c + (middle & low)
    return a * c + (middle >> half) + (other >> half)
