"""Kalman filter that learns drums, ropes and encoder zeros under way, and weighs sensors by their consistency.

Encoders are precise and wrong: a drum that is 0.2 % larger than believed is 9 cm off at the end of the track. The
position sensor is coarse, may fall silent or give nonsense, and is right in the mean. The filter of
`controllers.estimators.kalman` has the best of both once each encoder is calibrated
(`controllers.estimators.encoder_calibration`): it lives on the encoders, in the frame of the position sensor.

- A run starts at rest at a known position: that sets the encoders' zeros. Where the position sensor has another
  opinion, it is right in the end.
- A better calibration moves the expected position along with it. It says that one was elsewhere all the time, not that
  one has moved: speed and disturbance stay as they are, and the position that the law gets changes smoothly.
- While the sensor is silent (no number, or the same for many samples) the encoders go on alone.
- Encoders that are slack or doubted are left out, smoothly. With none left the filter lives on position and speed
  sensor, with the gain that belongs to these. Both gains depend on parameters alone.
"""

from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar

from dualwinch.codegen.block import NO_READING
from dualwinch.controllers.estimators.encoder_calibration import (
    Drum,
    DrumGains,
    EncoderKnowledge,
    EncoderPosition,
    Reading,
    TrustGains,
    calibrate,
    learnt_errors,
    learnt_names,
    tared,
)
from dualwinch.controllers.estimators.kalman import (
    TAUT,
    KalmanEstimate,
    KalmanGains,
    KalmanState,
    corrected,
    kalman_gain,
)
from dualwinch.controllers.estimators.least_squares import ignorance
from dualwinch.controllers.parts import Context, Estimator, Measurement
from dualwinch.model.heavy_ropes import sag_shortening
from dualwinch.model.matrix import Matrix
from dualwinch.model.quantities.part import NO_STATE
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.reference import Setpoint
from dualwinch.model.ropes import compliance, kelvin_voigt, rope_lengths
from dualwinch.model.scalar import Scalar, absolute, both, clip, either, exp, maximum, present, where
from dualwinch.model.winch import winding


@dataclass(frozen=True)
class SensorWatch:
    """By which the position sensor is found alive or silent."""

    reading: Annotated[Scalar, Quantity("m", "last reading of the position sensor"), Mark.BOOKKEEPING] = 0.0
    repeats: Annotated[Scalar, Quantity("1", "samples since it last changed"), Mark.BOOKKEEPING] = 0.0
    started: Annotated[Scalar, Quantity("1", "1 after the first sample")] = 0.0


@dataclass(frozen=True)
class WheelKnowledge:
    """What is known of the speed wheel."""

    error: Annotated[Scalar, Quantity("1", "share by which the wheel reads too much"), Mark.LEARNT] = 0.0
    information: Annotated[Scalar, Quantity("1", "information of the samples on it"), Mark.LEARNT] = 0.0
    rolled: Annotated[Scalar, Quantity("m", "way that the wheel has rolled lately")] = 0.0
    left_behind: Annotated[Scalar, Quantity("m", "position of a while ago, smoothed"), Mark.POSITION] = 0.0


@dataclass(frozen=True)
class SelfCalibratingState:
    """State of the filter, of what is known of encoders and wheel, and of the watch on the position sensor."""

    motion: KalmanState
    encoder_1: EncoderKnowledge
    encoder_2: EncoderKnowledge
    wheel: Any
    watch: SensorWatch = field(default_factory=SensorWatch)
    pending: Annotated[Scalar, Quantity("m", "change of frame that has not reached the position law yet")] = 0.0


