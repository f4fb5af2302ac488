"""Whether arrays agree, as ``pytest.approx`` has it, which goes through long ones number by number."""

import numpy as np
from numpy.typing import ArrayLike


def close(ours: ArrayLike, theirs: ArrayLike, *, rel: float = 0.0, abs: float = 0.0) -> bool:  # noqa: A002 # as approx
    """Whether every number is within the larger of both tolerances of the expected one; NaN is within none.

    Args:
        ours: what is tested.
        theirs: what is expected; of the same shape, or one number.
        rel, abs: as of ``pytest.approx``.
    """
    ours, theirs = np.asarray(ours), np.asarray(theirs)
    assert theirs.ndim == 0 or ours.shape == theirs.shape
    return bool((np.abs(ours - theirs) <= np.maximum(rel * np.abs(theirs), abs)).all())
