"""Kalman filter that learns drums, ropes and encoder zeros under way, and knows whom to believe.

Encoders are precise and wrong: a drum that is 0.2 % larger than believed is 9 cm off at the end of the track. The position
sensor is coarse, may fall silent or give nonsense, and is right in the mean. The filter of
`controllers.estimators.kalman` takes the best of both once each encoder is calibrated
(`controllers.estimators.encoder_calibration`): it lives on the encoders, and positions are those of the sensor's frame.

- A run starts at rest at x = 0: the first sample is a measurement of that, and tells the encoders' zeros.
- A calibration that changes moves the expected position along with it. It says that one was elsewhere all the time, not
  that one has moved, and speed and disturbance know nothing of it.
- While the sensor is silent (no number, or the same for many samples) the encoders go on alone, as well as they are known.
- Encoders that are slack or doubted are left out, smoothly. With none left the filter lives on position and speed
  sensor, with the gain that belongs to these. Both gains depend on parameters alone.
"""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from dualwinch.controllers.context import Context
from dualwinch.controllers.estimators.encoder_calibration import (
    Drum,
    DrumGains,
    EncoderKnowledge,
    EncoderPosition,
    Reading,
    TrustGains,
    calibrate,
    learnt_errors,
)
from dualwinch.controllers.estimators.estimator import Estimator
from dualwinch.controllers.estimators.kalman import (
    TAUT,
    KalmanEstimate,
    KalmanGains,
    KalmanState,
    corrected,
    kalman_gain,
)
from dualwinch.controllers.signals import Measurement
from dualwinch.model.matrix import Matrix
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.reference import Setpoint
from dualwinch.model.ropes.kelvin_voigt import compliance, kelvin_voigt
from dualwinch.model.ropes.track import rope_lengths
from dualwinch.model.scalar import Scalar, absolute, both, clip, either, maximum, where
from dualwinch.model.winding import winding


@dataclass(frozen=True)
class SensorWatch:
    """What tells whether the position sensor is alive."""

    reading: Annotated[Scalar, Quantity("m", "last reading of the position sensor"), Mark.BOOKKEEPING] = 0.0
    repeats: Annotated[Scalar, Quantity("1", "samples since it last changed"), Mark.BOOKKEEPING] = 0.0
    started: Annotated[Scalar, Quantity("1", "1 after the first sample"), Mark.BOOKKEEPING] = 0.0


@dataclass(frozen=True)
class SelfCalibratingState:
    """State of the filter, of what is known of both encoders, and of the watch on the position sensor."""

    motion: KalmanState = field(default_factory=KalmanState)
    encoder_1: EncoderKnowledge = field(default_factory=EncoderKnowledge)
    encoder_2: EncoderKnowledge = field(default_factory=EncoderKnowledge)
    watch: SensorWatch = field(default_factory=SensorWatch)


@dataclass(frozen=True)
class SelfCalibratingEstimate(KalmanEstimate):
    """What the filter gives, what it has learnt, and whom it believes."""

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


LARGEST_READING = 1e6
"""Magnitude in m beyond which a reading is none; NaN is not below it either."""


