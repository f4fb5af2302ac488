"""Kalman filter that also estimates the compliance of the ropes.

The stretch of a rope, up to some millimetres, lies between drum encoder and vehicle. A modulus wrong by a tenth makes
the encoder's position wrong by a tenth of that: ten times its resolution, and no averaging removes it. The position
sensor is coarse but unbiased: it calibrates the ropes online.

The true stretch of rope i is ``(1 + excess_i) * stretch_i``, with ``stretch_i = F_i length_i/(E_i A_i)`` from the
measured tension and the nominal rope (paper Section 2.2). Each excess compliance is estimated by recursive least
squares with exponential forgetting from the difference of position sensor and encoder (Ljung and Söderström, Theory and
Practice of Recursive Identification, 1983, Section 2.6). The filter of `controllers.estimators.kalman` then uses the
calibrated ropes.
"""

from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar

from dualwinch.controllers.estimators.innovation_gate import GateGains, Gates
from dualwinch.controllers.estimators.kalman import (
    KalmanEstimate,
    KalmanState,
    MotionFilter,
    filter_motion,
    initial_motion,
    timely,
    with_gated_position,
    witnesses,
)
from dualwinch.controllers.parts import Context, Measurement
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.quantity import Mark, Positive, Quantity, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.ropes import Rope, RopeLaw, kelvin_voigt, rope_lengths, stiffness, tangent_rope
from dualwinch.model.scalar import Scalar, both, clip, exp, where


@dataclass(frozen=True)
class CalibrationGains:
    """Prior of the ropes' compliance, and memory of the estimate."""

    deviation: Annotated[
        Positive,
        Quantity("1", "assumed standard deviation of the ropes' compliance, as a share", "assumption"),
        Tunable(5e-3, 0.5, standard=False),
    ] = 0.06
    memory: Annotated[
        Positive,
        Quantity("s", "age at which the weight of a sample has fallen to 1/e", "assumption"),
        Tunable(5, 500, standard=False),
    ] = 60.0


@dataclass(frozen=True)
class RopeKnowledge:
    """Estimate of the compliance of one rope."""

    excess: Annotated[Scalar, Quantity("1", "compliance above the nominal one, as a share"), Mark.LEARNT] = 0.0
    information: Annotated[Scalar, Quantity("1", "inverse variance of the excess, from samples"), Mark.LEARNT] = 0.0


@dataclass(frozen=True)
class CalibratingState:
    """State of the filter and of the calibration of both ropes."""

    motion: KalmanState = field(default_factory=KalmanState)
    rope_1: RopeKnowledge = field(default_factory=RopeKnowledge)
    rope_2: RopeKnowledge = field(default_factory=RopeKnowledge)


INFORMED = 1e18
"""Information on a rope's compliance that makes further samples insignificant."""

LARGEST_EXCESS = 0.5
"""Bound of the excess compliance in either direction."""


def learn(
    known: RopeKnowledge,
    stretch: Scalar,
    seen: Scalar,
    taut: Scalar,
    position_noise: Scalar,
    gains: CalibrationGains,
    sample_time: Scalar,
) -> RopeKnowledge:
    """The estimate of a rope's compliance updated by one sample.

    The stretch in m is the nominal one at the measured tension; the one `seen` is from encoder and position sensor,
    whose noise has a standard deviation in m. A rope that is not `taut` has no information. The sample time is in s.
    """
    weight = where(taut, stretch / position_noise**2, 0.0)
    information = exp(-sample_time / gains.memory) * known.information + weight * stretch
    innovation = seen - (1 + known.excess) * stretch
    excess = known.excess + weight * innovation / (information + 1 / gains.deviation**2)
    return RopeKnowledge(clip(excess, -LARGEST_EXCESS, LARGEST_EXCESS), information)


@dataclass(frozen=True)
class CalibratingEstimate(KalmanEstimate):
    """Output of the filter, with the estimated compliances of the ropes."""

    excess_1: Annotated[Scalar, Quantity("1", "learnt compliance of rope 1 above the nominal one, as a share")] = 0.0
    excess_2: Annotated[Scalar, Quantity("1", "learnt compliance of rope 2 above the nominal one, as a share")] = 0.0


