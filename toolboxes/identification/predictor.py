"""Predictor of the machine under recorded torques for the filter: states, measurement equations, initial state.

The equations of motion are those of every simulation (`simulation.loop.between`, `model.actuators.drive`). The state is
augmented by unrecorded disturbances, first-order Gauss–Markov processes. Torques and disturbances are constant between
samples.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import (
    Controller,
    Experiment,
    Quantity,
    language,
    leaves,
    loops,
    nominal_model,
    parts,
    physics,
    scalar,
    sensing,
    structures,
    with_leaves,
)
from dualwinch.toolboxes.identification.options import InitialStateOptions, NoiseOptions
from dualwinch.toolboxes.identification.prediction import PredictedSystem

Floats = NDArray[np.float64]

INPUTS = ("t", "tau_1", "tau_2", "duration", "share_1", "share_2")
"""Inputs of a sample: time in s, torque commands in N m, time in s until the next sample, and factors on the unrecorded
torques."""

ROW_INPUTS = ("row_time", "elapsed", "since")
"""Further inputs with a `RecorderClock`: times in s of the step's row, from the step on if the first row is at one, and
from the first row on; and of the step since the controller's sample."""

PREDICTOR_GROUPS = ("plant", "sensors", "actuator", "disturbance", "recorder")
"""Groups of an experiment with parameters of the predictor."""

SAMPLE_TIME = "simulation.sample_time"

LEAST_TIME = float(np.finfo(float).eps ** 0.5)
"""Added in s to the time from a sample to its row, which may be zero, where the integrator divides by it."""

LEAST_COEFFICIENT = float(np.finfo(float).eps ** 0.75)
"""Added to coefficients in denominators, which may be zero; their forces are zero then."""


READINGS: tuple[str, ...] = ("x", "v", "F1", "F2", "theta_1", "theta_2", "omega_1", "omega_2")
"""Readings that a log may have, in the order of their columns."""


@dataclass(frozen=True)
class RecorderClock:
    """Clock of a recorder that does not sample when the controller does.

    A row ``t`` after the first one is ``phase + (1 + rate_error) t`` after the controller's sample before the first.
    """

    phase: Annotated[float, Quantity("s", "time of the log's first row after the controller's last sample")] = 0.0
    rate_error: Annotated[float, Quantity("1", "share by which the controller's clock is faster")] = 0.0
    steps: Annotated[int, Quantity("1", "steps of the filter per sample of the controller")] = 1
    interpolated: Annotated[
        bool, Quantity("", "rows are interpolated linearly between the samples, as by resampling, not measured")
    ] = False


CLOCK = ("recorder.phase", "recorder.rate_error")
"""Keys of the parameters of a recorder's clock."""


@dataclass(frozen=True)
class RecordedExperiment(Experiment):
    """An experiment whose log has a recorder with a clock of its own.

    Readings are predicted to the time of each row, between two samples (continuous-discrete filter).
    """

    recorder: RecorderClock = RecorderClock()


@dataclass(frozen=True)
class RecordedStructure(structures.LoopStructure):
    """The structure of the code of a predictor for a recorder with a clock of its own."""

    recorder: RecorderClock = RecorderClock()


def recorded(experiment: Experiment, recorder: RecorderClock) -> RecordedExperiment:
    """An experiment with a recorder; its sample time and delay are those of the filter's steps."""
    groups: dict[str, Any] = {each.name: getattr(experiment, each.name) for each in fields(Experiment)}
    simulation, steps = experiment.simulation, recorder.steps
    finer = replace(
        simulation, sample_time=simulation.sample_time / steps, delay_samples=steps * simulation.delay_samples
    )
    groups["simulation"] = finer
    return RecordedExperiment(**groups, recorder=recorder)


def with_rows_at_samples(experiment: RecordedExperiment, delay_samples: int) -> Experiment:
    """The experiment of a recorder without its clock, with torques that act some of the controller's samples late."""
    groups: dict[str, Any] = {each.name: getattr(experiment, each.name) for each in fields(Experiment)}
    step = experiment.simulation.sample_time * experiment.recorder.steps
    groups["simulation"] = replace(experiment.simulation, sample_time=step, delay_samples=delay_samples)
    return Experiment(**groups)


