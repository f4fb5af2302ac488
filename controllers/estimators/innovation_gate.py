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

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Annotated, NamedTuple

import annotated_types as at

from dualwinch.model.quantities.quantity import Mark, Positive, Quantity
from dualwinch.model.scalar import Scalar, both, clip, either, minimum, sqrt, where


@dataclass(frozen=True)
class GateGains:
    """Rejection of improbable readings of position and speed."""

    false_alarm: Annotated[
        float,
        at.Ge(0),
        at.Le(0.1),
        Quantity(
            "1", "probability that the gate rejects a sound reading of position or speed; 0: no gate", "assumption"
        ),
        Mark.SHAPES_CODE,
        Mark.GATE,
    ] = 1e-6
    hold_time: Annotated[
        Positive,
        Quantity("s", "longest time for which the gate does without the position sensor", "assumption"),
    ] = 5.0


@dataclass(frozen=True)
class GateState:
    """State of the gate of one measurement."""

    mean: Annotated[Scalar, Quantity("1", "fading mean of the innovation, in its unit"), Mark.BOOKKEEPING] = 0.0
    rejected: Annotated[Scalar, Quantity("1", "1 where the last measurement was rejected"), Mark.BOOKKEEPING] = 0.0


@dataclass(frozen=True)
class Gates:
    """States of the gates of position and speed."""

    position: GateState = field(default_factory=GateState)
    speed: GateState = field(default_factory=GateState)
    agreed: Annotated[Scalar, Quantity("s", "time for which the position may be rejected"), Mark.BOOKKEEPING] = 0.0
    followed: Annotated[
        Scalar, Quantity("m/s", "part of the wheel's innovations that the estimate followed"), Mark.BOOKKEEPING
    ] = 0.0
    wheel: Annotated[Scalar, Quantity("m/s", "fading mean of the wheel's innovation"), Mark.BOOKKEEPING] = 0.0
    rope: Annotated[Scalar, Quantity("m/s", "that of the speed by the tighter rope"), Mark.BOOKKEEPING] = 0.0
    last_1: Annotated[Scalar, Quantity("m", "position by encoder 1 in the last sample"), Mark.BOOKKEEPING] = 0.0
    last_2: Annotated[Scalar, Quantity("m", "position by encoder 2 in the last sample"), Mark.BOOKKEEPING] = 0.0


class Witness(NamedTuple):
    """An encoder that may confirm the prediction against the position sensor.

    Attributes:
        off: its position beyond the predicted one in m.
        taut: whether its rope is taut.
        spread: variance in m² of the lasting error of its position.
        pull: tension of its rope in N.
    """

    off: Scalar
    taut: Scalar
    spread: Scalar
    pull: Scalar


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
    return GateState(mean, rejected)


def position_gated(
    gates: Gates,
    innovation: Scalar,
    witnesses: Sequence[Witness],
    gains: GateGains,
    *,
    sensor: Scalar,
    encoder: Scalar,
    memory: Scalar,
    sample_time: Scalar,
) -> tuple[Gates, Scalar]:
    """The gates after a reading of the position sensor, and whether the prediction is confirmed.

    A position is rejected only while both encoders confirm the prediction: two of three that measure the same are
    right. As positions calibrate the encoders, one is rejected no longer than they agreed with the prediction before,
    and for at most `GateGains.hold_time`: a start in a wrong position is no fault of the sensor.

    Args:
        gates: before the reading.
        innovation: of the reading in m; 0 without a reading.
        witnesses: the encoders.
        gains: of the gates.
        sensor: variance in m² of the position sensor's noise.
        encoder: that of an encoder's.
        memory: weight of a sample in the fading mean.
        sample_time: in s.
    """
    confirmed, spread = 1.0, 0.0
    for witness in witnesses:
        agrees = 1 - is_improbable(witness.off, encoder + witness.spread, gains.false_alarm)
        confirmed, spread = confirmed * both(witness.taut, agrees), spread + witness.spread / len(witnesses)
    variance = sensor + encoder + spread
    gate = gated(
        gates.position,
        innovation,
        used=variance,
        unused=variance,
        lasting=spread,
        memory=memory,
        false_alarm=gains.false_alarm,
    )
    rejected = both(both(confirmed, gate.rejected), gates.agreed > 0)
    agreed = where(
        rejected,
        gates.agreed - sample_time,
        where(gate.rejected, 0.0, minimum(gates.agreed + sample_time, gains.hold_time)),
    )
    is_believed = both(gate.rejected, 1 - rejected)
    following = replace(gates, position=replace(gate, rejected=rejected), agreed=agreed)
    return following, both(confirmed, 1 - is_believed)
