"""Kalman filter that also learns how elastic the ropes are.

The stretch of a rope, up to some millimetres, stands between drum encoder and vehicle. A modulus that is a tenth off
makes the encoder's position wrong by a tenth of that: ten times what its own step does. Noise can be averaged away,
this cannot. The position sensor is coarse, but right in the mean: with it the ropes are calibrated under way.

The true stretch of rope i is ``(1 + excess_i) * stretch_i``, with ``stretch_i = F_i length_i/(E_i A_i)`` from the
measured tension and the nominal rope (paper Section 2.2). Each excess compliance follows by recursive least squares
from what the position sensor and the rope's encoder say of the same position; the older a sample, the less it counts
(Ljung and Söderström, Theory and Practice of Recursive Identification, 1983, Section 2.6). The filter of
`controllers.estimators.kalman` then works with the ropes as they are known by now.
"""

from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar

from dualwinch.controllers.estimators.kalman import TAUT, KalmanEstimate, KalmanGains, KalmanState, filter_motion
from dualwinch.controllers.parts import Context, Estimator, Measurement
from dualwinch.model.quantities.quantity import Mark, Positive, Quantity, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.ropes import Rope, RopeLaw, kelvin_voigt, rope_lengths, stiffness
from dualwinch.model.scalar import Scalar, clip, exp, where


@dataclass(frozen=True)
class CalibrationGains:
    """What is believed of the ropes before the run, and how long a sample counts."""

    deviation: Annotated[
        Positive,
        Quantity("1", "believed standard deviation of the ropes' compliance, as a share", "assumption"),
        Tunable(5e-3, 0.5, standard=False),
    ] = 0.06
    memory: Annotated[
        Positive,
        Quantity("s", "age at which a sample counts 1/e of a fresh one", "assumption"),
        Tunable(5, 500, standard=False),
    ] = 60.0


@dataclass(frozen=True)
class RopeKnowledge:
    """What is known of one rope."""

    excess: Annotated[Scalar, Quantity("1", "compliance above the nominal one, as a share"), Mark.LEARNT] = 0.0
    information: Annotated[Scalar, Quantity("1", "inverse variance of the excess, from samples"), Mark.LEARNT] = 0.0


@dataclass(frozen=True)
class CalibratingState:
    """State of the filter and of the calibration of both ropes."""

    motion: KalmanState = field(default_factory=KalmanState)
    rope_1: RopeKnowledge = field(default_factory=RopeKnowledge)
    rope_2: RopeKnowledge = field(default_factory=RopeKnowledge)


LARGEST_EXCESS = 0.5
"""Largest excess compliance, either way: no rope is softer or stiffer than this."""


def learn(
    known: RopeKnowledge,
    stretch: Scalar,
    seen: Scalar,
    taut: Scalar,
    position_noise: Scalar,
    gains: CalibrationGains,
    sample_time: Scalar,
) -> RopeKnowledge:
    """What is known of a rope after one sample more.

    Args:
        known: what was known.
        stretch: nominal stretch in m at the measured tension.
        seen: stretch in m that encoder and position sensor show.
        taut: whether the rope is; a slack one teaches nothing.
        position_noise: standard deviation of the position sensor in m.
        gains: prior and memory.
        sample_time: in s.
    """
    weight = where(taut, stretch / position_noise**2, 0.0)
    information = exp(-sample_time / gains.memory) * known.information + weight * stretch
    innovation = seen - (1 + known.excess) * stretch
    excess = known.excess + weight * innovation / (information + 1 / gains.deviation**2)
    return RopeKnowledge(clip(excess, -LARGEST_EXCESS, LARGEST_EXCESS), information)


@dataclass(frozen=True)
class CalibratingEstimate(KalmanEstimate):
    """What the filter gives, and what it has learnt of the ropes."""

    excess_1: Annotated[Scalar, Quantity("1", "learnt compliance of rope 1 above the nominal one, as a share")] = 0.0
    excess_2: Annotated[Scalar, Quantity("1", "learnt compliance of rope 2 above the nominal one, as a share")] = 0.0


@dataclass(frozen=True)
class CalibratingKalman(Estimator):
    """The filter and its calibration."""

    kalman: KalmanGains = field(default_factory=KalmanGains)
    calibration: CalibrationGains = field(default_factory=CalibrationGains)

    kind: ClassVar = "calibrating-kalman"
    label: ClassVar = "calibrating Kalman filter"

    def initial_state(self) -> CalibratingState:
        """At rest where a run begins, with ropes as elastic as the nominal ones."""
        return CalibratingState()

    def step(
        self, state: CalibratingState, measurement: Measurement, setpoint: Setpoint, context: Context
    ) -> tuple[CalibratingState, CalibratingEstimate]:
        """One sample: learn of the ropes, then filter the motion with what is known of them."""
        nominal, taut, found = context.nominal, TAUT * context.limits.tension_min, []
        lengths = rope_lengths(state.motion.x, nominal.track)
        measured = (measurement.F1, measurement.theta_1), (measurement.F2, measurement.theta_2)
        for side, known, length, (F, theta) in zip(
            nominal.sides, (state.rope_1, state.rope_2), lengths, measured, strict=True
        ):
            stretch = F / stiffness(length, kelvin_voigt(side.rope))
            seen = side.winch.drum_radius * theta - side.direction * measurement.x
            noise = self.kalman.position_noise
            found.append(learn(known, stretch, seen, taut < F, noise, self.calibration, context.sample_time))
        rope_1, rope_2 = found
        ropes = {"rope_1": _calibrated(nominal.rope_1, rope_1), "rope_2": _calibrated(nominal.rope_2, rope_2)}
        motion, estimate = filter_motion(state.motion, measurement, self.kalman, replace(nominal, **ropes), context)
        learnt = {"excess_1": rope_1.excess, "excess_2": rope_2.excess}
        return CalibratingState(motion, rope_1, rope_2), CalibratingEstimate(**vars(estimate) | learnt)


def _calibrated(rope: RopeLaw, known: RopeKnowledge) -> Rope:
    """The nominal rope, as elastic as it is known to be."""
    believed = kelvin_voigt(rope)
    return replace(believed, modulus=believed.modulus / (1 + known.excess))
