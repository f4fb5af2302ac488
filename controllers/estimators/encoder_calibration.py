"""Online calibration of a drum's encoder against the position sensor.

A taut rope ties drum and vehicle: ``R_1 theta_1 = x + stretch_1`` and ``R_2 theta_2 = stretch_2 - x``. The position
from encoder, nominal radius and nominal rope has the error

    R theta - stretch -+ x =
        zero - scale R theta - layers theta²/(4 pi) + excess stretch + a sin theta + b (cos theta - 1)
        + give F - sag shortening +- delay speed

with the encoder's zero in m of rope, the relative errors of the drum's radius, of its growth per turn and of the rope's
compliance, and the drum's run-out, once per turn. A gearbox between encoder and drum yields a constant length per
newton; a rope that sags between rollers is shorter by w² s² length/(24 F²) (`model.heavy_ropes`), which may differ from
the nominal value. A position sensor that is later than assumed reads less by the speed times that time. These three are
left out unless a deviation is assumed for them. All are nearly constant and enter
linearly: regularised least squares (`controllers.estimators.least_squares`) estimates them from the readings of the
position sensor. Estimates are shrunk by the sensor's noise (`controllers.estimators.shrinkage`), so that a drum that
agrees with its data sheet remains unchanged, as does a zero set at rest. The excess is exempt: no rope's modulus is
known that well.

Neither sensor is trusted blindly. Outliers among the readings are rejected. If the readings deviate persistently from
the encoder's position, the encoder is suspect: its variance as a position sensor grows with the square of the excess,
so that its weight decreases smoothly, and its calibration is soon forgotten. An encoder that has jumped is calibrated
anew, and its weight returns. The encoder of a rope that slips stays suspect.

All of this takes place at every sample except the update of the estimates, which would take most of the filter's time:
the readings of `DrumGains.interval` samples, in which the machine moves by millimetres, count as one of their total
weight.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import annotated_types as at
import numpy as np

from dualwinch.controllers.estimators.innovation_gate import GateGains
from dualwinch.controllers.estimators.least_squares import Knowledge, expected, ignorance, learnt, variances
from dualwinch.controllers.estimators.shrinkage import shrunk
from dualwinch.model.matrix import dot
from dualwinch.model.quantities.quantity import Mark, NonNegative, Positive, Quantity, Tunable, vector
from dualwinch.model.quantities.tree import either_of
from dualwinch.model.scalar import Scalar, absolute, clip, cos, exp, maximum, present, sin, sqrt, where
from dualwinch.model.winch import TURN


@dataclass(frozen=True)
class DrumGains:
    """Prior standard deviations of the errors of drums, ropes and encoders, and memory of the estimates."""

    zero: Annotated[
        Positive,
        Quantity("m", "assumed standard deviation of an encoder's zero, in m of rope", "assumption"),
        Tunable(1e-4, 2e-2, standard=False),
    ] = 2e-3
    scale: Annotated[
        Positive,
        Quantity("1", "assumed standard deviation of a drum's radius, as a share", "assumption"),
        Tunable(1e-4, 2e-2, standard=False),
    ] = 2e-3
    layers: Annotated[
        Positive,
        Quantity("m", "assumed standard deviation of the growth of a drum's radius per turn", "assumption"),
        Tunable(1e-7, 1e-4, standard=False),
    ] = 5e-6
    compliance: Annotated[
        Positive,
        Quantity("1", "assumed standard deviation of a rope's compliance, as a share", "assumption"),
        Tunable(5e-3, 0.5, standard=False),
    ] = 0.06
    give: Annotated[
        NonNegative,
        Quantity("m/N", "assumed standard deviation of a winch's compliance; 0: rigid", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    sag: Annotated[
        NonNegative,
        Quantity("1", "assumed standard deviation of the sag's shortening, as a share; 0: exact", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    wheel: Annotated[
        NonNegative,
        Quantity("1", "assumed standard deviation of the speed wheel's scale; 0: exact", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    wheel_time: Annotated[
        Positive,
        Quantity("s", "time over which the speed wheel's distance is compared with the position", "assumption"),
        Tunable(0.2, 20, standard=False),
    ] = 2.0
    delay: Annotated[
        NonNegative,
        Quantity("s", "assumed standard deviation of the position sensor's delay; 0: exact", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    run_out: Annotated[
        Positive,
        Quantity("m", "assumed standard deviation of a drum's run-out, in m of rope", "assumption"),
        Tunable(1e-5, 2e-3, standard=False),
    ] = 1e-4
    tare: Annotated[
        Positive,
        Quantity("m", "assumed standard deviation of the position in which a run begins", "assumption"),
        Tunable(3e-5, 1e-2, standard=False),
    ] = 8e-5
    memory: Annotated[
        Positive,
        Quantity("s", "age at which the weight of a reading has fallen to 1/e", "assumption"),
        Tunable(5, 500, standard=False),
    ] = 15.0
    interval: Annotated[
        int,
        at.Ge(1),
        at.Le(100),
        Quantity("1", "samples between updates of the estimates", "assumption"),
        Mark.SHAPES_CODE,
        Mark.INTERVAL,
    ] = 8


@dataclass(frozen=True)
class TrustGains(GateGains):
    """Rejection of outlying readings, and detection of encoder faults."""

    gate: Annotated[
        Positive,
        Quantity("1", "standard deviations of the innovation beyond which a reading is an outlier", "assumption"),
        Tunable(3, 10, standard=False),
    ] = 5.0
    frozen_after: Annotated[
        int, at.Ge(1), Quantity("1", "samples after which an exactly repeated reading is invalid", "assumption")
    ] = 20
    position_rate: Annotated[
        NonNegative,
        Quantity(
            "1/s", "readings of the position a second, each repeated until the next; 0: one a sample", "assumption"
        ),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    jump: Annotated[
        Positive,
        Quantity("m", "innovation at which the weight of an encoder has fallen to a half", "assumption"),
        Tunable(1e-4, 1e-2, standard=False),
    ] = 1e-3
    fault_time: Annotated[
        Positive,
        Quantity("s", "time constant of the low-pass on the residual of readings and encoder", "assumption"),
        Tunable(0.05, 1, standard=False),
    ] = 0.15
    slide_time: Annotated[
        Positive,
        Quantity("s", "time constant with which a new calibration reaches the position law", "assumption"),
        Tunable(0.05, 1, standard=False),
    ] = 0.1
    relearning_time: Annotated[
        Positive, Quantity("s", "memory while the encoder is suspect", "assumption"), Tunable(0.1, 5, standard=False)
    ] = 0.3


UNSHRUNK = ("excess", "give", "sag_excess", "delay")
"""Errors exempt from shrinkage: they may be far from their nominal values."""


def learnt_names(gains: DrumGains) -> tuple[str, ...]:
    """Estimated errors of an encoder: those with an assumed deviation other than zero."""
    return tuple(deviations(gains))


@dataclass(frozen=True)
class Gathered:
    """Readings since the last update of the estimates, and the results of that update that every sample needs."""

    estimate: Annotated[Any, Quantity("1", "shrunk estimates over their prior deviations"), Mark.LEARNT]
    variance: Annotated[Scalar, Quantity("1", "variance of an expected reading over its noise's"), Mark.LEARNT] = 1e6
    weight: Annotated[Scalar, Quantity("1", "total weight of the readings"), Mark.LEARNT] = 0.0
    innovation: Annotated[Scalar, Quantity("1", "weighted sum of their innovations"), Mark.LEARNT] = 0.0
    fade: Annotated[Scalar, Quantity("1", "factor on the information of earlier readings"), Mark.LEARNT] = 1.0


@dataclass(frozen=True)
class EncoderKnowledge:
    """Estimates of the errors of one encoder, its drum and its rope."""

    errors: Knowledge
    gathered: Gathered
    tare: Annotated[Scalar, Quantity("m", "zero set at rest in a known position, in m of rope")] = 0.0
    residual: Annotated[Scalar, Quantity("1", "low-passed innovation of the readings over their deviation")] = 0.0


def unknown_errors(gains: DrumGains) -> EncoderKnowledge:
    """An encoder without readings: the prior of its errors."""
    n = len(learnt_names(gains))
    return EncoderKnowledge(ignorance(n), Gathered(np.zeros(n)))


@dataclass(frozen=True)
class Reading:
    """A reading of the position sensor.

    Attributes:
        x: position in m; any number without a reading.
        alive: whether there is a reading.
        deviation: standard deviation of its noise in m.
        weight: number of such readings that it counts as.
        trusted: whether a gate passes it; otherwise what is known fades, but nothing is learnt.
    """

    x: Scalar
    alive: Scalar
    deviation: Scalar
    weight: Scalar = 1.0
    trusted: Scalar = 1.0


@dataclass(frozen=True)
class Drum:
    """One drum with its encoder and rope at a sample.

    Attributes:
        direction: 1 where the drum retrieves rope as x grows, else -1.
        wound: rope wound up in m, from encoder and nominal radius.
        theta: angle in rad.
        stretch: stretch of the nominal rope under the measured tension, in m.
        sag: shortening of the nominal rope by its sag under that tension, in m.
        pull: that tension in N.
        taut: whether the rope is taut; a slack one has no information.
        speed: speed of the vehicle in m/s, positive where the drum retrieves rope.
    """

    direction: float
    wound: Scalar
    theta: Scalar
    stretch: Scalar
    sag: Scalar
    pull: Scalar
    taut: Scalar
    speed: Scalar = 0.0


@dataclass(frozen=True)
class EncoderPosition:
    """The vehicle's position from a calibrated encoder.

    Attributes:
        x: position in m.
        shift: its change in m by this sample's calibration.
        odds: odds against the encoder.
        used: whether the reading was accepted.
    """

    x: Scalar
    shift: Scalar
    odds: Scalar
    used: Scalar


def regressors(drum: Drum, gains: DrumGains, deviation: Scalar) -> tuple[Scalar, ...]:
    """Regressors of an encoder's errors, in assumed deviations, over the deviation of a reading (`learnt_names`)."""
    turns = drum.theta / TURN
    shapes = {
        "scale": -drum.wound,
        "layers": -TURN / 2 * turns**2,
        "zero": 1.0,
        "excess": drum.stretch,
        "give": drum.pull,
        "sag_excess": -drum.sag,
        "delay": drum.speed,
        "sine": sin(drum.theta),
        "cosine": cos(drum.theta) - 1,
    }
    return tuple(size / deviation * shapes[name] for name, size in deviations(gains).items())


