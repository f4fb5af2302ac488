"""Kalman filter with online calibration of drums, ropes and encoder zeros, and weights by the sensors' consistency.

Encoders are precise but biased: a drum 0.2 % larger than nominal is an error of 9 cm at the end of the track. The
position sensor is coarse and may drop out or have outliers, but is unbiased. With each encoder calibrated
(`controllers.estimators.encoder_calibration`), the filter of `controllers.estimators.kalman` combines the encoders'
precision with the frame of the position sensor.

- A run starts at rest at a known position, which sets the encoders' zeros. The position sensor corrects them later.
- A new calibration shifts the predicted position. This is no motion: speed and disturbance remain unchanged, and the
  position for the law changes smoothly.
- A reading that is repeated until the next (`TrustGains.position_rate`) is taken for what it is: one reading, and by
  the time since it came older. Its repetitions share its information.
- While the sensor is silent (no number, or the same for many samples) only the encoders are used.
- With a probability of false alarms (`TrustGains.false_alarm`) readings of position and speed are gated
  (`controllers.estimators.innovation_gate`): an improbable position is not used, nor learnt from, while the encoder of
  a taut rope confirms the prediction; a speed wheel that slips is done without, with the gain for positions alone.
- Encoders of slack ropes and suspect encoders are faded out. Without any the filter uses position and speed sensor,
  with the gain for these. Both gains depend on parameters alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar

from dualwinch.codegen.block import NO_READING
from dualwinch.controllers.estimators.encoder_calibration import (
    INFORMED,
    Drum,
    DrumGains,
    EncoderKnowledge,
    EncoderPosition,
    Reading,
    TrustGains,
    calibrate,
    drum_position,
    informed_errors,
    learnt_errors,
    learnt_names,
    tared,
    unknown_errors,
)
from dualwinch.controllers.estimators.innovation_gate import Gates, Witness, position_gated
from dualwinch.controllers.estimators.kalman import (
    KalmanEstimate,
    KalmanGains,
    KalmanState,
    MotionFilter,
    corrected,
    initial_motion,
    kalman_gain,
    timely,
    with_gated_speed,
)
from dualwinch.controllers.parts import Context, Measurement
from dualwinch.model.heavy_ropes import sag_shortening
from dualwinch.model.matrix import Matrix
from dualwinch.model.plant import Plant, Side
from dualwinch.model.quantities.part import NO_STATE
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.reference import Setpoint
from dualwinch.model.ropes import Track, compliance, kelvin_voigt, rope_lengths, tangent_rope
from dualwinch.model.scalar import (
    Scalar,
    absolute,
    both,
    clip,
    either,
    exp,
    has_begun,
    maximum,
    minimum,
    present,
    sqrt,
    where,
)
from dualwinch.model.winch import base_radius, winding


@dataclass(frozen=True)
class SensorWatch:
    """State of the detection of a silent position sensor."""

    reading: Annotated[Scalar, Quantity("m", "last reading of the position sensor"), Mark.BOOKKEEPING] = 0.0
    repeats: Annotated[Scalar, Quantity("1", "samples since it last changed"), Mark.BOOKKEEPING] = 0.0
    started: Annotated[Scalar, Quantity("1", "1 after the first sample")] = 0.0


@dataclass(frozen=True)
class WheelKnowledge:
    """Estimate of the speed wheel's scale error."""

    error: Annotated[Scalar, Quantity("1", "share by which the wheel reads too much"), Mark.LEARNT] = 0.0
    information: Annotated[Scalar, Quantity("1", "information of the samples on it"), Mark.LEARNT] = 0.0
    rolled: Annotated[Scalar, Quantity("m", "recent distance of the wheel (high-passed)")] = 0.0
    left_behind: Annotated[Scalar, Quantity("m", "low-passed position"), Mark.POSITION] = 0.0