@dataclass(frozen=True)
class UnrecordedDisturbances:
    """States of the disturbances that no log records.

    If a disturbance acts by a coefficient of the vehicle, its state is multiplied by this coefficient, because a log
    shows only the force. With the disturbance itself as a state, its size would count as information on the
    coefficient.
    """

    current: Annotated[
        scalar.Scalar, Quantity("m/s", "ambient current along the track, times the drag coefficient")
    ] = 0.0
    normal_force_variation: Annotated[
        scalar.Scalar, Quantity("N", "change of the force on the rail, times the friction coefficient")
    ] = 0.0
    force: Annotated[scalar.Scalar, Quantity("N", "unrecorded force on the vehicle along the track")] = 0.0
    torque_1: Annotated[scalar.Scalar, Quantity("N m", "unrecorded torque of motor 1")] = 0.0
    torque_2: Annotated[scalar.Scalar, Quantity("N m", "unrecorded torque of motor 2")] = 0.0
    position_drift: Annotated[scalar.Scalar, Quantity("m", "drift of the position sensor")] = 0.0


DISTURBANCES = tuple(each.name for each in fields(UnrecordedDisturbances))


@dataclass(frozen=True)
class NoVortices:
    """No states: the phase of the vortices follows from speed and time (paper Section 4.3)."""


@dataclass(frozen=True)
class VortexStates:
    """States of vortices with the integral of their frequency as phase (E4), times the drag coefficient.

    Their phase at the beginning of a motion is unknown, and does not last for ever. The force is the drag times
    ``sine sin(phase) + cosine cos(phase)``, with the phase counted from the beginning of the motion: linear in both.
    """

    sine: Annotated[scalar.Scalar, Quantity("1", "amplitude in phase, over the drag, times the drag coefficient")] = 0.0
    cosine: Annotated[scalar.Scalar, Quantity("1", "amplitude a quarter turn ahead, likewise")] = 0.0


VORTICES = "vortices"
"""Name of the process of both these states."""

CORRELATION_TIMES = tuple(f"time.{name}" for name in (*DISTURBANCES, VORTICES))
"""Correlation times of the disturbances in s, further parameters of the predictor."""


UNIFORM = 1 / math.sqrt(3)
"""Standard deviation of what is uniform between -1 and 1, as friction with a bristle state, over the largest."""


@dataclass(frozen=True)
class GaussMarkov:
    """A first-order Gauss–Markov process.

    Attributes:
        deviation: stationary standard deviation, in the disturbance's unit.
        time: correlation time in s.
    """

    deviation: float
    time: float

    def scaled(self, by: float, slower: float = 1.0) -> "GaussMarkov":
        """The process with factors on deviation and correlation time."""
        return GaussMarkov(by * self.deviation, slower * self.time)


def described_disturbances(experiment: Experiment, options: NoiseOptions) -> dict[str, GaussMarkov]:
    """The disturbances as an experiment describes them; others with the least deviation.

    The latter is not zero, because then no reading could ever correct the state.
    """
    disturbance, vehicle, sensors = experiment.disturbance, experiment.plant.vehicle, experiment.sensors
    amplitude = disturbance.vortex_amplitude if has_vortex_states(experiment) else 0.0
    smallest = options.resolution * experiment.controller.limits.tension_max
    holding = vars(physics.holding_torques(2 * smallest, experiment.plant))
    torques = {name.replace("tau", "torque"): options.min_chatter or abs(float(each)) for name, each in holding.items()}
    return {
        "current": GaussMarkov(disturbance.current_sigma, disturbance.current_time),
        "normal_force_variation": GaussMarkov(
            disturbance.normal_force_sigma * vehicle.normal_force, disturbance.normal_force_time
        ),
        "force": GaussMarkov(smallest, options.force_time),
        **{name: GaussMarkov(torque, options.torque_time) for name, torque in torques.items()},
        "position_drift": GaussMarkov(sensors.position_drift, sensors.position_drift_time),
        VORTICES: GaussMarkov(amplitude, options.vortex_time),
    }


def has_vortex_states(experiment: Experiment | structures.LoopStructure) -> bool:
    """Whether vortices have states (`VortexStates`)."""
    return experiment.disturbance.vortex and experiment.disturbance.integrated_phase


