"""Fuzzy logic system that raises the observer's gain when its error is large or changes fast (A8).

Two inputs in [−1, 1], five triangular labels each (a partition of unity), product inference, zero-order Sugeno.
"""

from model.scalar import Scalar, absolute, clip, maximum

CENTRES = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Centres of the labels NB, NS, ZO, PS, PB."""

RULES = (
    (1.0, 1.0, 1.0, 1.0, 1.0),
    (0.75, 0.5, 0.5, 0.5, 0.75),
    (0.5, 0.25, 0.0, 0.25, 0.5),
    (0.75, 0.5, 0.5, 0.5, 0.75),
    (1.0, 1.0, 1.0, 1.0, 1.0),
)
"""Singletons; row = label of the error, column = label of its rate (A8)."""


def memberships(value: Scalar) -> list[Scalar]:
    """Degrees of the five labels for an input, which is clipped to [−1, 1]; they sum to one."""
    clipped = clip(value, -1.0, 1.0)
    return [maximum(0.0, 1.0 - 2.0 * absolute(clipped - centre)) for centre in CENTRES]


def inference(error: Scalar, rate: Scalar) -> Scalar:
    """FLS(error, rate) in [0, 1]; both inputs are scaled, without unit (paper Section 3.1.3, A8)."""
    of_rate = memberships(rate)
    rows = [sum(rule * degree for rule, degree in zip(row, of_rate, strict=True)) for row in RULES]
    return sum(degree * row for degree, row in zip(memberships(error), rows, strict=True))
