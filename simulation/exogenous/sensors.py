"""Sensors: what the controller sees of the plant (all perfect by default)."""

import math
from dataclasses import dataclass
from typing import Annotated

import annotated_types as at

from dualwinch.controllers.signals import Measurement
from dualwinch.model.plant import Plant, PlantState
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.scalar import Scalar, maximum, rounded, where


@dataclass(frozen=True)
class Sensors:
    """Errors of the sensors; 0 is a perfect one."""

    position_noise: Annotated[
        float, at.Ge(0), Quantity("m", "white noise of the position", "assumption"), Mark.OFF_AT_ZERO
    ] = 0.0
    position_resolution: Annotated[
        float,
        at.Ge(0),
        Quantity("m", "step of the position reading", "assumption"),
        Mark.OFF_AT_ZERO,
        Mark.READS_IN_STEPS,
    ] = 0.0
    speed_noise: Annotated[
        float, at.Ge(0), Quantity("m/s", "white noise of the speed", "assumption"), Mark.OFF_AT_ZERO
    ] = 0.0
    tension_noise: Annotated[
        float, at.Ge(0), Quantity("N", "white noise of both tensions", "assumption"), Mark.OFF_AT_ZERO
    ] = 0.0
    encoder_counts: Annotated[
        int,
        at.Ge(0),
        Quantity("1", "drum encoder counts a motor turn; 0: perfect", "assumption"),
        Mark.OFF_AT_ZERO,
        Mark.READS_IN_STEPS,
    ] = 0


@dataclass(frozen=True)
class Noise:
    """Standard normal draws of one sample, one for each noisy sensor."""

    position: Annotated[Scalar, Quantity("1", "draw of the position sensor")] = 0.0
    speed: Annotated[Scalar, Quantity("1", "draw of the speed sensor")] = 0.0
    tension_1: Annotated[Scalar, Quantity("1", "draw of tension sensor 1")] = 0.0
    tension_2: Annotated[Scalar, Quantity("1", "draw of tension sensor 2")] = 0.0


@dataclass(frozen=True)
class EncoderState:
    """Drum angles as the encoders gave them at the last sample."""

    theta_1: Annotated[Scalar, Quantity("rad", "last reading of drum 1"), Mark.BOOKKEEPING] = 0.0
    theta_2: Annotated[Scalar, Quantity("rad", "last reading of drum 2"), Mark.BOOKKEEPING] = 0.0


def quantise(value: Scalar, step: Scalar) -> Scalar:
    """The value rounded to a multiple of `step`; unchanged where the step is 0."""
    return value + where(step > 0, step * rounded(value / maximum(step, 1e-100)) - value, 0.0)


def encoder_step(gear_ratio: Scalar, sensors: Sensors) -> Scalar:
    """Drum angle in rad of one encoder count; 0 for a perfect encoder."""
    counts = sensors.encoder_counts
    return where(counts > 0, 2 * math.pi / (gear_ratio * maximum(counts, 1)), 0.0)


def read_encoders(state: PlantState, plant: Plant, sensors: Sensors) -> EncoderState:
    """Drum angles in rad as the encoders give them."""
    return EncoderState(
        theta_1=quantise(state.theta_1, encoder_step(plant.winch_1.gear_ratio, sensors)),
        theta_2=quantise(state.theta_2, encoder_step(plant.winch_2.gear_ratio, sensors)),
    )


def measure(
    state: PlantState,
    tensions: tuple[Scalar, Scalar],
    noise: Noise,
    last: EncoderState,
    plant: Plant,
    sensors: Sensors,
    sample_time: Scalar,
) -> tuple[EncoderState, Measurement]:
    """Sensor values of one sample.

    Args:
        state: the plant's state.
        tensions: true tensions in N.
        noise: this sample's draws.
        last: the encoders' last reading.
        plant: gives the gear ratios.
        sensors: errors of the sensors.
        sample_time: in s; a drum speed is the difference of two encoder readings over it.

    Returns:
        The encoders' reading, to be kept for the next sample, and the measurement.
    """
    now = read_encoders(state, plant, sensors)
    counting = sensors.encoder_counts > 0
    measured = Measurement(
        x=quantise(state.x + sensors.position_noise * noise.position, sensors.position_resolution),
        v=state.v + sensors.speed_noise * noise.speed,
        F1=tensions[0] + sensors.tension_noise * noise.tension_1,
        F2=tensions[1] + sensors.tension_noise * noise.tension_2,
        omega_1=where(counting, (now.theta_1 - last.theta_1) / sample_time, state.omega_1),
        omega_2=where(counting, (now.theta_2 - last.theta_2) / sample_time, state.omega_2),
        theta_1=now.theta_1,
        theta_2=now.theta_2,
    )
    return now, measured