def per_coefficient(vehicle: physics.Vehicle) -> dict[str, Any]:
    """Disturbance with a coefficient of the vehicle → its size per unit of its state."""
    coefficients = {
        "current": vehicle.drag_coefficient,
        "normal_force_variation": vehicle.friction_coefficient,
        VORTICES: vehicle.drag_coefficient,
    }
    return {name: 1 / (own + LEAST_COEFFICIENT) for name, own in coefficients.items()}


@dataclass(frozen=True)
class NoiseCovariances:
    """Measurement noise R and process noise Q of the filter.

    Attributes:
        measurement: (readings,) variances of the sensors' noise.
        process: disturbance → its Gauss–Markov process.
        vehicle: for which the disturbances have that size. With other coefficients their forces are the same.
    """

    measurement: Floats
    process: Mapping[str, GaussMarkov]
    vehicle: physics.Vehicle

    @property
    def states(self) -> dict[str, GaussMarkov]:
        """Disturbance → Gauss–Markov process of its states (`state_names`)."""
        by = per_coefficient(self.vehicle)
        return {name: each.scaled(1 / by.get(name, 1.0)) for name, each in self.process.items()}

    def process_of(self, vehicle: physics.Vehicle) -> dict[str, GaussMarkov]:
        """Disturbance → its Gauss–Markov process on another vehicle."""
        by = per_coefficient(vehicle)
        return {name: each.scaled(by.get(name, 1.0)) for name, each in self.states.items()}


@dataclass(frozen=True)
class PredictorState:
    """State of machine and load cells, augmented by the unrecorded disturbances."""

    motion: loops.Motion
    actuator_1: Any
    actuator_2: Any
    load_cells: Any
    vortices: VortexStates | NoVortices
    unrecorded: UnrecordedDisturbances


def state_names(disturbance: str) -> tuple[str, ...]:
    """Names of the states of a disturbance, if a predictor has them."""
    if disturbance == VORTICES:
        return tuple(f"{VORTICES}.{each.name}" for each in fields(VortexStates))
    return (f"unrecorded.{disturbance}",)


def predictor_structure(experiment: Experiment) -> structures.LoopStructure:
    """The structure of the predictor's code: an experiment's, without its controller.

    Of the sensors, only a lag of the load cells shapes the code.
    """
    structure = structures.structure_of(
        replace(experiment, controller=Controller(nominal=nominal_model.Nominal()), metrics=())
    )
    disturbance = (
        physics.Disturbance(vortex=True, integrated_phase=True)
        if has_vortex_states(experiment)
        else physics.Disturbance()
    )
    sensors = sensing.Sensors(load_cell_time_constant=structure.sensors.load_cell_time_constant)
    structure = replace(structure, sensors=sensors, disturbance=disturbance, delay_samples=0, readings=False)
    if not isinstance(experiment, RecordedExperiment):
        return structure
    groups: dict[str, Any] = {each.name: getattr(structure, each.name) for each in fields(structures.LoopStructure)}
    clock = replace(experiment.recorder, phase=0.0, rate_error=0.0)
    return RecordedStructure(**groups, recorder=clock)


def state_template(structure: structures.LoopStructure) -> PredictorState:
    """A state for the names of its elements; its values have no meaning."""
    actuator = structure.actuator.initial_state()
    cells = sensing.LoadCells(0.0, 0.0) if scalar.present(structure.sensors.load_cell_time_constant) else parts.NO_STATE
    vortices = VortexStates() if has_vortex_states(structure) else NoVortices()
    return PredictorState(structure.motion, actuator, actuator, cells, vortices, UnrecordedDisturbances())


@language.GRAPHS.cached
def parameter_names(structure: structures.LoopStructure) -> tuple[str, ...]:
    """Keys of all parameters of the predictor, in their order."""
    begins = tuple(f"{group}." for group in PREDICTOR_GROUPS)
    own = (key for key in structure.parameters if key.startswith(begins))
    clock = CLOCK if isinstance(structure, RecordedStructure) else ()
    return (*own, *clock, SAMPLE_TIME, *CORRELATION_TIMES)