@dataclass(frozen=True)
class DelayKnowledge:
    """Estimate of the position sensor's delay beyond the assumed one, from those with either encoder."""

    delay: Annotated[Scalar, Quantity("s", "delay beyond the assumed one"), Mark.LEARNT] = 0.0
    information: Annotated[Scalar, Quantity("1/s^2", "information of the samples on it"), Mark.LEARNT] = 0.0


@dataclass(frozen=True)
class SelfCalibratingState:
    """State of the filter, of the calibrations of encoders and wheel, and of the detection of silence."""

    motion: KalmanState
    encoder_1: EncoderKnowledge
    encoder_2: EncoderKnowledge
    wheel: Any
    watch: SensorWatch = field(default_factory=SensorWatch)
    samples: Annotated[
        Scalar, Quantity("1", "samples since the calibration was updated"), Mark.PHASE, Mark.BOOKKEEPING
    ] = 0.0
    pending: Annotated[Scalar, Quantity("m", "shift by calibration that has not yet reached the position law")] = 0.0
    sensor_delay: Any = NO_STATE


@dataclass(frozen=True)
class SelfCalibratingEstimate(KalmanEstimate):
    """Output of the filter, with its calibration and the fault probability of each encoder."""

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
    fault_1: Annotated[Scalar, Quantity("1", "probability of a fault of encoder 1: 0 trusted, 1 left out")] = 0.0
    fault_2: Annotated[Scalar, Quantity("1", "probability of a fault of encoder 2: 0 trusted, 1 left out")] = 0.0


@dataclass(frozen=True)
class SiteEstimate(SelfCalibratingEstimate):
    """Output of a filter that also calibrates the winches' compliance, the sag, or the speed wheel's scale."""

    give_1: Annotated[Scalar, Quantity("m/N", "learnt compliance of winch 1")] = 0.0
    give_2: Annotated[Scalar, Quantity("m/N", "learnt compliance of winch 2")] = 0.0
    sag_excess_1: Annotated[Scalar, Quantity("1", "learnt sag of rope 1 above the nominal one, as a share")] = 0.0
    sag_excess_2: Annotated[Scalar, Quantity("1", "learnt sag of rope 2 above the nominal one, as a share")] = 0.0
    give_1_sd: Annotated[Scalar, Quantity("m/N", "standard deviation of give_1")] = 0.0
    give_2_sd: Annotated[Scalar, Quantity("m/N", "standard deviation of give_2")] = 0.0
    sag_excess_1_sd: Annotated[Scalar, Quantity("1", "standard deviation of sag_excess_1")] = 0.0
    sag_excess_2_sd: Annotated[Scalar, Quantity("1", "standard deviation of sag_excess_2")] = 0.0
    wheel: Annotated[Scalar, Quantity("1", "learnt share by which the speed wheel reads too much")] = 0.0


@dataclass(frozen=True)
class LateEstimate(SiteEstimate):
    """Output of the filter, where the delay of the position sensor is learnt too, with each encoder."""

    delay_1: Annotated[Scalar, Quantity("s", "learnt delay beyond the assumed one, by encoder 1")] = 0.0
    delay_2: Annotated[Scalar, Quantity("s", "learnt delay beyond the assumed one, by encoder 2")] = 0.0
    delay_1_sd: Annotated[Scalar, Quantity("s", "standard deviation of delay_1")] = 0.0
    delay_2_sd: Annotated[Scalar, Quantity("s", "standard deviation of delay_2")] = 0.0


PASSED_ON = ("scale", "zero", "excess", "give", "sag_excess", "delay")
"""Estimated errors of an encoder that are part of the output."""

TINY = 1e-12
"""In m, less than any sag's shortening."""

LEAST_INFORMATION = 1e-6
"""Floor of the total information, as a share of the position sensor's, without any position measurement."""