def deviations(gains: DrumGains) -> dict[str, Scalar]:
    """Assumed (prior) standard deviations of the estimated errors, the most certain first, which reduces round-off."""
    assumed = {
        "scale": gains.scale,
        "layers": gains.layers,
        "zero": gains.zero,
        "excess": gains.compliance,
        "give": gains.give,
        "sag_excess": gains.sag,
        "delay": gains.delay,
        "sine": gains.run_out,
        "cosine": gains.run_out,
    }
    return {name: size for name, size in assumed.items() if present(size)}


HALF_FAULTY = 0.3
"""Excess of the low-passed residual over its plausible size, in deviations of a reading, at fault odds of 1."""


def fault_odds(residual: Scalar, variance: Scalar) -> Scalar:
    """Odds of a fault of an encoder: 0 for full trust, 1 for the trust in the position sensor.

    `residual` is low-passed, over the deviation of a reading; `variance` is that of the expected reading, over that of
    its noise.
    """
    return (maximum(absolute(residual) - sqrt(1 + variance), 0.0) / HALF_FAULTY) ** 2


def calibrate(
    known: EncoderKnowledge,
    drum: Drum,
    reading: Reading,
    gains: DrumGains,
    trusting: TrustGains,
    sample_time: Scalar,
    due: Scalar = True,
) -> tuple[EncoderKnowledge, EncoderPosition]:
    """One sample of an encoder's calibration by a reading: what is known then, and the encoder's position.

    The estimates are updated where that is `due`.
    """
    deviation, gathered = reading.deviation, known.gathered
    row = regressors(drum, gains, deviation)
    says = drum.wound - (drum.stretch - drum.sag) - known.tare
    counts = reading.alive * drum.taut
    # the fault probability of the last sample, independent of this reading
    odds = fault_odds(known.residual, 0.0)
    fault = odds / (1 + odds)
    innovation = (says - drum.direction * reading.x) / deviation - dot(row, _estimates(known.errors.estimate, row))
    bound = trusting.gate * sqrt(1 + gathered.variance)
    within = absolute(innovation) <= bound
    limited = clip(innovation, -bound, bound)
    # of a suspect encoder the gate opens: apparent outliers show the new errors
    opened = bound * (1 + odds)
    trusted = counts * reading.trusted
    weight = reading.weight * where(trusted, where(within, 1.0, fault), 0.0)
    fade = where(counts, exp(-sample_time / gains.memory) * (1 - fault * sample_time / trusting.relearning_time), 1.0)
    following = updated(
        replace(
            known,
            gathered=replace(
                gathered,
                weight=gathered.weight + weight,
                innovation=gathered.innovation + weight * clip(innovation, -opened, opened),
                fade=gathered.fade * fade,
            ),
        ),
        row,
        gains,
        due,
    )
    of_drum = _of_drum(row, gains)
    before, after = (dot(of_drum, _estimates(each.estimate, row)) for each in (gathered, following.gathered))
    share = where(trusted, sample_time / trusting.fault_time, 0.0)
    residual = known.residual + share * (limited - known.residual)
    position = EncoderPosition(
        x=drum.direction * (says - after * deviation),
        shift=-drum.direction * (after - before) * deviation,
        odds=fault_odds(residual, gathered.variance),
        used=trusted * within,
    )
    return replace(following, residual=residual), position