@language.built_once
def predicted_system(
    structure: structures.LoopStructure,
    fitted: tuple[str, ...],
    zeros: frozenset[str] = frozenset(),
    slack_substeps: int = 8,
) -> PredictedSystem:
    """The predictor's CasADi functions for a `predictor_structure`.

    `fitted` are the keys of the parameters to estimate, some of `parameter_names`; those in `zeros` stay zero
    (`simulation.loop.structure.zeros_of`). Where samples take one step of an exponential integrator, those in which a
    rope is slack or about to be take a number of Runge–Kutta steps instead.
    """
    start = state_template(structure)
    inputs = (*INPUTS, *ROW_INPUTS) if isinstance(structure, RecordedStructure) else INPUTS
    names = {"state": (*leaves(start),), "input": inputs, "parameters": parameter_names(structure)}
    symbols = {name: ca.SX.sym(name, len(elements)) for name, elements in names.items()}
    state, given, values = (
        dict(zip(elements, ca.vertsplit(symbols[name]), strict=True)) for name, elements in names.items()
    )
    values |= dict.fromkeys(zeros & values.keys(), ca.SX(0))
    groups = {
        group: with_leaves(getattr(structure, group), values, f"{group}.")
        for group in PREDICTOR_GROUPS
        if hasattr(structure, group)
    }
    plant, sample_time, now = groups["plant"], values[SAMPLE_TIME], with_leaves(start, state)
    pulls, cells = _cell_tensions(now.motion.plant, plant, given["t"]), now.load_cells
    if isinstance(cells, sensing.LoadCells):
        cells, pulls = sensing.load_cells(cells, pulls, groups["sensors"], sample_time)

    commands = physics.Torques(given["tau_1"], given["tau_2"])
    actuators = now.actuator_1, now.actuator_2
    actuators, torques = physics.drive(actuators, commands, now.motion.plant, plant, groups["actuator"], sample_time)
    torques = physics.shaft_torques(torques, now.motion.plant, plant, sample_time / 2)
    disturbances = now.unrecorded
    by, vortices, force = per_coefficient(plant.vehicle), now.vortices, disturbances.force
    if isinstance(vortices, VortexStates):
        vehicle, v = plant.vehicle, now.motion.plant.v
        frequency = physics.vortex_frequency(v, groups["disturbance"], vehicle)
        phase = now.motion.phase + frequency * sample_time / 2  # amid the sample
        force += (
            by[VORTICES]
            * physics.drag(v, vehicle)
            * (vortices.sine * scalar.sin(phase) + vortices.cosine * scalar.cos(phase))
        )
        groups["disturbance"] = replace(groups["disturbance"], vortex=ca.SX(0))
    held = {
        "t": given["t"],
        "torques": physics.Torques(
            torques.tau_1 + given["share_1"] * disturbances.torque_1,
            torques.tau_2 + given["share_2"] * disturbances.torque_2,
        ),
        "current": by["current"] * disturbances.current,
        "normal_force_variation": by["normal_force_variation"] * disturbances.normal_force_variation,
        "force": force,
    }
    hold = loops.zero_order_hold(structure, **held, duration=given["duration"])
    decays = {name: scalar.exp(-sample_time / values[f"time.{name}"]) for name in DISTURBANCES}
    decayed = UnrecordedDisturbances(**{name: decays[name] * value for name, value in vars(disturbances).items()})
    fading = scalar.exp(-sample_time / values[f"time.{VORTICES}"])
    vortices = replace(vortices, **{name: fading * value for name, value in vars(vortices).items()})
    following = leaves(PredictorState(now.motion, *actuators, cells, vortices, decayed))
    rest = ca.vertcat(*(value for key, value in following.items() if not key.startswith("motion.")))

    def problem(hold: Any) -> loops.Problem:
        return loops.problem_of(hold, sample_time, plant, groups["disturbance"])

    _, one_step = loops.between_samples(structure, problem, symbols["parameters"])
    in_parts = structure
    if one_step:
        in_parts = replace(structure, integrator="rk4", substeps=slack_substeps)
    move, _ = loops.between_samples(in_parts, problem, symbols["parameters"])

    def readings(motion: loops.Motion, pulls: tuple[Any, Any]) -> ca.SX:
        exact = sensing.measurement(motion.plant, pulls, plant, groups["sensors"], now.unrecorded.position_drift)
        return ca.vertcat(*(getattr(exact, name) for name in READINGS))

    def readings_after(time: ca.SX) -> ca.SX:
        """Readings some time after the step, or before it, with the torques of the step."""
        moved = _moved(structure, now.motion, held, time + LEAST_TIME, problem, symbols["parameters"])
        pulls = _cell_tensions(moved.plant, plant, given["t"] + time)
        if isinstance(cells, sensing.LoadCells):
            _, pulls = sensing.load_cells(cells, pulls, groups["sensors"], time + LEAST_TIME)
        return readings(moved, pulls)

    if isinstance(structure, RecordedStructure):
        reading = _row_reading(structure.recorder, groups["recorder"], given, sample_time, readings_after)
    else:
        reading = readings(now.motion, pulls)
    return PredictedSystem(
        sense=loops.named_function("sense", symbols, {"reading": reading}),
        prepare=loops.named_function("prepare", symbols, {"rest": rest, "hold": ca.vertcat(*leaves(hold).values())}),
        move=move,
        parts=in_parts.substeps,
        one_step=one_step,
        fitted=tuple(names["parameters"].index(key) for key in fitted),
    )


