"""What a drum's encoder gets wrong of the vehicle's position, learnt from the position sensor under way.

A taut rope ties drum and vehicle: ``R_1 theta_1 = x + stretch_1`` and ``R_2 theta_2 = stretch_2 - x``. What encoder,
nominal radius and nominal rope say of the position is wrong by

    R theta - stretch -+ x =
        zero - scale R theta - layers theta²/(4 pi) + excess stretch + a sin theta + b (cos theta - 1)
        + give F - sag shortening

with the encoder's zero in m of rope, the share by which the drum is larger than the nominal one, the growth of its
radius a turn beyond the nominal one, the share by which the rope is softer, and the drum's run-out: once a turn, for it
is not quite round or sits beside its axis. A gearbox between encoder and drum gives by a constant length a newton; a
rope that sags between rollers is shorter by w² s² length/(24 F²) (`model.heavy_ropes`), more or less than its nominal
weight and spacing say. These two are left out where nothing is believed of them. All are constants, or nearly, and
enter linearly: regularised least squares (`controllers.estimators.least_squares`) learns them from the readings of the
position sensor. What is learnt is used as far as it is more than the sensor's noise
(`controllers.estimators.shrinkage`), so that a drum that is as its data sheet
says stays so, and a zero as rest has set it. The excess is exempt: no rope's modulus is known that well.

Neither side is believed blindly. A reading far from what is expected of it teaches nothing. If the readings stay away
from what the encoder says, beyond what a reading may be wrong by, the encoder is doubted: its variance as a position
sensor grows by the square of what is beyond, so that it fades out without a bump, and what was learnt of it is soon
forgotten. An encoder that has jumped is learnt anew, and fades in again. A rope that slips stays in doubt.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import annotated_types as at

from dualwinch.controllers.estimators.least_squares import Knowledge, expected, learnt, variances
from dualwinch.controllers.estimators.shrinkage import shrunk
from dualwinch.model.matrix import dot
from dualwinch.model.quantities.quantity import Mark, NonNegative, Positive, Quantity, Tunable
from dualwinch.model.scalar import Scalar, absolute, clip, cos, exp, maximum, present, sin, sqrt, where
from dualwinch.model.winch import TURN


@dataclass(frozen=True)
class DrumGains:
    """What is believed of drums, ropes and encoders before the run, and how long a reading counts."""

    zero: Annotated[
        Positive,
        Quantity("m", "believed standard deviation of an encoder's zero, in m of rope", "assumption"),
        Tunable(1e-4, 2e-2, standard=False),
    ] = 2e-3
    scale: Annotated[
        Positive,
        Quantity("1", "believed standard deviation of a drum's radius, as a share", "assumption"),
        Tunable(1e-4, 2e-2, standard=False),
    ] = 2e-3
    layers: Annotated[
        Positive,
        Quantity("m", "believed standard deviation of the growth of a drum's radius a turn", "assumption"),
        Tunable(1e-7, 1e-4, standard=False),
    ] = 5e-6
    compliance: Annotated[
        Positive,
        Quantity("1", "believed standard deviation of a rope's compliance, as a share", "assumption"),
        Tunable(5e-3, 0.5, standard=False),
    ] = 0.06
    give: Annotated[
        NonNegative,
        Quantity("m/N", "believed standard deviation of what a winch gives under tension; 0: nothing", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    sag: Annotated[
        NonNegative,
        Quantity("1", "believed standard deviation of the sag's shortening, as a share; 0: as nominal", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    wheel: Annotated[
        NonNegative,
        Quantity("1", "believed standard deviation of the speed wheel's scale; 0: exact", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    wheel_time: Annotated[
        Positive,
        Quantity("s", "time over which the way of the speed wheel is compared with the position", "assumption"),
        Tunable(0.2, 20, standard=False),
    ] = 2.0
    run_out: Annotated[
        Positive,
        Quantity("m", "believed standard deviation of a drum's run-out, in m of rope", "assumption"),
        Tunable(1e-5, 2e-3, standard=False),
    ] = 1e-4
    tare: Annotated[
        Positive,
        Quantity("m", "believed standard deviation of the position in which a run begins", "assumption"),
        Tunable(3e-5, 1e-2, standard=False),
    ] = 8e-5
    memory: Annotated[
        Positive,
        Quantity("s", "age at which a reading counts 1/e of a fresh one", "assumption"),
        Tunable(5, 500, standard=False),
    ] = 15.0


@dataclass(frozen=True)
class TrustGains:
    """When a reading or an encoder is believed."""

    gate: Annotated[
        Positive,
        Quantity("1", "deviations from what is expected beyond which a reading is an outlier", "assumption"),
        Tunable(3, 10, standard=False),
    ] = 5.0
    frozen_after: Annotated[
        int, at.Ge(1), Quantity("1", "samples after which a reading that repeats itself exactly is none", "assumption")
    ] = 20
    jump: Annotated[
        Positive,
        Quantity("m", "an encoder's position further from what is expected counts the less, the further", "assumption"),
        Tunable(1e-4, 1e-2, standard=False),
    ] = 1e-3
    doubt_time: Annotated[
        Positive,
        Quantity("s", "time constant of the low-pass on what readings and an encoder disagree by", "assumption"),
        Tunable(0.05, 1, standard=False),
    ] = 0.15
    slide_time: Annotated[
        Positive,
        Quantity("s", "time constant with which a better calibration reaches the position law", "assumption"),
        Tunable(0.05, 1, standard=False),
    ] = 0.1
    relearning_time: Annotated[
        Positive,
        Quantity("s", "age at which a reading counts 1/e while its encoder is doubted", "assumption"),
        Tunable(0.1, 5, standard=False),
    ] = 0.3


NAMES = ("scale", "layers", "zero", "excess", "give", "sag_excess", "sine", "cosine")
"""What may be learnt of an encoder; what may be known best stands first, for round-off's sake."""