def drum_position(known: EncoderKnowledge, drum: Drum, gains: DrumGains, deviation: Scalar) -> Scalar:
    """The vehicle's position in m from an encoder as it is known, with readings of a deviation in m."""
    row, says = _of_drum(regressors(drum, gains, deviation), gains), drum.wound - (drum.stretch - drum.sag) - known.tare
    return drum.direction * (says - dot(row, _estimates(known.gathered.estimate, row)) * deviation)


def _of_drum(row: Sequence[Scalar], gains: DrumGains) -> list[Scalar]:
    """The regressors without that of the position sensor's delay, which is no error of the encoder."""
    return [0.0 if name == "delay" else each for name, each in zip(learnt_names(gains), row, strict=True)]


def updated(known: EncoderKnowledge, row: Sequence[Scalar], gains: DrumGains, due: Scalar) -> EncoderKnowledge:
    """The estimates updated by the gathered readings, with the regressors of the last, where that is `due`."""
    gathered = known.gathered
    expectation = expected(known.errors, row, gathered.fade)
    # the innovations are relative to the estimates before these faded
    faded = dot(row, _estimates(known.errors.estimate, row)) - expectation.value
    pull = gathered.innovation + gathered.weight * faded
    errors = learnt(known.errors, row, expectation, pull, gathered.weight, gathered.fade)
    following = Gathered(_shrunk(errors, gains), expectation.variance / (1 + gathered.weight * expectation.variance))
    return replace(known, errors=either_of(due, errors, known.errors), gathered=either_of(due, following, gathered))