@dataclass(frozen=True)
class SelfCalibratingEstimate(KalmanEstimate):
    """What the filter gives, what it has learnt, and how far it trusts each sensor."""

    zero_1: Annotated[Scalar, Quantity("m", "learnt zero of encoder 1, in m of rope")] = 0.0
    zero_2: Annotated[Scalar, Quantity("m", "learnt zero of encoder 2, in m of rope")] = 0.0
    scale_1: Annotated[Scalar, Quantity("1", "learnt radius of drum 1 above the nominal one, as a share")] = 0.0
    scale_2: Annotated[Scalar, Quantity("1", "learnt radius of drum 2 above the nominal one, as a share")] = 0.0
    excess_1: Annotated[Scalar, Quantity("1", "learnt compliance of rope 1 above the nominal one, as a share")] = 0.0
    excess_2: Annotated[Scalar, Quantity("1", "learnt compliance of rope 2 above the nominal one, as a share")] = 0.0
    zero_1_sd: Annotated[Scalar, Quantity("m", "standard deviation of zero_1")] = 0.0
    zero_2_sd: Annotated[Scalar, Quantity("m", "standard deviation of zero_2")] = 0.0
    scale_1_sd: Annotated[Scalar, Quantity("1", "standard deviation of scale_1")] = 0.0
    scale_2_sd: Annotated[Scalar, Quantity("1", "standard deviation of scale_2")] = 0.0
    excess_1_sd: Annotated[Scalar, Quantity("1", "standard deviation of excess_1")] = 0.0
    excess_2_sd: Annotated[Scalar, Quantity("1", "standard deviation of excess_2")] = 0.0
    doubt_1: Annotated[Scalar, Quantity("1", "doubt of encoder 1, from 0 to 1: left out")] = 0.0
    doubt_2: Annotated[Scalar, Quantity("1", "doubt of encoder 2, from 0 to 1: left out")] = 0.0
    position_used: Annotated[Scalar, Quantity("1", "1 where the position sensor is believed")] = 1.0


@dataclass(frozen=True)
class SiteEstimate(SelfCalibratingEstimate):
    """The same where the filter also learns what winches give, sags beyond the nominal ones, or the wheel's scale."""

    give_1: Annotated[Scalar, Quantity("m/N", "learnt length that winch 1 gives a newton")] = 0.0
    give_2: Annotated[Scalar, Quantity("m/N", "learnt length that winch 2 gives a newton")] = 0.0
    sag_excess_1: Annotated[Scalar, Quantity("1", "learnt sag of rope 1 above the nominal one, as a share")] = 0.0
    sag_excess_2: Annotated[Scalar, Quantity("1", "learnt sag of rope 2 above the nominal one, as a share")] = 0.0
    give_1_sd: Annotated[Scalar, Quantity("m/N", "standard deviation of give_1")] = 0.0
    give_2_sd: Annotated[Scalar, Quantity("m/N", "standard deviation of give_2")] = 0.0
    sag_excess_1_sd: Annotated[Scalar, Quantity("1", "standard deviation of sag_excess_1")] = 0.0
    sag_excess_2_sd: Annotated[Scalar, Quantity("1", "standard deviation of sag_excess_2")] = 0.0
    wheel: Annotated[Scalar, Quantity("1", "learnt share by which the speed wheel reads too much")] = 0.0


PASSED_ON = ("scale", "zero", "excess", "give", "sag_excess")
"""What the estimate says of what was learnt of an encoder."""

FIRST = 0.5
"""`SensorWatch.started` is 0 at the first sample and 1 then; a solver for the steady state may leave round-off."""

LEAST_INFORMATION = 1e-6
"""Share of the position sensor's information that stands for none, where neither it nor an encoder says anything."""


def watched(watch: SensorWatch, reading: Scalar, expected: Scalar, frozen_after: Scalar) -> tuple[SensorWatch, Scalar]:
    """The watch after a reading in m, maybe no number, and whether the position sensor is alive.

    In the place of a reading that is none the watch keeps the expected position in m.
    """
    finite = absolute(reading) <= NO_READING
    shown = where(finite, reading, expected)
    repeats = where(shown == watch.reading, watch.repeats + 1, 0.0)
    alive = both(finite, repeats <= frozen_after)
    return SensorWatch(shown, repeats, 1.0), alive


@dataclass(frozen=True)
class Innovation:
    """What position sensor and encoders together say beyond what is expected.

    Attributes:
        shift: by how much better calibrations move the expected position, in m.
        residual: what is not expected of the position then, in m.
        lead: from 0, without encoders, to 1, with both.
    """

    shift: Scalar
    residual: Scalar
    lead: Scalar