@dataclass(frozen=True)
class CalibratingKalman(MotionFilter):
    """The filter, its calibration and its gate."""

    calibration: CalibrationGains = field(default_factory=CalibrationGains)
    trust: GateGains = field(default_factory=GateGains)

    kind: ClassVar = "calibrating-kalman"
    label: ClassVar = "calibrating Kalman filter"

    def initial_state(self) -> CalibratingState:
        """At rest at the start of the run, with the nominal ropes."""
        return CalibratingState(initial_motion(self.trust))

    def step(
        self, state: CalibratingState, measurement: Measurement, setpoint: Setpoint, context: Context
    ) -> tuple[CalibratingState, CalibratingEstimate]:
        """One sample: calibrate the ropes, then filter the motion with the calibrated ropes."""
        nominal, taut, drums = context.nominal, context.limits.taut, []
        ropes, noise = (state.rope_1, state.rope_2), self.kalman.position_noise
        now = timely(state.motion, measurement, self.kalman, nominal)
        measured = (now.F1, now.theta_1), (now.F2, now.theta_2)
        stretches = [
            F / stiffness(length, kelvin_voigt(side.rope))
            for side, length, (F, _) in zip(
                nominal.sides, rope_lengths(state.motion.x, nominal.track), measured, strict=True
            )
        ]
        spreads = tuple(
            stretch**2 / (rope.information + 1 / self.calibration.deviation**2)
            for stretch, rope in zip(stretches, ropes, strict=True)
        )
        encoders = witnesses(state.motion, now, with_ropes(nominal, *ropes), context, spreads)
        motion, is_confirmed = with_gated_position(state.motion, now, encoders, self.kalman, self.trust, context)
        trusted = 1 - motion.gates.position.rejected if isinstance(motion.gates, Gates) else 1.0
        for side, knowledge, stretch, (F, theta) in zip(nominal.sides, ropes, stretches, measured, strict=True):
            offset = side.winch.drum_radius * theta - side.direction * now.x
            counts = both(taut < F, trusted)
            drums.append(learn(knowledge, stretch, offset, counts, noise, self.calibration, context.sample_time))
        rope_1, rope_2 = drums
        motion, estimate = filter_motion(
            motion, measurement, self.kalman, with_ropes(nominal, *drums), context, self.trust, is_confirmed
        )
        learnt = {"excess_1": rope_1.excess, "excess_2": rope_2.excess}
        return CalibratingState(motion, rope_1, rope_2), CalibratingEstimate(**vars(estimate) | learnt)

    def informed(
        self, state: CalibratingState, measurement: Measurement, plant: Plant, speed_error: Scalar, context: Context
    ) -> CalibratingState:
        """The state with the ropes' true compliances."""
        drums, lengths = [], rope_lengths(state.motion.x, plant.track)
        pulls = measurement.F1, measurement.F2
        for side, sheet, length, F in zip(plant.sides, context.nominal.sides, lengths, pulls, strict=True):
            rope, nominal = tangent_rope(side.rope, F, length), kelvin_voigt(sheet.rope)
            excess = nominal.modulus * nominal.area / (rope.modulus * rope.area) - 1
            drums.append(RopeKnowledge(excess, INFORMED))
        return replace(state, rope_1=drums[0], rope_2=drums[1])


def with_ropes(nominal: Plant, rope_1: RopeKnowledge, rope_2: RopeKnowledge) -> Plant:
    """The nominal plant with the estimated compliances of its ropes."""
    return replace(nominal, rope_1=_calibrated(nominal.rope_1, rope_1), rope_2=_calibrated(nominal.rope_2, rope_2))


def _calibrated(rope: RopeLaw, known: RopeKnowledge) -> Rope:
    """The nominal rope with the estimated compliance."""
    nominal = kelvin_voigt(rope)
    return replace(nominal, modulus=nominal.modulus / (1 + known.excess))