def _shrunk(errors: Knowledge, gains: DrumGains) -> Any:
    """Vector of the shrunk estimates."""
    names = learnt_names(gains)
    return vector(shrunk(errors, len(names), [names.index(name) for name in UNSHRUNK if name in names]))


def _estimates(estimate: Any, row: Sequence[Scalar]) -> list[Scalar]:
    """The elements of a vector of estimates, one for each regressor."""
    return [estimate[i] for i in range(len(row))]


def tared(known: EncoderKnowledge, drum: Drum, x: Scalar, gains: DrumGains, resting: Scalar) -> EncoderKnowledge:
    """The estimates of an encoder with its zero set at rest in a known position.

    Later estimates of the zero are relative to it. The next sample fixes it with the deviation `DrumGains.tare`, as the
    position sensor may disagree on the position at rest. A zero within this deviation, or that a somewhat softer rope
    explains, is taken as 0.
    """
    zero = drum.wound - (drum.stretch - drum.sag) - drum.direction * x
    none = gains.tare + 2 * (gains.compliance * drum.stretch + gains.give * drum.pull + gains.sag * drum.sag)
    return replace(known, tare=where(resting, where(absolute(zero) > none, zero, 0.0), known.tare))


INFORMED = 1e12
"""Information on every error of an encoder, in units of the prior's, that makes further readings insignificant."""


def informed_errors(
    known: EncoderKnowledge, drum: Drum, true: Mapping[str, Scalar], reading: Reading, gains: DrumGains
) -> EncoderKnowledge:
    """What is known of an encoder whose errors have their true values.

    These are given by name, and a missing one is 0. The zero is not given: it explains the rest of the reading, which
    is without noise, with the encoder's tare as it is `known`.
    """
    names, row = learnt_names(gains), regressors(drum, gains, reading.deviation)
    estimate = {name: true.get(name, 0.0) / size for name, size in deviations(gains).items()}
    says = drum.wound - (drum.stretch - drum.sag) - known.tare
    explained = dot(row, [estimate[name] if name != "zero" else 0.0 for name in names])
    estimate["zero"] = ((says - drum.direction * reading.x) / reading.deviation - explained) / row[names.index("zero")]
    information = np.concatenate([np.append(np.zeros(i), INFORMED) for i in range(len(names))])
    errors = Knowledge(vector([estimate[name] for name in names]), information)
    return replace(known, errors=errors, gathered=Gathered(_shrunk(errors, gains), 0.0))


def learnt_errors(known: EncoderKnowledge, gains: DrumGains) -> dict[str, tuple[Scalar, Scalar]]:
    """Estimate and standard deviation of each of an encoder's errors, by name (`learnt_names`)."""
    sizes = deviations(gains)
    spread = variances(known.errors, len(sizes))
    return {
        name: ((known.tare if name == "zero" else 0.0) + size * known.errors.estimate[i], size * sqrt(spread[i]))
        for i, (name, size) in enumerate(sizes.items())
    }
