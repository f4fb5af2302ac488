"""The random words of philox.h in NumPy: the same bits without a compiler."""

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint64]

BLOCK = 4
"""Words of a block."""

WORD = np.uint64(0xFFFFFFFF)
MULTIPLIERS = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
KEY_STEPS = 0x9E3779B9, 0xBB67AE85
ROUNDS = 10


def philox(counter: tuple[Words, Words, Words, Words], key: tuple[int, int]) -> tuple[Words, Words, Words, Words]:
    """Blocks of Philox4x32-10, four words for each counter.

    Args:
        counter: its four words of 32 bits, arrays of one shape; lowest first.
        key: its two words of 32 bits, lowest first.

    Source: Salmon, Moraes, Dror, Shaw: "Parallel random numbers: as easy as 1, 2, 3", SC 2011.
    """
    a, b, c, d = counter
    half = np.uint64(32)
    for turn in range(ROUNDS):
        keys = [np.uint64((word + turn * step) % 2**32) for word, step in zip(key, KEY_STEPS, strict=True)]
        p, q = a * MULTIPLIERS[0], c * MULTIPLIERS[1]
        a, b, c, d = (q >> half) ^ b ^ keys[0], q & WORD, (p >> half) ^ d ^ keys[1], p & WORD
    return a, b, c, d


def blocks(seed: int, stream: int, first: int, count: int) -> Words:
    """Blocks of a stream, (count, 4): those from block `first` on.

    Args:
        seed: the key, below 2^64.
        stream: higher half of the counter, below 2^64; the lower one is the number of the block.
        first: number of a block.
        count: how many.
    """
    numbers = np.arange(first, first + count, dtype=np.uint64)
    low, high = (np.full_like(numbers, part) for part in (stream % 2**32, stream >> 32))
    drawn = philox((numbers & WORD, numbers >> np.uint64(32), low, high), (seed % 2**32, seed >> 32))
    return np.stack(drawn, axis=-1)


def words(seed: int, stream: int, first: int, samples: int) -> Words:
    """Words of 32 bits, one a sample, (samples,): those of a stream from the sample `first` on.

    Sample k is word k % 4 of block k // 4.
    """
    start, end = first // BLOCK, -(-(first + samples) // BLOCK)
    return blocks(seed, stream, start, end - start).ravel()[first - start * BLOCK :][:samples]
