"""Sensors: noise, bias, lag, resolution and outages of the measurements (all perfect by default)."""

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, TypeAlias

import annotated_types as at

from dualwinch.controllers.parts import Measurement
from dualwinch.model.plant import Plant, PlantState
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.part import NO_STATE
from dualwinch.model.quantities.quantity import Mark, NonNegative, Positive, Quantity
from dualwinch.model.scalar import Scalar, both, clip, exp, floor, maximum, present, quantise, where
from dualwinch.model.winch import cell_tension
from dualwinch.simulation.lateness import (
    PastMotion,
    PastPulls,
    PastTurns,
    change_since,
    filled,
    remembered,
    value_before,
)

Silence: TypeAlias = Literal["held", "missing"]
SpeedSensor: TypeAlias = Literal["wheel", "none"]
TensionSensor: TypeAlias = Literal["load-cells", "none"]


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
    position_delay: Annotated[
        NonNegative,
        at.Le(1),
        Quantity("s", "time by which the position reading is late", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    position_rate: Annotated[
        NonNegative,
        Quantity("1/s", "readings of the position a second, each held until the next; 0: one a sample", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    speed: Annotated[
        SpeedSensor, Quantity("", "sensor of the speed; none: no reading, for filters that do without", "")
    ] = "wheel"
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
    speed_delay: Annotated[
        NonNegative,
        at.Le(1),
        Quantity("s", "time by which the speed reading is late", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    tension: Annotated[
        TensionSensor,
        Quantity("", "sensors of the tensions; none: no readings, for controllers that estimate them", ""),
    ] = "load-cells"
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
    tension_delay: Annotated[
        NonNegative,
        at.Le(1),
        Quantity("s", "time by which the tension readings are late", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    encoder_delay: Annotated[
        NonNegative,
        at.Le(1),
        Quantity("s", "time by which the drums' angles are late, and speeds that are their differences", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
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
    fault_start: Annotated[
        NonNegative, Quantity("s", "time at which the faults below begin", "assumption"), Mark.SHAPE_PARAMETER
    ] = 20.0
    fault_length: Annotated[
        Positive, Quantity("s", "time that the faults last", "assumption"), Mark.SHAPE_PARAMETER
    ] = 0.5
    fault_period: Annotated[
        Positive, Quantity("s", "time after which they come again", "assumption"), Mark.SHAPE_PARAMETER
    ] = 1e3
    position_fault: Annotated[
        float,
        Quantity("m", "error of the position during a fault, as by multipath", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    speed_fault: Annotated[
        float,
        Quantity("1", "share by which the speed wheel reads more during a fault, as it slips", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    encoder_fault_1: Annotated[
        float,
        Quantity("m", "rope that drum encoder 1 loses in every fault, as its coupling slips", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    encoder_fault_2: Annotated[
        float,
        Quantity("m", "rope that drum encoder 2 loses in every fault, as its coupling slips", "assumption"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    load_cell_drift_1: Annotated[
        float, Quantity("N", "drift of load cell 1 since the run's beginning", "assumption"), Mark.SHAPES_CODE_AT_ZERO
    ] = 0.0
    load_cell_drift_2: Annotated[
        float, Quantity("N", "drift of load cell 2 since the run's beginning", "assumption"), Mark.SHAPES_CODE_AT_ZERO
    ] = 0.0
    load_cell_drift_time: Annotated[
        Positive,
        Quantity("s", "time after which a load cell has drifted by the share 1 − 1/e", "assumption"),
        Mark.SHAPE_PARAMETER,
    ] = 15.0
    memory: Annotated[
        int,
        at.Ge(2),
        at.Le(1000),
        Quantity("1", "samples that the longest of these delays may take", "simulation.lateness"),
        Mark.SHAPES_CODE,
    ] = 32

    @property
    def position_deviation(self) -> float:
        """Standard deviation in m of a reading of the position: its noise, and its rounding as uniform noise."""
        return math.hypot(self.position_noise, self.position_resolution / math.sqrt(12))


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
    motion: Any = NO_STATE
    turns: Any = NO_STATE
    pulls: Any = NO_STATE


@dataclass(frozen=True)
class HeldReadings(Readings):
    """Readings of the last sample, where that of the position sensor may be held."""

    x: Annotated[Scalar, Quantity("m", "last reading of the position sensor"), Mark.BOOKKEEPING] = 0.0


SHAPING = tuple(key for key, leaf in describe(Sensors).items() if Mark.SHAPES_CODE_AT_ZERO in leaf.marks)
"""Fields whose effect is in the compiled code only where they are not zero."""

DELAYS = tuple(name for name in SHAPING if name.endswith("_delay"))
"""Fields that are delays, in s."""

FAULTS = tuple(name for name in SHAPING if "fault" in name or "cell_drift" in name)
"""Fields that are sizes of faults."""


def sensors_structure(sensors: Sensors) -> Sensors:
    """Sensors of the same compiled code, with placeholder numbers."""
    shaping: dict[str, Any] = {name: 1.0 for name in SHAPING if present(getattr(sensors, name))}
    if silence := silence_of(sensors):
        shaping["outage"] = silence
    if not shaping.keys().isdisjoint(DELAYS):
        shaping["memory"] = sensors.memory
    return Sensors(**shaping, speed=sensors.speed, tension=sensors.tension)


def delays_beyond_memory(sensors: Sensors, sample_time: Scalar) -> dict[str, Any]:
    """Whether each delay takes more samples than `Sensors.memory` has, by the field's name."""
    longest = sensors.memory * sample_time * (1 + 1e-9)
    return {name: getattr(sensors, name) > longest for name in DELAYS}


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
    decay = exp(-samples)
    behind = cells.F1 - tensions[0], cells.F2 - tensions[1]
    carried = (tension + decay * lag for tension, lag in zip(tensions, behind, strict=True))
    seen_1, seen_2 = (t + (1 - decay) / samples * lag for t, lag in zip(tensions, behind, strict=True))
    return LoadCells(*carried), (seen_1, seen_2)


def first_readings(state: PlantState, tension: Scalar, plant: Plant, sensors: Sensors, silence: Silence | None) -> Any:
    """Readings before the first sample, at rest with both ropes at a tension in N; of position only if it is held."""
    exact, length = measurement(state, (tension, tension), plant, sensors), sensors.memory
    past: dict[str, Any] = {}
    if present(sensors.load_cell_time_constant):
        past["load_cells"] = LoadCells(tension, tension)
    if present(sensors.position_delay) or present(sensors.speed_delay):
        past["motion"] = PastMotion(filled(0.0, length))
    if present(sensors.encoder_delay):
        past["turns"] = PastTurns(filled(0.0, length), filled(0.0, length))
    if present(sensors.tension_delay):
        past["pulls"] = PastPulls(filled(tension, length), filled(tension, length))
    readings = Readings(**read_encoders(exact, plant, sensors), **past)
    is_held = silence == "held" or present(sensors.position_rate)
    return HeldReadings(**vars(readings), x=exact.x) if is_held else readings


def measure(
    state: PlantState,
    tensions: tuple[Scalar, Scalar],
    noise: Noise,
    last: Readings,
    plant: Plant,
    sensors: Sensors,
    sample_time: Scalar,
    silence: Silence | None = None,
    number: Scalar = 0.0,
) -> tuple[Readings, Measurement]:
    """Readings of one sample, which the next sample needs, and the measurement.

    Sample time in s, tensions in N without errors. Where drives do not measure drum speeds, these are differences of
    encoder readings over the sample time. `silence` is `silence_of` these sensors, `number` that of the sample.
    """
    tensions = at_load_cells(state, tensions, plant)
    carried = last.load_cells
    if isinstance(carried, LoadCells):
        carried, tensions = load_cells(carried, tensions, sensors, sample_time)
    past, tensions = late_tensions(last, tensions, sensors, sample_time)
    exact = measurement(state, tensions, plant, sensors, sensors.position_drift * noise.drift)
    past, exact = late_motion(past, exact, state, sensors, sample_time)
    exact = faulty(exact, plant, sensors, number * sample_time)
    now = replace(past, **read_encoders(exact, plant, sensors), load_cells=carried)
    x = quantise(exact.x + sensors.position_noise * noise.position, sensors.position_resolution)
    if isinstance(last, HeldReadings):
        if present(sensors.position_rate):
            x = where(is_due(number, sensors.position_rate * sample_time), x, last.x)
        if silence == "held":
            x = where(noise.silent > 0, last.x, x)
        now = replace(now, x=x)
    if silence == "missing":
        x = where(noise.silent > 0, math.nan, x)
    return now, Measurement(
        x=x,
        v=math.nan if sensors.speed == "none" else exact.v + sensors.speed_noise * noise.speed,
        F1=math.nan if sensors.tension == "none" else exact.F1 + sensors.tension_noise * noise.tension_1,
        F2=math.nan if sensors.tension == "none" else exact.F2 + sensors.tension_noise * noise.tension_2,
        omega_1=drum_speed(exact.omega_1, (now.theta_1 - last.theta_1) / sample_time, sensors),
        omega_2=drum_speed(exact.omega_2, (now.theta_2 - last.theta_2) / sample_time, sensors),
        theta_1=now.theta_1,
        theta_2=now.theta_2,
    )


def at_load_cells(state: PlantState, tensions: tuple[Scalar, Scalar], plant: Plant) -> tuple[Scalar, Scalar]:
    """Tensions in N at the load cells, for those of the ropes beyond their sheaves."""
    cell_1, cell_2 = (
        cell_tension(tension, omega, side.winch)
        for tension, (_, omega), side in zip(tensions, state.drums, plant.sides, strict=True)
    )
    return cell_1, cell_2


ROUNDING = 1e-6
"""Share of an interval by which a reading may be due earlier, as multiples of a sample time are rounded."""


def is_due(number: Scalar, share: Scalar) -> Scalar:
    """Whether a sensor reads in the sample of a number, of which it has a `share` of readings."""
    return floor(number * share + ROUNDING) > floor((number - 1) * share + ROUNDING)


def faulty(exact: Measurement, plant: Plant, sensors: Sensors, t: Scalar) -> Measurement:
    """The measurement with the sensors' faults at the time t in s.

    Faults come in intervals, in which the position is off, the wheel slips, and the encoders lose a length of rope at
    a constant rate. Load cells drift exponentially from the beginning, as they warm.
    """
    since = t - sensors.fault_start
    count = maximum(floor(since / sensors.fault_period), 0.0)
    share = (since - count * sensors.fault_period) / sensors.fault_length
    active, lost = both(share >= 0, share < 1), count + clip(share, 0.0, 1.0)
    drifted = 1 - exp(-t / sensors.load_cell_drift_time)
    readings: dict[str, Scalar] = {}
    if present(sensors.position_fault):
        readings["x"] = exact.x + active * sensors.position_fault
    if present(sensors.speed_fault):
        readings["v"] = exact.v * (1 + active * sensors.speed_fault)
    for side in plant.sides:
        if present(drift := getattr(sensors, f"load_cell_drift_{side.number}")):
            readings[f"F{side.number}"] = getattr(exact, f"F{side.number}") + drifted * drift
        if present(rope := getattr(sensors, f"encoder_fault_{side.number}")):
            angle = f"theta_{side.number}"
            readings[angle] = getattr(exact, angle) - lost * rope / side.winch.drum_radius
    return replace(exact, **readings)


def late_tensions(
    last: Readings, tensions: tuple[Scalar, Scalar], sensors: Sensors, sample_time: Scalar
) -> tuple[Readings, tuple[Scalar, Scalar]]:
    """The tensions in N as load cells report them, late, and the readings with these tensions remembered."""
    if not isinstance(pulls := last.pulls, PastPulls):
        return last, tensions
    delay = sensors.tension_delay / sample_time
    memories = pulls.F1, pulls.F2
    late_1, late_2 = (value_before(delay, now, memory) for now, memory in zip(tensions, memories, strict=True))
    memory = PastPulls(*(remembered(now, memory) for now, memory in zip(tensions, memories, strict=True)))
    return replace(last, pulls=memory), (late_1, late_2)


def late_motion(
    last: Readings, exact: Measurement, state: PlantState, sensors: Sensors, sample_time: Scalar
) -> tuple[Readings, Measurement]:
    """The measurement of motion and drums as late sensors report it, and the readings with these speeds remembered."""
    delays: dict[str, Scalar] = {}
    if isinstance(motion := last.motion, PastMotion):
        if present(sensors.position_delay):
            way = change_since(sensors.position_delay / sample_time, state.v, motion.v, sample_time)
            delays["x"] = exact.x - way
        if present(sensors.speed_delay):
            speed = value_before(sensors.speed_delay / sample_time, state.v, motion.v)
            delays["v"] = (1 + sensors.speed_error) * speed
        last = replace(last, motion=PastMotion(remembered(state.v, motion.v)))
    if isinstance(turns := last.turns, PastTurns):
        delay, memories = sensors.encoder_delay / sample_time, (turns.omega_1, turns.omega_2)
        for number, (_, omega), memory in zip((1, 2), state.shafts, memories, strict=True):
            turned = change_since(delay, omega, memory, sample_time)
            delays[f"theta_{number}"] = getattr(exact, f"theta_{number}") - turned
            if not present(sensors.drum_speed_resolution):
                delays[f"omega_{number}"] = value_before(delay, omega, memory)
        of_shafts = (remembered(omega, memory) for (_, omega), memory in zip(state.shafts, memories, strict=True))
        last = replace(last, turns=PastTurns(*of_shafts))
    return last, replace(exact, **delays)