UNSHRUNK = ("excess", "give", "sag_excess")
"""Errors that may well be far from their nominal values."""


def learnt_names(gains: DrumGains) -> tuple[str, ...]:
    """What is learnt of an encoder: all of `NAMES` of which something is believed."""
    return tuple(name for name in NAMES if present(deviations(gains)[name]))


@dataclass(frozen=True)
class EncoderKnowledge:
    """What is known of one encoder, its drum and its rope."""

    errors: Knowledge
    tare: Annotated[Scalar, Quantity("m", "zero that rest in a known position has set, in m of rope")] = 0.0
    residual: Annotated[Scalar, Quantity("1", "mean of what readings were off by, over their deviation")] = 0.0


@dataclass(frozen=True)
class Reading:
    """A reading of the position sensor.

    Attributes:
        x: in m; any number where there is none.
        alive: whether there is one.
        deviation: of its noise in m.
        weight: how many such readings it counts as.
    """

    x: Scalar
    alive: Scalar
    deviation: Scalar
    weight: Scalar = 1.0


@dataclass(frozen=True)
class Drum:
    """One drum with its encoder and rope, as they are now.

    Attributes:
        direction: 1 where it winds up rope as x grows, -1 where it pays out.
        wound: rope wound up in m, as encoder and nominal radius say.
        theta: angle in rad.
        stretch: of the nominal rope under the measured tension, in m.
        sag: by how much the nominal rope is shorter between rollers under that tension, in m.
        pull: that tension in N.
        taut: whether the rope is; a slack one ties nothing.
    """

    direction: float
    wound: Scalar
    theta: Scalar
    stretch: Scalar
    sag: Scalar
    pull: Scalar
    taut: Scalar


@dataclass(frozen=True)
class EncoderPosition:
    """The vehicle's position as an encoder gives it, with all that is known of it.

    Attributes:
        x: in m.
        shift: by how much this sample's reading has moved it, in m.
        odds: against the encoder.
        used: whether the reading was believed.
    """

    x: Scalar
    shift: Scalar
    odds: Scalar
    used: Scalar


def regressors(drum: Drum, gains: DrumGains, deviation: Scalar) -> tuple[Scalar, ...]:
    """What an encoder's errors of a deviation each change, over that of a reading; in the order of `learnt_names`."""
    sizes, turns = deviations(gains), drum.theta / TURN
    shapes = {
        "scale": -drum.wound,
        "layers": -TURN / 2 * turns**2,
        "zero": 1.0,
        "excess": drum.stretch,
        "give": drum.pull,
        "sag_excess": -drum.sag,
        "sine": sin(drum.theta),
        "cosine": cos(drum.theta) - 1,
    }
    return tuple(sizes[name] / deviation * shapes[name] for name in learnt_names(gains))


