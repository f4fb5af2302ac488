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
from typing import TYPE_CHECKING, Annotated

import annotated_types as at

from dualwinch.controllers.estimators.kalman import TAUT, KalmanState, kalman_step
from dualwinch.controllers.signals import Measurement, Seen
from dualwinch.model.plant import Plant
from dualwinch.model.quantity import Quantity, Tunable
from dualwinch.model.rope import Rope, rope_lengths, stiffness
from dualwinch.model.scalar import Scalar, clip, exp, where

if TYPE_CHECKING:
    from dualwinch.controllers.controller import Controller


@dataclass(frozen=True)
class CalibrationGains:
    """What is believed of the ropes before the run, and how long a sample counts."""

    spread: Annotated[
        float,
        at.Gt(0),
        Quantity("1", "believed standard deviation of the ropes' compliance, as a share", "assumption"),
        Tunable(5e-3, 0.5, standard=False),
    ] = 0.06
    memory: Annotated[
        float,
        at.Gt(0),
        Quantity("s", "age at which a sample counts 1/e of a fresh one", "assumption"),
        Tunable(5, 500, standard=False),
    ] = 60.0


@dataclass(frozen=True)
class RopeKnowledge:
    """What is known of one rope."""

    excess: Annotated[Scalar, Quantity("1", "compliance above the nominal one, as a share")] = 0.0
    information: Annotated[Scalar, Quantity("1", "inverse variance of the excess, from samples")] = 0.0


@dataclass(frozen=True)
class CalibratingState:
    """State of the filter and of the calibration of both ropes."""

    motion: KalmanState = field(default_factory=KalmanState)
    rope_1: RopeKnowledge = field(default_factory=RopeKnowledge)
    rope_2: RopeKnowledge = field(default_factory=RopeKnowledge)


LARGEST = 0.5
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
        taut: whether the rope pulls; a slack one teaches nothing.
        position_noise: standard deviation of the position sensor in m.
        gains: prior and memory.
        sample_time: in s.
    """
    weight = where(taut, stretch / position_noise**2, 0.0)
    information = exp(-sample_time / gains.memory) * known.information + weight * stretch
    surprise = seen - (1 + known.excess) * stretch
    excess = known.excess + weight * surprise / (information + 1 / gains.spread**2)
    return RopeKnowledge(clip(excess, -LARGEST, LARGEST), information)


def calibrating_kalman_step(
    state: CalibratingState,
    measurement: Measurement,
    controller: "Controller",
    nominal: Plant,
    sample_time: Scalar,
) -> tuple[CalibratingState, Seen]:
    """One sample: learn of the ropes, then filter the motion with what is known of them.

    Args:
        state: what was known and expected.
        measurement: what was measured.
        controller: gains, and tension_min, which tells a slack rope.
        nominal: the plant as the controller believes it to be.
        sample_time: in s.

    Returns:
        The next state, and the measurement with the estimated position and speed in place of the measured ones.
    """
    length_1, length_2 = rope_lengths(state.motion.x, nominal.track)
    taut = TAUT * controller.coordination.tension_min
    noise, gains = controller.kalman.position_noise, controller.calibration
    F1, F2 = measurement.F1, measurement.F2
    rope_1 = learn(
        state.rope_1,
        F1 / stiffness(length_1, nominal.rope_1),
        nominal.winch_1.drum_radius * measurement.theta_1 - measurement.x,
        taut < F1,
        noise,
        gains,
        sample_time,
    )
    rope_2 = learn(
        state.rope_2,
        F2 / stiffness(length_2, nominal.rope_2),
        nominal.winch_2.drum_radius * measurement.theta_2 + measurement.x,
        taut < F2,
        noise,
        gains,
        sample_time,
    )
    calibrated = replace(
        nominal, rope_1=_calibrated(nominal.rope_1, rope_1), rope_2=_calibrated(nominal.rope_2, rope_2)
    )
    motion, seen = kalman_step(state.motion, measurement, controller, calibrated, sample_time)
    return CalibratingState(motion, rope_1, rope_2), seen


def _calibrated(rope: Rope, known: RopeKnowledge) -> Rope:
    """The nominal rope, as elastic as it is known to be."""
    return replace(rope, modulus=rope.modulus / (1 + known.excess))
