"""Random words by Philox, and standard normals from them, in NumPy, with the bits of philox.h and normal.h."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint64]
Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Integers = NDArray[np.int32]

BLOCK = 4
"""Words of a block."""

WORD = np.uint64(0xFFFFFFFF)
MULTIPLIERS = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
KEY_STEPS = 0x9E3779B9, 0xBB67AE85
PHILOX_ROUNDS = 10


def philox(
    counter: tuple[Words, Words, Words, Words], key: tuple[int | Words, int | Words]
) -> tuple[Words, Words, Words, Words]:
    """Blocks of Philox4x32-10, four words for each counter.

    Args:
        counter: four words of 32 bits, arrays of one shape; lowest first.
        key: two words of 32 bits, lowest first, numbers or arrays of that shape.

    Source: Salmon, Moraes, Dror, Shaw: "Parallel random numbers: as easy as 1, 2, 3", SC 2011.
    """
    a, b, c, d = counter
    half = np.uint64(32)
    for turn in range(PHILOX_ROUNDS):
        keys = [(np.uint64(word) + np.uint64(turn * step)) & WORD for word, step in zip(key, KEY_STEPS, strict=True)]
        p, q = a * MULTIPLIERS[0], c * MULTIPLIERS[1]
        a, b, c, d = (q >> half) ^ b ^ keys[0], q & WORD, (p >> half) ^ d ^ keys[1], p & WORD
    return a, b, c, d


def blocks(seed: int, stream: int, first: int, count: int) -> Words:
    """Blocks of a stream, (count, 4), from block `first` on.

    Args:
        seed: the key, below 2^64.
        stream: higher half of the counter, below 2^64; the lower half is the number of the block.
        first: number of the first block.
        count: number of blocks.
    """
    numbers = np.arange(first, first + count, dtype=np.uint64)
    low, high = (np.full_like(numbers, part) for part in (stream % 2**32, stream >> 32))
    words = philox((numbers & WORD, numbers >> np.uint64(32), low, high), (seed % 2**32, seed >> 32))
    return np.stack(words, axis=-1)


def words(seed: int, stream: int, first: int, samples: int) -> Words:
    """Words of 32 bits, one per sample, (samples,), of a stream from sample `first` on.

    Sample k is word k % 4 of block k // 4.
    """
    start, end = first // BLOCK, -(-(first + samples) // BLOCK)
    return blocks(seed, stream, start, end - start).ravel()[first - start * BLOCK :][:samples]


LOG = 1.0, -0.50000365, 0.33335059, -0.24969909, 0.19900164, -0.17250833, 0.16222596, -0.10106905
"""log(1 + f)/f, for arguments of the logarithm between sqrt(1/2) and sqrt(2)."""

CENTRE = (
    *(2.6287105, 0.3229417, -0.010211866, -0.000287669, 0.00016799163, -2.2237188e-05, 7.115692e-07),
    *(2.966972e-07, -4.949059e-08, -6.9319605e-10, 5.538613e-10),
)
"""The normal over x: minimax polynomial in w - 4 with w = -log(1 - x^2), from 0 to 8."""

TAIL = (
    *(5.073497, 1.4264868, 0.0029138303, -0.0018335806, 0.00071712016, -0.00033072532, 0.0003326637),
    *(-0.00018842452,),
)
"""The same in sqrt(w) - 3.75, from w = 8 to 21.5, the value of the last word."""

CENTRE_MIDDLE, TAIL_MIDDLE, LN_2 = 4.0, 3.75, 0.6931472

IN_TAIL = 0x58000
"""Number of outermost words of either sign that belong to the tails: 1 draw in 5958."""

HALF_ROOT_BITS, MAGNITUDE, SIGN = np.uint32(0x3F3504F3), np.int32(0x7FFFFFFF), np.uint32(0x80000000)


def uniforms(drawn: Words) -> Floats:
    """Uniform in [-1, 1], one from each word, with the bits of ``uniform`` in C."""
    return _with_sign(_share(_inner(drawn)), drawn)


def normals(drawn: Words) -> Floats:
    """Standard normals, one from each word, with the bits of ``draw_normals`` in C."""
    outer = _inner(drawn) ^ MAGNITUDE
    x, w = _share(_inner(drawn)), _depth(_share(outer))
    magnitudes = x * _polynomial(CENTRE, w - np.float32(CENTRE_MIDDLE))
    tails = outer < IN_TAIL
    magnitudes[tails] = x[tails] * _polynomial(TAIL, np.sqrt(w[tails]) - np.float32(TAIL_MIDDLE))
    return _with_sign(magnitudes, drawn)


def _inner(drawn: Words) -> Integers:
    signed = drawn.astype(np.uint32).view(np.int32)
    return signed ^ (signed >> 31)


def _share(count: Integers) -> Singles:
    return (count.astype(np.float32) + np.float32(0.5)) * np.float32(2.0**-31)


def _with_sign(magnitudes: Singles, drawn: Words) -> Floats:
    return (magnitudes.view(np.uint32) | (drawn.astype(np.uint32) & SIGN)).view(np.float32).astype(np.float64)


def _depth(t: Singles) -> Singles:
    y = t * (np.float32(2.0) - t)
    n = (y.view(np.uint32) - HALF_ROOT_BITS).view(np.int32) >> 23
    f: Singles = (y.view(np.uint32) - (n << 23).view(np.uint32)).view(np.float32) - np.float32(1.0)
    log = f * _polynomial(LOG, f)
    log += n.astype(np.float32) * np.float32(LN_2)
    return -log


def _polynomial(coefficients: Sequence[float], x: Singles) -> Singles:
    """A polynomial with separate even and odd powers, which C can compute in parallel."""
    q, parts = x * x, []
    for terms in (coefficients[::2], coefficients[1::2]):
        total = np.full_like(x, terms[-1])
        for term in terms[-2::-1]:
            total = total * q + np.float32(term)
        parts.append(total)
    return parts[0] + x * parts[1]


def normal_source() -> str:
    """The polynomials in C, for normal.h."""
    numbers = {"LN_2F": LN_2, "CENTRE_MIDDLE": CENTRE_MIDDLE, "TAIL_MIDDLE": TAIL_MIDDLE}
    lines = [*(f"#define {name} {number!r}f" for name, number in numbers.items()), f"#define IN_TAIL {IN_TAIL:#x}\n"]
    for name, coefficients in (("log", LOG), ("centre", CENTRE), ("tail", TAIL)):
        lines += [f"static inline float {name}_polynomial(float x) {{", "  const float q = x * x;"]
        for part, terms in (("even", coefficients[::2]), ("odd", coefficients[1::2])):
            lines.append(f"  float {part} = {terms[-1]!r}f;")
            lines += [f"  {part} = {part} * q + {term!r}f;" for term in terms[-2::-1]]
        lines += ["  return even + x * odd;", "}"]
    return "\n".join([*lines, ""])
