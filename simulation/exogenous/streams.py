"""Random streams by name: where every random signal of a run and every draw of an ensemble comes from.

All randomness is Philox4x32-10 (`codegen/drivers/signals/philox.h`), whose words follow from a key and a counter. The
key is a seed; the counter is a number beside the number of a name (`stream_number`):

- a random signal: the key is ``simulation.seed``, the name is the signal's, the number that of a block of samples;
- a draw of an ensemble: the key is the ensemble's seed, the name is that of what is drawn, the number the scenario's;
- a derived seed (`named_seed`): the name is what the seed is for.

So no two streams share a word, and each word is drawn without those before it.
"""

import hashlib
from collections.abc import Sequence

import numpy as np

from dualwinch.codegen.drivers.signals.philox import Words, philox
from dualwinch.model.errors import ConfigurationError

DIGITS = 53
"""Binary digits of a draw: all that a float has, and of a seed as many as every file format keeps."""

LARGEST = 2**64 - 1
"""Largest seed, and largest number in a stream."""


def stream_number(word: str) -> int:
    """The number of a name's stream, of 64 bits: the first of the SHA-256 of the name, such as ``"current"``."""
    return int.from_bytes(hashlib.sha256(word.encode()).digest()[:8], "big")


def named_words(seed: int, numbers: Sequence[int], names: Sequence[str]) -> Words:
    """Random words of `DIGITS` binary digits, one for each name and number, (names, numbers).

    Args:
        seed: a whole number from 0 to `LARGEST`.
        numbers: likewise, such as those of scenarios.
        names: what the words are for; streams of different names or seeds are independent of each other.

    Raises:
        ConfigurationError: the seed is out of its range.
    """
    if not 0 <= seed <= LARGEST:
        raise ConfigurationError(f"seed = {seed}: must be a whole number from 0 to 2^64 - 1")
    half, low = np.uint64(32), np.uint64(2**32 - 1)
    counts = np.array(numbers, np.uint64)
    streams = np.array([stream_number(name) for name in names], np.uint64)[:, np.newaxis]
    counter = counts & low, counts >> half, streams & low, streams >> half
    first, second, *_ = philox(counter, (seed % 2**32, seed >> 32))
    return (first << half | second) >> np.uint64(64 - DIGITS)


def named_seed(seed: int, name: str) -> int:
    """A seed for a purpose, such as the draws of a validation set: independent of those of other names and seeds.

    Args:
        seed: a whole number from 0 to `LARGEST`.
        name: the purpose.
    """
    return int(named_words(seed, [0], [f"seed: {name}"])[0, 0])
