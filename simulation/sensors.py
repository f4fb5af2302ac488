"""Sensors: noise, bias, lag, resolution and outages of the measurements (all perfect by default)."""

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, TypeAlias

import annotated_types as at

from dualwinch.controllers.parts import Measurement
from dualwinch.model.plant import Plant, PlantState
from dualwinch.model.quantities.part import NO_STATE
from dualwinch.model.quantities.quantity import Mark, NonNegative, Positive, Quantity
from dualwinch.model.scalar import Scalar, exp, maximum, present, quantise, where

Silence: TypeAlias = Literal["held", "missing"]


@dataclass(frozen=True)
class Sensors:
    """Errors of the sensors; 0 is a perfect sensor."""

    position_noise: Annotated[
        NonNegative, Quantity("m", "white noise of the position", "assumption"), Mark.OFF_AT_ZERO, Mark.SCALES_DRAWS
    ] = 0.0
    position_resolution: Annotated[
        NonNegative, Quantity("m", "step of the position reading", "assumption"), Mark.OFF_AT_ZERO, Mark.READS_IN_STEPS
    ] = 0.0
    position_bias: Annotated[
        float,
        at.Ge(-0.1),
        at.Le(0.1),
        Quantity("m", "reading at the track's beginning; references and errors are in its frame", "assumption"),
        Mark.UNKNOWN,
        Mark.OFF_AT_ZERO,
    ] = 0.0
    position_drift: Annotated[
        NonNegative,
        Quantity("m", "drift of the position since the run's beginning, long-term standard deviation", "assumption"),
        Mark.UNKNOWN,
        Mark.OFF_AT_ZERO,
        Mark.SCALES_DRAWS,
    ] = 0.0
    position_drift_time: Annotated[
        Positive,
        Quantity("s", "correlation time of the drift (first-order Gauss–Markov)", "assumption"),
        Mark.DRAWN_AHEAD,
        Mark.SHAPE_PARAMETER,
    ] = 600.0
    outage_length: Annotated[
        NonNegative,
        Quantity("s", "mean length of the position sensor's outages, drawn within ±50 %; 0: none", "assumption"),
        Mark.DRAWN_AHEAD,
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    outage_period: Annotated[
        Positive,
        Quantity("s", "period in which one outage occurs, at a random time", "assumption"),
        Mark.DRAWN_AHEAD,
        Mark.SHAPE_PARAMETER,
    ] = 5.0
    outage: Annotated[
        Silence, Quantity("", "reading of a silent position sensor: its last one (held), or no number (missing)", "")
    ] = "held"
    speed_noise: Annotated[
        NonNegative, Quantity("m/s", "white noise of the speed", "assumption"), Mark.OFF_AT_ZERO, Mark.SCALES_DRAWS
    ] = 0.0
    speed_error: Annotated[
        float,
        at.Gt(-1),
        at.Le(1),
        Quantity("1", "share by which the speed wheel reads more than the speed", "assumption"),
        Mark.UNKNOWN,
        Mark.OFF_AT_ZERO,
    ] = 0.0
    tension_noise: Annotated[
        NonNegative, Quantity("N", "white noise of both tensions", "assumption"), Mark.OFF_AT_ZERO, Mark.SCALES_DRAWS
    ] = 0.0
    load_cell_time_constant: Annotated[
        NonNegative,
        Quantity(
            "s", "time constant of both load cells with their amplifiers; 0: none", "1/(2 pi bandwidth), assumption"
        ),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    load_cell_error_1: Annotated[
        float,
        at.Gt(-1),
        at.Le(1),
        Quantity("1", "share by which load cell 1 reads more than the tension", "assumption"),
        Mark.UNKNOWN,
        Mark.OFF_AT_ZERO,
    ] = 0.0
    load_cell_error_2: Annotated[
        float,
        at.Gt(-1),
        at.Le(1),
        Quantity("1", "share by which load cell 2 reads more than the tension", "assumption"),
        Mark.UNKNOWN,
        Mark.OFF_AT_ZERO,
    ] = 0.0
    load_cell_zero_1: Annotated[
        float, Quantity("N", "reading of load cell 1 without tension", "assumption"), Mark.UNKNOWN, Mark.OFF_AT_ZERO
    ] = 0.0
    load_cell_zero_2: Annotated[
        float, Quantity("N", "reading of load cell 2 without tension", "assumption"), Mark.UNKNOWN, Mark.OFF_AT_ZERO
    ] = 0.0
    encoder_counts: Annotated[
        int,
        at.Ge(0),
        Quantity("1", "drum encoder counts a motor turn; 0: perfect", "assumption"),
        Mark.OFF_AT_ZERO,
        Mark.READS_IN_STEPS,
    ] = 0
    drum_speed_resolution: Annotated[
        NonNegative,
        Quantity(
            "rad/s",
            "resolution of the drums' speeds as drives measure them; 0: differences of two encoder readings",
            "assumption",
        ),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    encoder_zero_1: Annotated[
        float,
        at.Ge(-1),
        at.Le(1),
        Quantity("m", "zero error of drum encoder 1, in length of rope", "assumption"),
        Mark.UNKNOWN,
        Mark.OFF_AT_ZERO,
    ] = 0.0
    encoder_zero_2: Annotated[
        float,
        at.Ge(-1),
        at.Le(1),
        Quantity("m", "zero error of drum encoder 2, in length of rope", "assumption"),
        Mark.UNKNOWN,
        Mark.OFF_AT_ZERO,
    ] = 0.0


@dataclass(frozen=True)
class Noise:
    """Random draws of one sample, standard normal unless stated otherwise."""

    position: Annotated[Scalar, Quantity("1", "draw of the position sensor")] = 0.0
    speed: Annotated[Scalar, Quantity("1", "draw of the speed sensor")] = 0.0
    tension_1: Annotated[Scalar, Quantity("1", "draw of tension sensor 1")] = 0.0
    tension_2: Annotated[Scalar, Quantity("1", "draw of tension sensor 2")] = 0.0
    drift: Annotated[Scalar, Quantity("1", "drift of the position sensor over its standard deviation")] = 0.0
    lateness: Annotated[Scalar, Quantity("1", "lateness of the next sample over the largest, -1 to 1")] = 0.0
    silent: Annotated[Scalar, Quantity("1", "1 while the position sensor is silent")] = 0.0


@dataclass(frozen=True)
class LoadCells:
    """Filter states of load cells with a lag."""

    F1: Annotated[Scalar, Quantity("N", "tensions before, as load cell 1 remembers them")]
    F2: Annotated[Scalar, Quantity("N", "tensions before, as load cell 2 remembers them")]


@dataclass(frozen=True)
class Readings:
    """Readings of the last sample."""

    theta_1: Annotated[Scalar, Quantity("rad", "last reading of drum encoder 1"), Mark.BOOKKEEPING] = 0.0
    theta_2: Annotated[Scalar, Quantity("rad", "last reading of drum encoder 2"), Mark.BOOKKEEPING] = 0.0
    load_cells: Any = NO_STATE


@dataclass(frozen=True)
class HeldReadings(Readings):
    """Readings of the last sample, where the position sensor may fall silent."""

    x: Annotated[Scalar, Quantity("m", "last reading of the position sensor"), Mark.BOOKKEEPING] = 0.0


def sensors_structure(sensors: Sensors) -> Sensors:
    """Sensors of the same compiled code, with placeholder numbers."""
    silence = silence_of(sensors)
    outages = {"outage": silence, "outage_length": 1.0} if silence else {}
    shaping: dict[str, Any] = {
        name: 1.0 for name in ("load_cell_time_constant", "drum_speed_resolution") if present(getattr(sensors, name))
    }
    return Sensors(**outages, **shaping)


def silence_of(sensors: Sensors) -> Silence | None:
    """Reading of the position sensor during an outage; None: it has no outages."""
    return sensors.outage if sensors.outage_length > 0 else None


def encoder_step(gear_ratio: Scalar, sensors: Sensors) -> Scalar:
    """Drum angle per encoder count in rad; 0 for a perfect encoder."""
    counts = sensors.encoder_counts
    return where(counts > 0, 2 * math.pi / (gear_ratio * maximum(counts, 1)), 0.0)


def measurement(
    state: PlantState, tensions: tuple[Scalar, Scalar], plant: Plant, sensors: Sensors, drift: Scalar = 0.0
) -> Measurement:
    """Evaluate the measurement equation: readings without noise and rounding, encoders on the motor shafts.

    Tensions are the true ones in N, the drift of the position sensor is in m.
    """
    (shaft_1, speed_1), (shaft_2, speed_2) = state.shafts
    return Measurement(
        x=state.x + (sensors.position_bias + drift),
        v=(1 + sensors.speed_error) * state.v,
        F1=(1 + sensors.load_cell_error_1) * tensions[0] + sensors.load_cell_zero_1,
        F2=(1 + sensors.load_cell_error_2) * tensions[1] + sensors.load_cell_zero_2,
        omega_1=speed_1,
        omega_2=speed_2,
        theta_1=shaft_1 + sensors.encoder_zero_1 / plant.winch_1.drum_radius,
        theta_2=shaft_2 + sensors.encoder_zero_2 / plant.winch_2.drum_radius,
    )


def read_encoders(exact: Measurement, plant: Plant, sensors: Sensors) -> dict[str, Scalar]:
    """Drum angles in rad, rounded to encoder counts, by their names in `Readings`."""
    return {
        "theta_1": quantise(exact.theta_1, encoder_step(plant.winch_1.gear_ratio, sensors)),
        "theta_2": quantise(exact.theta_2, encoder_step(plant.winch_2.gear_ratio, sensors)),
    }


def drum_speed(exact: Scalar, difference: Scalar, sensors: Sensors) -> Scalar:
    """A drum's speed in rad/s: measured by its drive at the drive's own rate, else from two encoder readings."""
    by_encoder = where(sensors.encoder_counts > 0, difference, exact)
    if not present(resolution := sensors.drum_speed_resolution):
        return by_encoder
    return where(resolution > 0, quantise(exact, resolution), by_encoder)


def load_cells(
    cells: LoadCells, tensions: tuple[Scalar, Scalar], sensors: Sensors, sample_time: Scalar
) -> tuple[LoadCells, tuple[Scalar, Scalar]]:
    """Filter states and readings in N of load cells with a first-order lag, at tensions in N.

    Exact for tensions that change linearly from sample to sample (first-order hold): with the time
    constant T, the sample time h and a = exp(−h/T), a reading y = F + (1 − a) T/h (w − F) and w' = F + a (w − F).
    """
    samples = sample_time / sensors.load_cell_time_constant
    left = exp(-samples)
    behind = cells.F1 - tensions[0], cells.F2 - tensions[1]
    carried = (tension + left * late for tension, late in zip(tensions, behind, strict=True))
    seen_1, seen_2 = (t + (1 - left) / samples * late for t, late in zip(tensions, behind, strict=True))
    return LoadCells(*carried), (seen_1, seen_2)


def first_readings(state: PlantState, tension: Scalar, plant: Plant, sensors: Sensors, silence: Silence | None) -> Any:
    """Readings before the first sample with both ropes at a tension in N; of position only if outages hold it."""
    exact = measurement(state, (tension, tension), plant, sensors)
    cells = LoadCells(tension, tension) if present(sensors.load_cell_time_constant) else NO_STATE
    encoders = Readings(**read_encoders(exact, plant, sensors), load_cells=cells)
    return HeldReadings(**vars(encoders), x=exact.x) if silence == "held" else encoders


def measure(
    state: PlantState,
    tensions: tuple[Scalar, Scalar],
    noise: Noise,
    last: Readings,
    plant: Plant,
    sensors: Sensors,
    sample_time: Scalar,
    silence: Silence | None = None,
) -> tuple[Readings, Measurement]:
    """Readings of one sample, which the next sample needs, and the measurement.

    Sample time in s, tensions in N without errors. Where drives do not measure drum speeds, these are differences of
    encoder readings over the sample time. `silence` is `silence_of` these sensors.
    """
    carried = last.load_cells
    if isinstance(carried, LoadCells):
        carried, tensions = load_cells(carried, tensions, sensors, sample_time)
    exact = measurement(state, tensions, plant, sensors, sensors.position_drift * noise.drift)
    now = replace(last, **read_encoders(exact, plant, sensors), load_cells=carried)
    x = quantise(exact.x + sensors.position_noise * noise.position, sensors.position_resolution)
    if silence and isinstance(last, HeldReadings):
        x = where(noise.silent > 0, last.x, x)
        now = replace(now, x=x)
    elif silence:
        x = where(noise.silent > 0, math.nan, x)
    return now, Measurement(
        x=x,
        v=exact.v + sensors.speed_noise * noise.speed,
        F1=exact.F1 + sensors.tension_noise * noise.tension_1,
        F2=exact.F2 + sensors.tension_noise * noise.tension_2,
        omega_1=drum_speed(exact.omega_1, (now.theta_1 - last.theta_1) / sample_time, sensors),
        omega_2=drum_speed(exact.omega_2, (now.theta_2 - last.theta_2) / sample_time, sensors),
        theta_1=now.theta_1,
        theta_2=now.theta_2,
    )