def innovation(
    expected: Scalar,
    reading: Reading,
    drums: tuple[Drum, ...],
    positions: tuple[EncoderPosition, ...],
    gains: KalmanGains,
    trust: TrustGains,
) -> Innovation:
    """Position sensor and encoders as one measurement of the position, with the weights of their variances."""
    noise, encoder_noise = gains.position_noise, gains.encoder_noise
    sensor, both_encoders = 1 / noise**2, 2 / encoder_noise**2
    heard = where(reading.alive, sensor, 0.0)
    shares = [
        where(drum.taut, 1 / (encoder_noise**2 + noise**2 * position.odds), 0.0)
        for drum, position in zip(drums, positions, strict=True)
    ]
    encoders = sum(shares)
    total = maximum(heard + encoders, LEAST_INFORMATION * sensor)
    # an encoder that is far off has not brought the expectation here, and does not take it along
    shift = sum(
        share / total * position.shift / _distance(position.x - position.shift - expected, trust.jump)
        for share, position in zip(shares, positions, strict=True)
    )
    x, bound = expected + shift, trust.gate * noise
    residual = heard / total * clip(reading.x - x, -bound, bound)
    for share, position in zip(shares, positions, strict=True):
        residual += share / total * (position.x - x) / _distance(position.x - x, trust.jump)
    lead = encoders / (sensor + encoders) * (sensor + both_encoders) / both_encoders
    return Innovation(shift, residual, lead)


def _distance(apart: Scalar, jump: Scalar) -> Scalar:
    """1 nearby, and by how much less an encoder counts that is `apart` m from what is expected (Cauchy's weight)."""
    return 1 + (apart / jump) ** 2


def blended_gain(gains: KalmanGains, lead: Scalar, sample_time: Scalar) -> Matrix:
    """Gain of the filter between that without encoders (`lead` 0) and that with both (1)."""
    without = kalman_gain(gains, sample_time, gains.position_noise**2)
    complete = kalman_gain(gains, sample_time)
    return tuple(
        tuple(least + lead * (most - least) for least, most in zip(*rows, strict=True))
        for rows in zip(without, complete, strict=True)
    )


