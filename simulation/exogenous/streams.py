"""Random streams by name: where every random signal of a run and every draw of an ensemble comes from."""

import hashlib

import numpy as np


def stream(seed: int, *name: int | str) -> np.random.Generator:
    """The random stream of a name.

    Streams of different names or seeds are independent of each other (NumPy's `SeedSequence`, with the name as its
    spawn key), so that a further one leaves the numbers of the others as they are. The same name and seed give the
    same bits.

    Args:
        seed: a whole number >= 0.
        name: one part or more, such as ``"current"``, or ``17, "plant.vehicle.mass"``: whole numbers >= 0, and words,
            which enter by their SHA-256.
    """
    parts = tuple(part if isinstance(part, int) else _number_of(part) for part in name)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=parts))


def _number_of(word: str) -> int:
    return int.from_bytes(hashlib.sha256(word.encode()).digest()[:8], "big")
