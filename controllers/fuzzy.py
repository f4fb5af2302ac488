"""Fuzzy logic system that raises the observer's gain when its error is large or changes fast (A8).

Two inputs in [−1, 1], five triangular labels each (a partition of unity), product inference, zero-order Sugeno. The
rule base treats NB like PB and NS like PS, so that the magnitudes of the inputs with the labels ZO, PS, PB give all.
"""

from model.scalar import Scalar, absolute, maximum, minimum

RULES = (
    (0.0, 0.25, 0.5),
    (0.5, 0.5, 0.75),
    (1.0, 1.0, 1.0),
)
"""Singletons; row = label of the error's magnitude, column = label of its rate's: zero, small, big (A8)."""


def memberships(value: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Degrees of zero, small and big for the magnitude of an input, which is limited to 1; they sum to one."""
    twice = 2 * minimum(absolute(value), 1.0)
    zero, big = maximum(1 - twice, 0.0), maximum(twice - 1, 0.0)
    return zero, 1 - zero - big, big


def inference(error: Scalar, rate: Scalar) -> Scalar:
    """FLS(error, rate) in [0, 1]; both inputs are scaled, without unit (paper Section 3.1.3, A8)."""
    of_rate = memberships(rate)
    rows = [sum(rule * degree for rule, degree in zip(row, of_rate, strict=True)) for row in RULES]
    return sum(degree * row for degree, row in zip(memberships(error), rows, strict=True))
