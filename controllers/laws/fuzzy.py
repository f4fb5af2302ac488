"""Fuzzy logic system that raises the observer's gain when its error is large or changes fast (A8).

Two inputs in [−1, 1], five triangular labels each (a partition of unity), product inference, zero-order Sugeno. The
rule base treats NB like PB and NS like PS, so that the magnitudes of the inputs with the labels ZO, PS, PB give all.
"""

from dualwinch.model.scalar import Scalar, absolute, maximum, minimum

RULES = (
    (0.0, 0.25, 0.5),
    (0.5, 0.5, 0.75),
    (1.0, 1.0, 1.0),
)
"""Singletons; row = label of the error's magnitude, column = label of its rate's: zero, small, big (A8)."""


def memberships(value: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Degrees of zero, small and big for the magnitude of an input, which is limited to 1; they sum to one."""
    twice = 2 * minimum(absolute(value), 1.0)
    return maximum(1 - twice, 0.0), minimum(twice, 2 - twice), maximum(twice - 1, 0.0)


def _mean(values: tuple[Scalar, Scalar, Scalar], degrees: tuple[Scalar, Scalar, Scalar]) -> Scalar:
    """Mean of what the labels give; the degree of zero is what those of small and big leave of one."""
    zero, small, big = values
    return zero + (small - zero) * degrees[1] + (big - zero) * degrees[2]


def inference(error: Scalar, rate: Scalar) -> Scalar:
    """FLS(error, rate) in [0, 1]; both inputs are scaled, without unit (paper Section 3.1.3, A8)."""
    of_rate = memberships(rate)
    zero, small, big = (_mean(row, of_rate) for row in RULES)
    return _mean((zero, small, big), memberships(error))