def watched(watch: SensorWatch, reading: Scalar, expected: Scalar, frozen_after: Scalar) -> tuple[SensorWatch, Scalar]:
    """Detection of silence after a reading in m, which may be missing, and whether the position sensor is alive.

    The expected position in m replaces a missing reading.
    """
    finite = absolute(reading) <= NO_READING
    value = where(finite, reading, expected)
    repeats = where(value == watch.reading, watch.repeats + 1, 0.0)
    alive = both(finite, repeats <= frozen_after)
    return SensorWatch(value, repeats, 1.0), alive


@dataclass(frozen=True)
class Innovation:
    """Innovation of position sensor and encoders together.

    Attributes:
        shift: shift of the predicted position by new calibrations, in m.
        residual: innovation of the position after the shift, in m.
        lead: relative weight of the encoders, from 0 without any to 1 with both.
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
    """Position sensor and encoders combined into one measurement, weighted by their inverse variances."""
    noise, encoder_noise = gains.position_noise, gains.encoder_noise
    sensor, both_encoders = 1 / noise**2, 2 / encoder_noise**2
    heard = where(reading.alive, sensor, 0.0)
    shares = [
        where(drum.taut, 1 / (encoder_noise**2 + noise**2 * position.odds), 0.0)
        for drum, position in zip(drums, positions, strict=True)
    ]
    encoders = sum(shares)
    total = maximum(heard + encoders, LEAST_INFORMATION * sensor)
    # an encoder far from the prediction has not contributed to it, so its calibration does not shift it
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


def wheel_error(known: Any) -> Scalar:
    """Learnt share by which the speed wheel reads too much."""
    return known.error if isinstance(known, WheelKnowledge) else 0.0


def wheel_deviation(known: Any, gains: DrumGains) -> Scalar:
    """Standard deviation of that share."""
    return 1 / sqrt(known.information + 1 / gains.wheel**2) if isinstance(known, WheelKnowledge) else 0.0


def common_delay(
    known: Any,
    v: Scalar,
    drums: tuple[Drum, Drum],
    encoders: tuple[EncoderKnowledge, EncoderKnowledge],
    kalman: KalmanGains,
    gains: DrumGains,
    sample_time: Scalar,
) -> Any:
    """The position sensor's delay, learnt with both encoders, by recursive least squares with forgetting.

    What is not known of a rope's sag changes with its tension and therefore with the speed, as the way of a delay does:
    at a speed v in m/s a delay that was learnt with an encoder counts v² over the variance of that encoder's position.
    """
    if not isinstance(known, DelayKnowledge):
        return known
    place, delay = learnt_names(gains).index("delay"), known.delay
    weights = [v**2 / (kalman.encoder_noise**2 + (gains.sag * drum.sag) ** 2) * drum.taut for drum in drums]
    information = exp(-sample_time / gains.memory) * known.information + sum(weights)
    total = information + 1 / gains.delay**2
    for weight, encoder in zip(weights, encoders, strict=True):
        delay += weight / total * (gains.delay * encoder.gathered.estimate[place] - known.delay)
    return DelayKnowledge(delay, information)


def with_common_delay(
    position: EncoderPosition, encoder: EncoderKnowledge, sensor_delay: DelayKnowledge, v: Scalar, gains: DrumGains
) -> EncoderPosition:
    """An encoder's position with the common delay in place of that learnt with this encoder, at a speed in m/s."""
    place = learnt_names(gains).index("delay")
    return replace(position, x=position.x - v * (gains.delay * encoder.gathered.estimate[place] - sensor_delay.delay))


def _distance(apart: Scalar, jump: Scalar) -> Scalar:
    """Inverse of Cauchy's weight of an encoder `apart` m from the prediction: 1 nearby, 2 at `jump` m."""
    return 1 + (apart / jump) ** 2


def blended_gain(gains: KalmanGains, lead: Scalar, sample_time: Scalar) -> Matrix:
    """Gain of the filter, interpolated between that without encoders (`lead` 0) and with both (1)."""
    without = kalman_gain(gains, sample_time, encoders=False)
    complete = kalman_gain(gains, sample_time)
    return tuple(
        tuple(low + lead * (high - low) for low, high in zip(*rows, strict=True))
        for rows in zip(without, complete, strict=True)
    )


