"""Rope tensions of machines without load cells, from the motors' torques and the speeds of the drums.

A drum of the inertia J, behind a gear of the ratio G, on which a rope pulls with F at the radius R::

    J dω/dt = G τ − R F − friction

The momentum observer (De Luca and Mattone, Sensorless robot collision detection and hybrid force/motion control,
IEEE International Conference on Robotics and Automation, 2005) estimates F without an acceleration::

    F̂ = w − K J ω/R,   dw/dt = K ((G τ − friction)/R − F̂)

so that F̂ is F behind a low-pass of the bandwidth K. Torque and friction are the commanded and the nominal ones: what
they are wrong by, F̂ is wrong by. The bandwidth is below that of the drives, whose lag is left out.
"""

from dataclasses import dataclass, field, replace
from typing import Annotated

from dualwinch.controllers.parts import CoordinationOutput, Measurement
from dualwinch.model.plant import Plant, Side
from dualwinch.model.quantities.quantity import Mark, NonNegative, Quantity
from dualwinch.model.scalar import Scalar, has_begun, maximum, where
from dualwinch.model.winch import friction_torque, total_inertia


@dataclass(frozen=True)
class TensionObserver:
    """Tensions estimated from torques and drum speeds."""

    bandwidth: Annotated[
        NonNegative,
        Quantity("rad/s", "bandwidth of tensions estimated from torques and drum speeds; 0: load cells are read", ""),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0


@dataclass(frozen=True)
class DrumMomentum:
    """State of the observer of one drum."""

    momentum: Annotated[Scalar, Quantity("N", "estimated tension with the drum's momentum")] = 0.0
    torque: Annotated[Scalar, Quantity("N m", "torque command of the last sample")] = 0.0


@dataclass(frozen=True)
class TensionState:
    """State of the observers of both drums."""

    drum_1: DrumMomentum = field(default_factory=DrumMomentum)
    drum_2: DrumMomentum = field(default_factory=DrumMomentum)
    begun: Annotated[Scalar, Quantity("1", "0 before the first sample, then 1")] = 0.0


def observed_tension(
    drum: DrumMomentum, omega: Scalar, side: Side, bandwidth: Scalar, sample_time: Scalar
) -> tuple[Scalar, Scalar]:
    """Tension in N at a drum's speed in rad/s, and the observer's momentum in N, by backward Euler.

    A drum that hangs on a rope cannot be pushed by it: an estimate below zero is zero.
    """
    winch = side.winch
    radius, share = winch.drum_radius, bandwidth * sample_time
    pull = (winch.gear_ratio * drum.torque - friction_torque(omega, winch)) / radius
    inertial = bandwidth * total_inertia(winch) * omega / radius
    momentum = (drum.momentum + share * (pull + inertial)) / (1 + share)
    return maximum(momentum - inertial, 0.0), momentum


def observed(
    state: TensionState,
    measurement: Measurement,
    nominal: Plant,
    preload: Scalar,
    bandwidth: Scalar,
    sample_time: Scalar,
) -> tuple[TensionState, Measurement]:
    """The measurement with estimated tensions in place of measured ones, and the state after it.

    Before the first sample both ropes hold half of the preload in N.
    """
    drums, tensions = [], []
    speeds = measurement.omega_1, measurement.omega_2
    for side, drum, omega in zip(nominal.sides, (state.drum_1, state.drum_2), speeds, strict=True):
        winch = side.winch
        resting = DrumMomentum(
            preload / 2 + bandwidth * total_inertia(winch) * omega / winch.drum_radius,
            (winch.drum_radius * preload / 2 + friction_torque(omega, winch)) / winch.gear_ratio,
        )
        before = DrumMomentum(
            where(has_begun(state.begun), drum.momentum, resting.momentum),
            where(has_begun(state.begun), drum.torque, resting.torque),
        )
        tension, momentum = observed_tension(before, omega, side, bandwidth, sample_time)
        drums.append(replace(before, momentum=momentum))
        tensions.append(tension)
    following = TensionState(drums[0], drums[1], begun=1.0)
    return following, replace(measurement, F1=tensions[0], F2=tensions[1])


def commanded(state: TensionState, winches: CoordinationOutput) -> TensionState:
    """The state after the torque commands of a sample."""
    drum_1, drum_2 = replace(state.drum_1, torque=winches.tau_1), replace(state.drum_2, torque=winches.tau_2)
    return replace(state, drum_1=drum_1, drum_2=drum_2)