def _cell_tensions(state: Any, plant: physics.Plant, t: Any) -> tuple[Any, Any]:
    """Tensions in N at the load cells, before sheaves or beyond, at a time in s."""
    return sensing.at_load_cells(state, physics.tensions(state, plant, t), plant)


def _moved(
    structure: structures.LoopStructure,
    motion: loops.Motion,
    held: Mapping[str, Any],
    time: ca.SX,
    problem: Callable[[Any], loops.Problem],
    parameters: ca.SX,
) -> loops.Motion:
    """The motion some time later, or earlier, with held inputs; by one step of an exponential integrator if it can."""
    lasting = replace(structure, jitter=True)
    part_ahead, step_ahead = loops.between_samples(lasting, problem, parameters)
    until = ca.vertcat(*leaves(loops.zero_order_hold(lasting, **held, duration=time)).values())
    elements = ca.vertcat(*leaves(motion).values())
    if step_ahead:  # where a rope is slack, too
        elements, *_ = step_ahead(elements, until, parameters)
    else:
        for part in range(structure.substeps):
            elements, _ = part_ahead(elements, until, part, parameters)
    return with_leaves(motion, dict(zip(leaves(motion), ca.vertsplit(elements), strict=True)))


def _row_reading(
    recorder: RecorderClock,
    clock: RecorderClock,
    given: Mapping[str, ca.SX],
    step: ca.SX,
    readings_after: Callable[[ca.SX], ca.SX],
) -> ca.SX:
    """The reading of a step's row, by the readings some time after the step."""
    row_time = given["row_time"] + clock.phase + clock.rate_error * given["elapsed"]
    if not recorder.interpolated:
        return readings_after(row_time)
    period = step * recorder.steps
    share = (given["since"] + row_time) / period
    before, after = readings_after(-given["since"]), readings_after(period - given["since"])
    return (1 - share) * before + share * after