@dataclass(frozen=True)
class SelfCalibratingKalman(MotionFilter):
    """The filter, the prior of drums and ropes, and the tests of the sensors."""

    drums: DrumGains = field(default_factory=DrumGains)
    trust: TrustGains = field(default_factory=TrustGains)

    kind: ClassVar = "self-calibrating-kalman"
    label: ClassVar = "self-calibrating Kalman filter"

    @property
    def silent(self) -> frozenset[str]:
        """Names of measurements that may be missing."""
        return super().silent | {"x"}

    def initial_state(self) -> SelfCalibratingState:
        """At rest at the start of the run, with nominal drums, ropes and encoders."""
        unknown = unknown_errors(self.drums)
        wheel = WheelKnowledge() if self.kalman.speed_sensor and present(self.drums.wheel) else NO_STATE
        sensor_delay = DelayKnowledge() if present(self.drums.delay) else NO_STATE
        return SelfCalibratingState(initial_motion(self.trust), unknown, unknown, wheel, sensor_delay=sensor_delay)

    def step(
        self, state: SelfCalibratingState, measurement: Measurement, setpoint: Setpoint, context: Context
    ) -> tuple[SelfCalibratingState, SelfCalibratingEstimate]:
        """One sample: calibrate the encoders, then filter the motion with them."""
        gains, sample_time, repeated = self.kalman, context.sample_time, 0.0
        if present(rate := self.trust.position_rate):
            repeated = maximum(1 / (rate * sample_time) - 1, 0.0)
            # so many readings of one noise say as much as a single one of it
            gains = replace(gains, position_noise=gains.position_noise * sqrt(1 + repeated))
        x = state.motion.x
        watch, alive = watched(state.watch, measurement.x, x, self.trust.frozen_after + repeated)
        age = sample_time * minimum(watch.repeats, repeated) if present(rate) else 0.0
        now = timely(state.motion, replace(measurement, x=watch.reading), gains, context.nominal, age)
        reading = Reading(now.x, alive, gains.position_noise)
        due = True if self.drums.interval == 1 else state.samples == 0
        drums, resting = _drums(now, state.motion, context), both(due, 1 - has_begun(state.watch.started))
        sensor_delay = state.sensor_delay
        way = state.motion.v * sensor_delay.delay if isinstance(sensor_delay, DelayKnowledge) else 0.0
        predicted, is_confirmed, witnesses = state.motion, 1.0, self._witnesses(state, drums)
        if isinstance(predicted.gates, Gates):
            innovation_of_x = where(alive, reading.x + way - x, 0.0)
            gates, is_confirmed = self._position_gated(predicted.gates, innovation_of_x, witnesses, sample_time)
            reading = replace(reading, trusted=1 - gates.position.rejected)
            predicted = replace(predicted, gates=gates)
        encoder_1, position_1 = self._calibrated(state.encoder_1, drums[0], x, reading, resting, due, sample_time)
        encoder_2, position_2 = self._calibrated(state.encoder_2, drums[1], x, reading, resting, due, sample_time)
        v, encoders = state.motion.v, (encoder_1, encoder_2)
        sensor_delay = common_delay(sensor_delay, v, drums, encoders, self.kalman, self.drums, sample_time)
        if isinstance(sensor_delay, DelayKnowledge):
            way = v * sensor_delay.delay
            position_1 = with_common_delay(position_1, encoder_1, sensor_delay, v, self.drums)
            position_2 = with_common_delay(position_2, encoder_2, sensor_delay, v, self.drums)
        punctual = replace(reading, x=reading.x + way, alive=both(reading.alive, reading.trusted))
        fused = innovation(x, punctual, drums, (position_1, position_2), gains, self.trust)
        gain, rolled = blended_gain(gains, fused.lead, sample_time), now.v
        if isinstance(predicted.gates, Gates) and gains.speed_sensor:
            wheel_scale = 1 + wheel_error(state.wheel)
            spread = (state.motion.v * wheel_deviation(state.wheel, self.drums)) ** 2
            predicted, gain = with_gated_speed(
                predicted,
                gain,
                now.v / wheel_scale,
                witnesses,
                is_confirmed,
                self.kalman,
                self.trust,
                sample_time,
                spread,
            )
            rolled = where(predicted.gates.speed.rejected > 0, predicted.v * wheel_scale, now.v)
        wheel, speed = self._rolled(state.wheel, rolled, x, sample_time)
        motion, estimate = corrected(
            replace(predicted, x=x + fused.shift),
            measurement,
            (fused.residual, gains.speed_innovation(speed, predicted.v)),
            gain,
            gains,
            context.nominal,
            sample_time,
        )
        pending = (state.pending + fused.shift) * (1 - sample_time / self.trust.slide_time)
        samples = where(state.samples + 1 < self.drums.interval, state.samples + 1, 0.0)
        following = SelfCalibratingState(motion, encoder_1, encoder_2, wheel, watch, samples, pending, sensor_delay)
        passed_on = estimate.x_est - pending
        learnt = self._learnt((encoder_1, encoder_2), (position_1, position_2))
        learnt |= {"wheel": wheel.error} if isinstance(wheel, WheelKnowledge) else {}
        return following, self._output_type()(**vars(estimate) | {"x": passed_on, "x_est": passed_on} | learnt)

    def _witnesses(self, state: SelfCalibratingState, drums: tuple[Drum, Drum]) -> tuple[Witness, Witness]:
        """The calibrated encoders of this sample."""

        def witness(known: EncoderKnowledge, drum: Drum) -> Witness:
            off = drum_position(known, drum, self.drums, self.kalman.position_noise) - state.motion.x
            return Witness(off, drum.taut, self.kalman.position_noise**2 * known.gathered.variance, drum.pull)

        return witness(state.encoder_1, drums[0]), witness(state.encoder_2, drums[1])

    def _position_gated(
        self, gates: Gates, innovation: Scalar, encoders: Sequence[Witness], sample_time: Scalar
    ) -> tuple[Gates, Scalar]:
        """The gates after the innovation in m of the position sensor, and whether encoders confirm the prediction."""
        return position_gated(
            gates,
            innovation,
            encoders,
            self.trust,
            sensor=self.kalman.position_noise**2,
            encoder=self.kalman.encoder_noise**2,
            memory=sample_time / self.trust.fault_time,
            sample_time=sample_time,
        )

    def _output_type(self) -> type[SelfCalibratingEstimate]:
        drums = self.drums
        if present(drums.delay):
            return LateEstimate
        return SiteEstimate if any(map(present, (drums.give, drums.sag, drums.wheel))) else SelfCalibratingEstimate

    def informed(
        self, state: SelfCalibratingState, measurement: Measurement, plant: Plant, speed_error: Scalar, context: Context
    ) -> SelfCalibratingState:
        """The state with the machine's true constants; the encoders' zeros agree with the measurement."""
        now = timely(state.motion, measurement, self.kalman, context.nominal)
        drums = _drums(now, state.motion, context)
        reading = Reading(now.x, 1.0, self.kalman.position_noise)
        lengths = rope_lengths(state.motion.x, plant.track)
        encoder_1, encoder_2 = (
            informed_errors(knowledge, drum, _true_errors(side, sheet, drum, length, plant.track), reading, self.drums)
            for knowledge, side, sheet, drum, length in zip(
                (state.encoder_1, state.encoder_2), plant.sides, context.nominal.sides, drums, lengths, strict=True
            )
        )
        wheel = state.wheel
        if isinstance(wheel, WheelKnowledge):
            wheel = replace(wheel, error=speed_error, information=INFORMED / self.drums.wheel**2)
        return replace(state, encoder_1=encoder_1, encoder_2=encoder_2, wheel=wheel)

    def _rolled(self, known: Any, reading: Scalar, x: Scalar, sample_time: Scalar) -> tuple[Any, Scalar]:
        """Updated estimate of the wheel's scale error, and the corrected speed in m/s.

        Recursive least squares of one constant: the distance of the wheel against that of the predicted position x in
        m, which the encoders determine well, both with the same high-pass.
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
        self,
        known: EncoderKnowledge,
        drum: Drum,
        x: Scalar,
        reading: Reading,
        resting: Scalar,
        due: Scalar,
        sample_time: Scalar,
    ) -> tuple[EncoderKnowledge, EncoderPosition]:
        known = tared(known, drum, x, self.drums, resting)
        # rest in a known position counts as many readings; it sets the encoder, not the predicted position
        weight = where(resting, (reading.deviation / self.drums.tare) ** 2, 1.0)
        position_reading = Reading(
            where(resting, x, reading.x),
            either(resting, reading.alive),
            reading.deviation,
            weight,
            either(resting, reading.trusted) if self.trust.false_alarm else 1.0,
        )
        known, position = calibrate(known, drum, position_reading, self.drums, self.trust, sample_time, due)
        return known, replace(position, shift=where(resting, 0.0, position.shift))

    def _learnt(
        self, knowledge: tuple[EncoderKnowledge, ...], positions: tuple[EncoderPosition, ...]
    ) -> dict[str, Scalar]:
        signals: dict[str, Scalar] = {"position_used": either(positions[0].used, positions[1].used)}
        for number, (drum_knowledge, position) in enumerate(zip(knowledge, positions, strict=True), start=1):
            for name, (value, spread) in learnt_errors(drum_knowledge, self.drums).items():
                if name in PASSED_ON:
                    signals |= {f"{name}_{number}": value, f"{name}_{number}_sd": spread}
            signals[f"fault_{number}"] = position.odds / (1 + position.odds)
        return signals


def _true_errors(side: Side, sheet: Side, drum: Drum, length: Scalar, track: Track) -> dict[str, Scalar]:
    """Errors of a side's encoder by name, as its parts differ from those of the data sheet; without run-out."""
    winch, nominal = side.winch, sheet.winch
    rope, assumed = tangent_rope(side.rope, drum.pull, length), kelvin_voigt(sheet.rope)
    sag = sag_shortening(side.rope, drum.pull, length, track)
    return {
        "scale": base_radius(winch) / base_radius(nominal) - 1,
        "layers": winch.layer_thickness / winch.layer_laps - nominal.layer_thickness / nominal.layer_laps,
        "excess": assumed.modulus * assumed.area / (rope.modulus * rope.area) - 1,
        "give": base_radius(winch) ** 2 / winch.gear_stiffness if present(winch.gear_stiffness) else 0.0,
        "sag_excess": where(drum.sag > 0, sag / maximum(drum.sag, TINY) - 1, 0.0),
    }


def _drums(measurement: Measurement, motion: KalmanState, context: Context) -> tuple[Drum, Drum]:
    """Both drums from this sample's measurement and nominal values, at the predicted motion."""
    drums, taut = [], context.limits.taut
    measured = (measurement.F1, measurement.theta_1), (measurement.F2, measurement.theta_2)
    lengths = rope_lengths(motion.x, context.nominal.track)
    for side, length, (F, theta) in zip(context.nominal.sides, lengths, measured, strict=True):
        stretch = F * compliance(length, kelvin_voigt(side.rope))
        sag = sag_shortening(side.rope, F, length, context.nominal.track)
        wound, speed = winding(theta, side.winch).rope, side.direction * motion.v
        drums.append(Drum(side.direction, wound, theta, stretch, sag, F, taut < F, speed))
    return drums[0], drums[1]