@dataclass(frozen=True)
class SelfCalibratingKalman(Estimator):
    """The filter, its prior of drums and ropes, and how far it trusts the sensors."""

    kalman: KalmanGains = field(default_factory=KalmanGains)
    drums: DrumGains = field(default_factory=DrumGains)
    trust: TrustGains = field(default_factory=TrustGains)

    kind: ClassVar = "self-calibrating-kalman"
    label: ClassVar = "self-calibrating Kalman filter"
    silent: ClassVar = frozenset({"x"})

    def initial_state(self) -> SelfCalibratingState:
        """At rest where a run begins, with drums, ropes and encoders as they are believed to be."""
        unknown = EncoderKnowledge(ignorance(len(learnt_names(self.drums))))
        wheel = WheelKnowledge() if present(self.drums.wheel) else NO_STATE
        return SelfCalibratingState(KalmanState(), unknown, unknown, wheel)

    def step(
        self, state: SelfCalibratingState, measurement: Measurement, setpoint: Setpoint, context: Context
    ) -> tuple[SelfCalibratingState, SelfCalibratingEstimate]:
        """One sample: learn of the encoders, then filter the motion with what is known of them."""
        gains, sample_time = self.kalman, context.sample_time
        x = state.motion.x
        watch, alive = watched(state.watch, measurement.x, x, self.trust.frozen_after)
        reading = Reading(watch.reading, alive, gains.position_noise)
        drums, resting = _drums(measurement, x, context), state.watch.started < FIRST
        encoder_1, position_1 = self._calibrated(state.encoder_1, drums[0], x, reading, resting, sample_time)
        encoder_2, position_2 = self._calibrated(state.encoder_2, drums[1], x, reading, resting, sample_time)
        found = innovation(x, reading, drums, (position_1, position_2), gains, self.trust)
        wheel, speed = self._rolled(state.wheel, measurement.v, x, sample_time)
        motion, estimate = corrected(
            replace(state.motion, x=x + found.shift),
            measurement,
            (found.residual, speed - state.motion.v),
            blended_gain(gains, found.lead, sample_time),
            gains,
            context.nominal,
            sample_time,
        )
        pending = (state.pending + found.shift) * (1 - sample_time / self.trust.slide_time)
        following = SelfCalibratingState(motion, encoder_1, encoder_2, wheel, watch, pending)
        passed_on = estimate.x_est - pending
        learnt = self._learnt((encoder_1, encoder_2), (position_1, position_2))
        learnt |= {"wheel": wheel.error} if isinstance(wheel, WheelKnowledge) else {}
        drums = self.drums
        estimated = SiteEstimate if any(map(present, (drums.give, drums.sag, drums.wheel))) else SelfCalibratingEstimate
        return following, estimated(**vars(estimate) | {"x": passed_on, "x_est": passed_on} | learnt)

    def _rolled(self, known: Any, reading: Scalar, x: Scalar, sample_time: Scalar) -> tuple[Any, Scalar]:
        """What is known of the wheel after its reading, and the speed in m/s that it then stands for.

        The way that it has rolled lately, against that of the position x in m as it is expected, which the encoders
        know well: both high-passed alike. Recursive least squares of one constant.
        """
        if not isinstance(known, WheelKnowledge):
            return known, reading
        share = sample_time / self.drums.wheel_time
        way, rolled = x - known.left_behind, (1 - share) * known.rolled + sample_time * reading
        weight = share * way / self.kalman.position_noise**2
        information = exp(-sample_time / self.drums.memory) * known.information + weight * way
        innovation = rolled - (1 + known.error) * way
        error = known.error + weight * innovation / (information + 1 / self.drums.wheel**2)
        return WheelKnowledge(error, information, rolled, known.left_behind + share * way), reading / (1 + error)

    def _calibrated(
        self, known: EncoderKnowledge, drum: Drum, x: Scalar, reading: Reading, resting: Scalar, sample_time: Scalar
    ) -> tuple[EncoderKnowledge, EncoderPosition]:
        known = tared(known, drum, x, self.drums, resting)
        # rest in a known position counts as much as many readings; it sets the encoder, not the expected position
        weight = where(resting, (reading.deviation / self.drums.tare) ** 2, 1.0)
        seen = Reading(where(resting, x, reading.x), either(resting, reading.alive), reading.deviation, weight)
        known, position = calibrate(known, drum, seen, self.drums, self.trust, sample_time)
        return known, replace(position, shift=where(resting, 0.0, position.shift))

    def _learnt(
        self, knowledge: tuple[EncoderKnowledge, ...], positions: tuple[EncoderPosition, ...]
    ) -> dict[str, Scalar]:
        found: dict[str, Scalar] = {"position_used": either(positions[0].used, positions[1].used)}
        for number, (known, position) in enumerate(zip(knowledge, positions, strict=True), start=1):
            for name, (value, spread) in learnt_errors(known, self.drums).items():
                if name in PASSED_ON:
                    found |= {f"{name}_{number}": value, f"{name}_{number}_sd": spread}
            found[f"doubt_{number}"] = position.odds / (1 + position.odds)
        return found


def _drums(measurement: Measurement, x: Scalar, context: Context) -> tuple[Drum, Drum]:
    """Both drums as this sample's measurement and nominal values show them, with the vehicle at about x in m."""
    found, taut = [], TAUT * context.limits.tension_min
    measured = (measurement.F1, measurement.theta_1), (measurement.F2, measurement.theta_2)
    lengths = rope_lengths(x, context.nominal.track)
    for side, length, (F, theta) in zip(context.nominal.sides, lengths, measured, strict=True):
        stretch = F * compliance(length, kelvin_voigt(side.rope))
        sag = sag_shortening(side.rope, F, length, context.nominal.track)
        found.append(Drum(side.direction, winding(theta, side.winch).rope, theta, stretch, sag, F, taut < F))
    return found[0], found[1]
