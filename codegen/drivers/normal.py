"""Standard normals of random words, as in normal.h: its polynomials, and the same bits in NumPy."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.drivers.philox import Words

Floats = NDArray[np.float64]

LOG = (1.9999999986213474, 6.6666815949821470e-01, 3.9974795006431870e-01, 2.9925649122495724e-01)
"""log((1 + s)/(1 - s))/s over s^2, for arguments of the logarithm between sqrt(1/2) and sqrt(2)."""

TAIL = 0x7F900000
"""Magnitude of signed words from which on `TAILS` is used: for 1 draw in 293."""

CENTRE = (
    *(1.2533141303040372, 0.3281170881245642, 0.016332262983788752, -0.003301193349208504, -0.00018028624288017863),
    *(6.302471321267938e-05, 5.6331555878013995e-06, -2.795139602580823e-06, 3.125844847643571e-07),
    *(-1.2432381782197986e-08,),
)
"""The normal over x, a polynomial of least error in w = -log(1 - x^2), from 0 to 5."""

TAILS = (
    *(-7.560922126143625, 29.813978109771167, -44.34506794673468, 39.027651395029594, -22.046017138532303),
    *(8.495753194771504, -2.294476156049602, 0.4360383556114283, -0.05728624181494831, 0.004963347895352557),
    *(-0.0002554964778237897, 5.923381414322035e-06),
)
"""The same in sqrt(w), from 2.233 to 4.64, where the last word lies."""

LN_2, HALF_ROOT_BITS = 6.93147180559945309417e-01, np.uint64(0x3FE6A09E667F3BCD)
ONE_BITS, EXPONENT_BITS = np.uint64(0x3FF0000000000000), np.uint64(0xFFF0000000000000)


def uniforms(drawn: Words) -> Floats:
    """Uniform in (-1, 1), one of each word; the bits of ``uniform`` in C."""
    return (drawn.astype(np.uint32).view(np.int32).astype(np.float64) + 0.5) * 2.0**-31


def normals(drawn: Words) -> Floats:
    """Standard normals, one of each word; the bits of ``draw_normals`` in C."""
    x = uniforms(drawn)
    w = -_log((1.0 - x) * (1.0 + x))
    values = x * _polynomial(CENTRE, w)
    tails = (drawn >= TAIL) & (drawn < 2**32 - TAIL)
    values[tails] = x[tails] * _polynomial(TAILS, np.sqrt(w[tails]))
    return values


def _log(y: Floats) -> Floats:
    bits = y.view(np.uint64)
    biased = bits - HALF_ROOT_BITS + ONE_BITS
    n = (biased >> np.uint64(52)).astype(float) - 1023.0
    m = (bits - (biased & EXPONENT_BITS) + ONE_BITS).view(np.float64)
    s = (m - 1.0) / (m + 1.0)
    return n * LN_2 + s * _polynomial(LOG, s * s)


def _polynomial(coefficients: Sequence[float], x: Floats) -> Floats:
    """Even and odd powers apart, so that they need not wait for each other in C."""
    q, parts = x * x, []
    for terms in (coefficients[::2], coefficients[1::2]):
        total = np.full_like(x, terms[-1])
        for term in terms[-2::-1]:
            total = total * q + term
        parts.append(total)
    return parts[0] + x * parts[1]


def normal_source() -> str:
    """The polynomials in C, for normal.h."""
    polynomials = {"log": LOG, "centre": CENTRE, "tail": TAILS}
    return f"#define TAIL UINT32_C({TAIL:#x})\n" + "".join(_polynomial_source(*pair) for pair in polynomials.items())


def _polynomial_source(name: str, coefficients: Sequence[float]) -> str:
    lines = [f"static inline double {name}_polynomial(double x) {{", "  double q = x * x;"]
    for part, terms in (("even", coefficients[::2]), ("odd", coefficients[1::2])):
        lines.append(f"  double {part} = {terms[-1]!r};")
        lines += [f"  {part} = {part} * q + {term!r};" for term in terms[-2::-1]]
    return "\n".join([*lines, "  return even + x * odd;", "}", ""])
