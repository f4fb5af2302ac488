"""Random streams by name: where every random signal of a run and every draw of an ensemble comes from.

What is drawn once, a value of a scenario, comes from a NumPy generator of its own (`stream`). What is drawn at every
sample comes from Philox4x32-10 (`codegen/drivers/signals/philox.h`): the key is ``simulation.seed``, the counter is the
number of the sample's block beside the signal's number (`stream_number`), so that no two signals and no two seeds share
a draw, and each can be drawn without those before it.
"""

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
    parts = tuple(part if isinstance(part, int) else stream_number(part) for part in name)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=parts))


def stream_number(word: str) -> int:
    """The number of a signal's stream, of 64 bits: the first of the SHA-256 of its name, such as ``"current"``."""
    return int.from_bytes(hashlib.sha256(word.encode()).digest()[:8], "big")
