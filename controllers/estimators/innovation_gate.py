"""Innovation gate: a measurement that the filter's prediction makes improbable is not used.

The square of an innovation over its variance has a chi-square distribution of one degree of freedom (normalised
innovation squared; Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001,
Section 5.4). Given the probability of a false alarm of a measurement:

1. An innovation beyond the distribution's quantile is rejected.
2. So is one whose fading-memory mean is beyond the quantile of the mean, whose variance is lambda/(2 - lambda) times
   that of a white innovation (Roberts, *Technometrics* 1, 1959): a lasting fault too small for the first test. The
   memory lambda is the filter's own gain, as after 1/lambda samples it has followed the fault and no innovation shows
   it.
3. A rejected measurement has no part in the estimate, which coasts on the others, and what the estimate followed of
   it within the memory is taken back. The first test then takes the variance of the coasting filter's innovation.
4. It is used again once it passes both, and therefore without a jump. Innovations enter the mean up to the quantile, so
   that it falls below its own within a few memories.
"""

from dataclasses import dataclass
from statistics import NormalDist
from typing import Annotated

from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.scalar import Scalar, clip, either, sqrt, where


@dataclass(frozen=True)
class GateState:
    """State of the gate of one measurement."""

    mean: Annotated[Scalar, Quantity("1", "fading mean of the innovation, in its unit"), Mark.BOOKKEEPING] = 0.0
    followed: Annotated[Scalar, Quantity("1", "the part of it that the estimate followed"), Mark.BOOKKEEPING] = 0.0
    rejected: Annotated[Scalar, Quantity("1", "1 where the last measurement was rejected"), Mark.BOOKKEEPING] = 0.0


def chi_square_quantile(false_alarm: float) -> float:
    """Square of a standard normal number that is exceeded with a probability: 1 degree of freedom.

    >>> round(chi_square_quantile(0.05), 3)
    3.841
    """
    return NormalDist().inv_cdf(false_alarm / 2) ** 2


def is_improbable(innovation: Scalar, variance: Scalar, false_alarm: float) -> Scalar:
    """Whether an innovation of a variance is beyond the quantile of a false alarm's probability."""
    return innovation**2 > chi_square_quantile(false_alarm) * variance


def gated(
    state: GateState,
    innovation: Scalar,
    *,
    used: Scalar,
    unused: Scalar,
    lasting: Scalar,
    memory: Scalar,
    false_alarm: float,
) -> GateState:
    """The gate after the innovation of a sample.

    Args:
        state: of the gate before.
        innovation: of the measurement.
        used: variance of the innovation while the measurement is used.
        unused: the same while it is not.
        lasting: the part of either that is no white noise, and that the filter does not follow within the memory.
        memory: weight of a sample in the fading mean.
        false_alarm: probability of a false alarm.
    """
    variance = where(state.rejected > 0, unused, used)
    bound = sqrt(chi_square_quantile(false_alarm) * variance)
    mean = state.mean + memory * (clip(innovation, -bound, bound) - state.mean)
    of_mean = memory / (2 - memory) * used + lasting
    rejected = either(is_improbable(innovation, variance, false_alarm), is_improbable(mean, of_mean, false_alarm))
    followed = state.followed + memory * (innovation - state.followed)
    return GateState(mean, where(rejected, 0.0, followed), rejected)