def initial_state(
    experiment: Experiment,
    structure: structures.LoopStructure,
    first: Floats,
    torques: tuple[float, float],
    t: float,
    process: Mapping[str, GaussMarkov],
    options: InitialStateOptions,
) -> tuple[Floats, Floats]:
    """The expected state before the first reading, and its covariance P0.

    Rope tensions are those of the load cells. A millimetre of rope is tens of kilonewtons, so positions of vehicle and
    drums are not independently uncertain: uncertain are the common position of vehicle and drums, the stretch of each
    rope, the speeds, lagging torques and what no sensor reads (`_unread`), by standard deviations that are options, and
    the disturbances. A drum or an inner node moves against the vehicle no faster than it swings with the uncertain
    stretch of its rope: the filter's derivatives do not hold for the strain rate of a short rope between ends with
    independent speeds, in which friction between wires changes its sign several times a sample.

    `first` (readings,) are the first of each sensor, NaN where there is none; the first torque commands are in N m, and
    the time of the first sample in s.
    """
    plant, sensors, names = experiment.plant, experiment.sensors, list(leaves(state_template(structure)))
    read = dict(zip(READINGS, first.tolist(), strict=True))
    x, v = read["x"] - sensors.position_bias, read["v"] if math.isfinite(read["v"]) else 0.0
    for side in plant.sides if not math.isfinite(x) else ():
        zero = getattr(sensors, f"encoder_zero_{side.number}") / side.winch.drum_radius
        x = side.direction * float(physics.winding(read[f"theta_{side.number}"] - zero, side.winch).rope)
        if math.isfinite(x):
            break
    x = x if math.isfinite(x) else 0.0

    expected, directions = dict.fromkeys(names, 0.0), list[dict[str, float]]()
    pulls, spreads = list[float](), list[float]()
    for side, torque, newton in zip(
        plant.sides, torques, vars(physics.holding_torques(2.0, plant)).values(), strict=True
    ):
        zero, error = (getattr(sensors, f"load_cell_{name}_{side.number}") for name in ("zero", "error"))
        tension = (read[f"F{side.number}"] - zero) / (1 + error)
        held = torque / newton  # newton: holds 1 N in a rope
        pulls.append(max(tension if math.isfinite(tension) else held, 1.0))
        spreads.append(math.hypot(options.share * pulls[-1], pulls[-1] - held))  # a tension that is not held changes
        holding, more = (
            leaves(experiment.actuator.holding_state(by * torque), f"actuator_{side.number}.")
            for by in (1, 1 + options.share)
        )
        expected |= holding
        directions.append({key: more[key] - value for key, value in holding.items()})
    creep_1, creep_2 = (physics.crept(t, side.creep)[0] for side in plant.sides)

    def moving(x: float, v: float, pull_1: float, pull_2: float) -> dict[str, float]:
        state = physics.steady_motion(x, v, (pull_1, pull_2), plant, (creep_1, creep_2)).state
        cells = {"load_cells.F1": pull_1, "load_cells.F2": pull_2}
        return {key: float(value) for key, value in leaves(state, "motion.plant.").items()} | cells

    point, more = (x, v, *pulls), (pulls[0] + spreads[0], pulls[1] + spreads[1])
    known = moving(*point)
    others = [(x + options.position, *point[1:]), (x, v + options.speed, *pulls)]
    others += [(x, v, more[0], pulls[1]), (x, v, pulls[0], more[1])]
    directions += [{key: value - known[key] for key, value in moving(*other).items()} for other in others]
    directions += _unread(plant, known, pulls, options)
    for side, spread, length in zip(plant.sides, spreads, physics.rope_lengths(point[0], plant.track), strict=True):
        turn, stiffness = 1 / physics.winding(0.0, side.winch).radius, float(side.rope.tangent(1.0, length)[0])
        swing = spread / turn / math.sqrt(stiffness * side.winch.inertia)
        shafts = f"omega_{side.number}", f"motor_{side.number}.omega"
        directions.append({f"motion.plant.{shaft}": turn * min(options.speed, swing) for shaft in shafts})
    directions += [{state: each.deviation} for name, each in process.items() for state in state_names(name)]
    root = np.array([[direction.get(name, 0.0) for name in names] for direction in directions], float)
    return np.array([(expected | known)[name] for name in names], float), root.T @ root


def _unread(
    plant: physics.Plant, known: Mapping[str, float], pulls: Sequence[float], options: InitialStateOptions
) -> Iterator[dict[str, float]]:
    """Uncertain states that no sensor reads: inner rope, sag, friction with a bristle state.

    At known states of a steady motion with pulls in N, one direction of one standard deviation each.
    """
    for side, pull, length in zip(
        plant.sides, pulls, physics.rope_lengths(known["motion.plant.x"], plant.track), strict=True
    ):
        rope, prefix = side.rope, f"motion.plant.rope_{side.number}."
        for key in known:
            if key.startswith(f"{prefix}waves.position"):
                yield {key: options.share * float(rope.resting_stretch(pull, length))}
            elif key.startswith(f"{prefix}waves.speed"):
                mass = rope.mass_per_length * max(length, rope.shortest_mass)
                frequency = rope.segments * math.sqrt(2 * float(rope.tangent(1.0, length)[0]) / mass)
                swing = options.share * float(rope.resting_stretch(pull, length)) * frequency
                yield {key: min(options.speed, swing)}
        if (depth := f"{prefix}sag.depth") in known:
            frequency = math.pi / physics.span_of(length, plant.track) * math.sqrt(pull / physics.transverse_mass(rope))
            yield {depth: options.share * known[depth]}
            yield {f"{prefix}sag.rate": options.share * known[depth] * frequency}
        yield {f"{prefix}hysteresis.share": UNIFORM}
    for key, most in leaves(
        physics.bent_bristles(physics.friction(1.0, plant.vehicle), plant.vehicle), "motion.plant.rail."
    ).items():
        yield {key: UNIFORM * float(most)}