def deviations(gains: DrumGains) -> dict[str, Scalar]:
    """Deviations that are believed before the run, by name."""
    return {
        "scale": gains.scale,
        "layers": gains.layers,
        "zero": gains.zero,
        "excess": gains.compliance,
        "give": gains.give,
        "sag_excess": gains.sag,
        "sine": gains.run_out,
        "cosine": gains.run_out,
    }


HALF_DOUBTED = 0.3
"""By how many deviations of a reading the smoothed residual is beyond what is believable where half the doubt is."""


def doubt_odds(residual: Scalar, variance: Scalar) -> Scalar:
    """Odds against an encoder: 0 where it is believed, 1 where it is as good as the position sensor is.

    By the smoothed residual, and by the variance of what is expected of a reading, over deviation and variance of its
    noise.
    """
    return (maximum(absolute(residual) - sqrt(1 + variance), 0.0) / HALF_DOUBTED) ** 2


def calibrate(
    known: EncoderKnowledge,
    drum: Drum,
    reading: Reading,
    gains: DrumGains,
    trusting: TrustGains,
    sample_time: Scalar,
) -> tuple[EncoderKnowledge, EncoderPosition]:
    """One sample: learn of an encoder from a reading; what is known then, and the position that the encoder gives."""
    deviation = reading.deviation
    row = regressors(drum, gains, deviation)
    says = drum.wound - (drum.stretch - drum.sag) - known.tare
    before = believed(known.errors, row, gains)
    counts = reading.alive * drum.taut
    # judged by what was known before: the doubt of the last sample
    odds = doubt_odds(known.residual, 0.0)
    doubt = odds / (1 + odds)
    fade = where(counts, exp(-sample_time / gains.memory) * (1 - doubt * sample_time / trusting.relearning_time), 1.0)
    expectation = expected(known.errors, row, fade)
    innovation = (says - drum.direction * reading.x) / deviation - expectation.value
    bound = trusting.gate * sqrt(1 + expectation.variance)
    within = absolute(innovation) <= bound
    limited = clip(innovation, -bound, bound)
    # in doubt the gate opens: what seems to be an outlier is what there is to learn
    opened = bound * (1 + odds)
    weight = reading.weight * where(counts, where(within, 1.0, doubt), 0.0)
    errors = learnt(known.errors, row, expectation, clip(innovation, -opened, opened), weight, fade)
    after = believed(errors, row, gains)
    share = where(counts, sample_time / trusting.doubt_time, 0.0)
    residual = known.residual + share * (limited - known.residual)
    following = replace(known, errors=errors, residual=residual)
    position = EncoderPosition(
        x=drum.direction * (says - after * deviation),
        shift=-drum.direction * (after - before) * deviation,
        odds=doubt_odds(following.residual, expectation.variance),
        used=counts * within,
    )
    return following, position


def believed(errors: Knowledge, row: Sequence[Scalar], gains: DrumGains) -> Scalar:
    """What an encoder is believed to be off by, over the deviation of a reading."""
    names = learnt_names(gains)
    estimate = shrunk(errors, len(names), [names.index(name) for name in UNSHRUNK if name in names])
    return dot(row, estimate)


def tared(known: EncoderKnowledge, drum: Drum, x: Scalar, gains: DrumGains, resting: Scalar) -> EncoderKnowledge:
    """What is known of an encoder, its zero set where the vehicle is known to rest.

    What is learnt of the zero from then on is by how much that was wrong. The sample that follows makes it certain, as
    far as `DrumGains.tare` says: the position sensor may have another opinion of where the vehicle rests. A zero that
    this, or a rope somewhat softer than the nominal one, may explain is none.
    """
    zero = drum.wound - (drum.stretch - drum.sag) - drum.direction * x
    none = gains.tare + 2 * (gains.compliance * drum.stretch + gains.give * drum.pull + gains.sag * drum.sag)
    return replace(known, tare=where(resting, where(absolute(zero) > none, zero, 0.0), known.tare))


def learnt_errors(known: EncoderKnowledge, gains: DrumGains) -> dict[str, tuple[Scalar, Scalar]]:
    """Estimate and standard deviation of each of an encoder's errors, by name (`learnt_names`)."""
    names, sizes = learnt_names(gains), deviations(gains)
    spread = variances(known.errors, len(names))
    return {
        name: (
            (known.tare if name == "zero" else 0.0) + sizes[name] * known.errors.estimate[i],
            sizes[name] * sqrt(variance),
        )
        for i, (name, variance) in enumerate(zip(names, spread, strict=True))
    }