def watched(watch: SensorWatch, reading: Scalar, expected: Scalar, frozen_after: Scalar) -> tuple[SensorWatch, Scalar]:
    """The watch after a reading, and whether the position sensor is alive.

    Args:
        watch: as the last sample left it.
        reading: in m, maybe no number.
        expected: position in m, for what the watch remembers of a reading that is none.
        frozen_after: samples after which a reading that repeats itself is none.
    """
    finite = absolute(reading) <= LARGEST_READING
    shown = where(finite, reading, expected)
    repeats = where(shown == watch.reading, watch.repeats + 1, 0.0)
    alive = both(finite, repeats <= frozen_after)
    return SensorWatch(shown, repeats, 1.0), alive


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
    """The filter, what it believes of drums and ropes before a run, and whom it trusts."""

    kalman: KalmanGains = field(default_factory=KalmanGains)
    drums: DrumGains = field(default_factory=DrumGains)
    trust: TrustGains = field(default_factory=TrustGains)

    kind: ClassVar = "self-calibrating-kalman"
    label: ClassVar = "self-calibrating Kalman filter"

    def initial_state(self) -> SelfCalibratingState:
        """At rest at x = 0, with drums, ropes and encoders as they are believed to be."""
        return SelfCalibratingState()

    def step(
        self,
        state: SelfCalibratingState,
        measurement: Measurement,
        setpoint: Setpoint,
        context: Context,
    ) -> tuple[SelfCalibratingState, SelfCalibratingEstimate]:
        """One sample: learn of the encoders, then filter the motion with what is known of them."""
        gains, nominal, sample_time = self.kalman, context.nominal, context.sample_time
        noise, gate = gains.position_noise, self.trust.gate
        expected_x = state.motion.x
        watch, alive = watched(state.watch, measurement.x, expected_x, self.trust.frozen_after)
        reading = Reading(
            x=where(state.watch.started, watch.reading, 0.0),
            alive=either(alive, 1 - state.watch.started),
            deviation=noise,
            weight=where(state.watch.started, 1.0, (noise / self.drums.start_deviation) ** 2),
            gate=where(state.watch.started, gate, LARGEST_READING),
        )
        drums = _drums(measurement, expected_x, context)
        knowledge, positions = zip(
            *(
                calibrate(known, drum, reading, self.drums, self.trust, sample_time)
                for known, drum in zip((state.encoder_1, state.encoder_2), drums, strict=True)
            ),
            strict=True,
        )
        # information in 1/m² of the position sensor, and of each encoder, less where it is doubted
        sensor, encoder = 1 / noise**2, 1 / gains.encoder_noise**2
        shares = [
            where(drum.taut, 1 / (gains.encoder_noise**2 + noise**2 * position.odds), 0.0)
            for drum, position in zip(drums, positions, strict=True)
        ]
        told, encoders = where(reading.alive, sensor, 0.0), sum(shares)
        total = maximum(told + encoders, sensor * 1e-6)
        # an encoder that is far off has not brought the expectation here, and does not take it along
        near = [1 / (1 + ((position.x - position.shift - expected_x) / self.trust.jump) ** 2) for position in positions]
        moved = sum(
            share * close * position.shift for share, close, position in zip(shares, near, positions, strict=True)
        )
        x = expected_x + where(state.watch.started, moved / total, 0.0)
        surprise_x = told * clip(reading.x - x, -gate * noise, gate * noise)
        for share, position in zip(shares, positions, strict=True):
            apart = position.x - x
            surprise_x += share * apart / (1 + (apart / self.trust.jump) ** 2)
        surprise = surprise_x / total, measurement.v - state.motion.v
        lead = encoders / (sensor + encoders) * ((sensor + 2 * encoder) / (2 * encoder))
        moving = KalmanState(x, state.motion.v, state.motion.d, state.motion.rate)
        gain = blended_gain(gains, lead, sample_time)
        motion, estimate = corrected(moving, measurement, surprise, gain, gains, nominal, sample_time)
        following = SelfCalibratingState(motion, *knowledge, watch)
        used = either(positions[0].used, positions[1].used)
        return following, SelfCalibratingEstimate(**vars(estimate) | self._learnt(knowledge, positions, used))

    def _learnt(
        self, knowledge: tuple[EncoderKnowledge, ...], positions: tuple[EncoderPosition, ...], used: Scalar
    ) -> dict[str, Scalar]:
        found: dict[str, Scalar] = {"position_used": used}
        for number, (known, position) in enumerate(zip(knowledge, positions, strict=True), start=1):
            scale, zero, excess, *_ = learnt_errors(known, self.drums)
            for name, (value, spread) in {"scale": scale, "zero": zero, "excess": excess}.items():
                found |= {f"{name}_{number}": value, f"{name}_{number}_sd": spread}
            found[f"doubt_{number}"] = position.odds / (1 + position.odds)
        return found


def _drums(measurement: Measurement, x: Scalar, context: Context) -> tuple[Drum, Drum]:
    """Both drums as this sample's measurement and nominal values show them, with the vehicle at about x in m."""
    nominal, taut = context.nominal, TAUT * context.limits.tension_min
    length_1, length_2 = rope_lengths(x, nominal.track)
    F1, F2, theta_1, theta_2 = measurement.F1, measurement.F2, measurement.theta_1, measurement.theta_2
    stretch_1 = F1 * compliance(length_1, kelvin_voigt(nominal.rope_1))
    stretch_2 = F2 * compliance(length_2, kelvin_voigt(nominal.rope_2))
    return (
        Drum(1.0, winding(theta_1, nominal.winch_1).rope, theta_1, stretch_1, taut < F1),
        Drum(-1.0, winding(theta_2, nominal.winch_2).rope, theta_2, stretch_2, taut < F2),
    )
