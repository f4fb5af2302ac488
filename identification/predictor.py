"""The machine under recorded torques, as a filter predicts it: states, measurement equations, initial state.

The equations of motion are those of every simulation (`simulation.loop.between`, `model.actuators.drive`). The state is
augmented by unrecorded disturbances, first-order Gauss–Markov processes. From sample to sample torques and disturbances
are constant.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.sampled import PredictedSystem
from dualwinch.codegen.source.expressions import GRAPHS, built_once
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.nominal import Nominal
from dualwinch.identification.options import InitialStateOptions, NoiseOptions
from dualwinch.model.actuators import drive
from dualwinch.model.plant import Plant, PlantState, Torques, holding_torques, tensions, torques_amid
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.ropes import crept, rope_lengths
from dualwinch.model.scalar import Scalar, exp
from dualwinch.model.vehicle import friction
from dualwinch.model.winch import angle_of, winding
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.integrators import Motion, Problem
from dualwinch.simulation.loop.structure import Structure, parameters_of, structure_of, template_of
from dualwinch.simulation.loop.zero_order_hold import (
    MOTION_TEMPLATE,
    between_samples,
    named_function,
    problem_of,
    zero_order_hold,
)
from dualwinch.simulation.sensors import Sensors

Floats = NDArray[np.float64]

INPUTS = ("t", "tau_1", "tau_2", "duration")
"""Inputs of a sample: time in s, torque commands in N m, time in s until the next sample."""

GROUPS = ("plant", "sensors", "actuator", "disturbance")
"""Groups of an experiment whose parameters the predictor takes."""

SAMPLE_TIME = "simulation.sample_time"


@dataclass(frozen=True)
class SensorReadings:
    """Readings that a log may have, in the order of their columns."""

    x: Annotated[Scalar, Quantity("m", "position of the vehicle")]
    v: Annotated[Scalar, Quantity("m/s", "speed of the vehicle")]
    F1: Annotated[Scalar, Quantity("N", "load cell of rope 1")]
    F2: Annotated[Scalar, Quantity("N", "load cell of rope 2")]
    theta_1: Annotated[Scalar, Quantity("rad", "encoder of drum 1, angle")]
    theta_2: Annotated[Scalar, Quantity("rad", "encoder of drum 2, angle")]
    omega_1: Annotated[Scalar, Quantity("rad/s", "speed of drum 1")]
    omega_2: Annotated[Scalar, Quantity("rad/s", "speed of drum 2")]


READINGS = tuple(each.name for each in fields(SensorReadings))


@dataclass(frozen=True)
class UnrecordedDisturbances:
    """States of the disturbances that no log records."""

    current: Annotated[Scalar, Quantity("m/s", "ambient current along the track")] = 0.0
    normal_force_variation: Annotated[Scalar, Quantity("N", "change of the force on the rail")] = 0.0
    force: Annotated[Scalar, Quantity("N", "further force on the vehicle along the track")] = 0.0
    torque_1: Annotated[Scalar, Quantity("N m", "further torque of motor 1")] = 0.0
    torque_2: Annotated[Scalar, Quantity("N m", "further torque of motor 2")] = 0.0
    position_drift: Annotated[Scalar, Quantity("m", "drift of the position sensor")] = 0.0


DISTURBANCES = tuple(each.name for each in fields(UnrecordedDisturbances))

CORRELATION_TIMES = tuple(f"time.{name}" for name in DISTURBANCES)
"""Correlation times in s of the disturbances, further parameters of the predictor."""


@dataclass(frozen=True)
class GaussMarkov:
    """A first-order Gauss–Markov process.

    Attributes:
        deviation: stationary standard deviation, in the disturbance's unit.
        time: correlation time in s.
    """

    deviation: float
    time: float


def described_disturbances(experiment: Experiment, options: NoiseOptions) -> dict[str, GaussMarkov]:
    """The disturbances as an experiment describes them; those that it does not describe have the least deviation.

    No deviation of these is exactly zero: then no reading could ever correct the state.
    """
    disturbance, vehicle, sensors = experiment.disturbance, experiment.plant.vehicle, experiment.sensors
    return {
        "current": GaussMarkov(disturbance.current_sigma, disturbance.current_time),
        "normal_force_variation": GaussMarkov(
            disturbance.normal_force_sigma * vehicle.normal_force, disturbance.normal_force_time
        ),
        "force": GaussMarkov(options.least_force * max(float(friction(1.0, vehicle)), 1.0), options.force_time),
        "torque_1": GaussMarkov(options.least_torque, options.torque_time),
        "torque_2": GaussMarkov(options.least_torque, options.torque_time),
        "position_drift": GaussMarkov(sensors.position_drift, sensors.position_drift_time),
    }


@dataclass(frozen=True)
class NoiseCovariances:
    """Measurement noise R and process noise Q of the filter.

    Attributes:
        measurement: (readings,) variances of the sensors' noise.
        process: disturbance → its Gauss–Markov process.
    """

    measurement: Floats
    process: Mapping[str, GaussMarkov]


@dataclass(frozen=True)
class PredictorState:
    """State of the machine, augmented by the unrecorded disturbances."""

    motion: Motion
    actuator_1: Any
    actuator_2: Any
    unrecorded: UnrecordedDisturbances


def predictor_structure(experiment: Experiment) -> Structure:
    """The structure of the predictor's code: an experiment's, without its controller."""
    structure = structure_of(replace(experiment, controller=Controller(nominal=Nominal()), metrics=()))
    return replace(structure, delay_samples=0, silence=None, readings=False)


def state_template(structure: Structure) -> PredictorState:
    """A state that names the elements; its values mean nothing."""
    actuator = template_of(structure).actuator.initial_state()
    return PredictorState(MOTION_TEMPLATE, actuator, actuator, UnrecordedDisturbances())


@GRAPHS.cached
def parameter_names(structure: Structure) -> tuple[str, ...]:
    """Keys of all parameters of the predictor, in their order."""
    begins = tuple(f"{group}." for group in GROUPS)
    own = (key for key in parameters_of(template_of(structure)) if key.startswith(begins))
    return (*own, SAMPLE_TIME, *CORRELATION_TIMES)


def measurement(
    state: PlantState, t: Scalar, plant: Plant, sensors: Sensors, position_drift: Scalar = 0.0
) -> SensorReadings:
    """The measurement equation: readings without noise and quantisation.

    Args:
        state: the plant's.
        t: time in s.
        plant: gives tensions and drum radii.
        sensors: their zeros and scales.
        position_drift: of the position sensor in m.
    """
    F1, F2 = tensions(state, plant, t)
    return SensorReadings(
        x=state.x + sensors.position_bias + position_drift,
        v=state.v,
        F1=(1 + sensors.load_cell_error_1) * F1 + sensors.load_cell_zero_1,
        F2=(1 + sensors.load_cell_error_2) * F2 + sensors.load_cell_zero_2,
        theta_1=state.theta_1 + sensors.encoder_zero_1 / plant.winch_1.drum_radius,
        theta_2=state.theta_2 + sensors.encoder_zero_2 / plant.winch_2.drum_radius,
        omega_1=state.omega_1,
        omega_2=state.omega_2,
    )


@built_once
def predicted_system(
    structure: Structure, fitted: tuple[str, ...], zeros: frozenset[str] = frozenset(), slack_substeps: int = 8
) -> PredictedSystem:
    """The predictor's CasADi functions.

    Args:
        structure: of `predictor_structure`.
        fitted: keys of the parameters to estimate, some of `parameter_names`.
        zeros: keys of parameters that stay zero (`simulation.loop.structure.zeros_of`), none of them fitted.
        slack_substeps: Runge–Kutta steps of a sample in which a rope is slack or about to be, where other samples take
            one step of an exponential integrator.
    """
    template, start = template_of(structure), state_template(structure)
    names = {"state": (*leaves(start),), "input": INPUTS, "parameters": parameter_names(structure)}
    symbols = {name: ca.SX.sym(name, len(elements)) for name, elements in names.items()}
    state, given, values = (
        dict(zip(elements, ca.vertsplit(symbols[name]), strict=True)) for name, elements in names.items()
    )
    values |= dict.fromkeys(zeros & values.keys(), ca.SX(0))
    groups = {group: with_leaves(getattr(template, group), values, f"{group}.") for group in GROUPS}
    plant, sample_time, now = groups["plant"], values[SAMPLE_TIME], with_leaves(start, state)
    readings = measurement(now.motion.plant, given["t"], plant, groups["sensors"], now.unrecorded.position_drift)

    commands = Torques(given["tau_1"], given["tau_2"])
    actuators = now.actuator_1, now.actuator_2
    actuators, torques = drive(actuators, commands, now.motion.plant, plant, groups["actuator"], sample_time)
    torques, disturbances = torques_amid(torques, now.motion.plant, sample_time, plant), now.unrecorded
    hold = zero_order_hold(
        structure,
        t=given["t"],
        torques=Torques(torques.tau_1 + disturbances.torque_1, torques.tau_2 + disturbances.torque_2),
        current=disturbances.current,
        normal_force_variation=disturbances.normal_force_variation,
        force=disturbances.force,
        duration=given["duration"],
    )
    decays = {name: exp(-sample_time / values[f"time.{name}"]) for name in DISTURBANCES}
    decayed = UnrecordedDisturbances(**{name: decays[name] * value for name, value in vars(disturbances).items()})
    following = leaves(PredictorState(now.motion, *actuators, decayed))
    rest = ca.vertcat(*(value for key, value in following.items() if not key.startswith("motion.")))

    def problem(hold: Any) -> Problem:
        return problem_of(hold, sample_time, plant, groups["disturbance"])

    _, one_step = between_samples(structure, problem, symbols["parameters"])
    in_parts = replace(structure, integrator="rk4", substeps=slack_substeps) if one_step else structure
    move, _ = between_samples(in_parts, problem, symbols["parameters"])
    return PredictedSystem(
        sense=named_function("sense", symbols, {"reading": ca.vertcat(*leaves(readings).values())}),
        prepare=named_function("prepare", symbols, {"rest": rest, "hold": ca.vertcat(*leaves(hold).values())}),
        move=move,
        parts=in_parts.substeps,
        one_step=one_step,
        fitted=tuple(names["parameters"].index(key) for key in fitted),
    )


def initial_state(
    experiment: Experiment,
    structure: Structure,
    first: Floats,
    torques: tuple[float, float],
    t: float,
    process: Mapping[str, GaussMarkov],
    options: InitialStateOptions,
) -> tuple[Floats, Floats]:
    """The state expected before the first reading, and its covariance P0.

    The ropes are as taut as the load cells read. A millimetre more or less of rope is tens of kilonewtons, so vehicle
    and drums are not independently uncertain: uncertain are the position of the vehicle together with both drums, the
    stretch of each rope, and the speeds.

    Args:
        experiment: gives plant, motors and sensors.
        structure: of `predictor_structure`.
        first: (readings,) the first of each sensor; NaN where there is none.
        torques: first torque commands in N m.
        t: time of the first sample in s.
        process: the disturbances.
        options: standard deviations.
    """
    plant, sensors = experiment.plant, experiment.sensors
    read = dict(zip(READINGS, first.tolist(), strict=True))
    radius_1, radius_2 = plant.winch_1.drum_radius, plant.winch_2.drum_radius
    angle_1 = read["theta_1"] - sensors.encoder_zero_1 / radius_1
    angle_2 = read["theta_2"] - sensors.encoder_zero_2 / radius_2
    held = holding_torques(2.0, plant)  # 1 N in each rope
    load_cells = (
        (read["F1"] - sensors.load_cell_zero_1) / (1 + sensors.load_cell_error_1),
        (read["F2"] - sensors.load_cell_zero_2) / (1 + sensors.load_cell_error_2),
    )
    F1, F2 = (
        tension if math.isfinite(tension) else max(torque / each, 1.0)
        for tension, torque, each in zip(load_cells, torques, (held.tau_1, held.tau_2), strict=True)
    )
    x = read["x"] - sensors.position_bias
    if not math.isfinite(x):
        x = float(winding(angle_1, plant.winch_1).rope) if math.isfinite(angle_1) else 0.0
        x = -float(winding(angle_2, plant.winch_2).rope) if not math.isfinite(angle_1) and math.isfinite(angle_2) else x
    length_1, length_2 = rope_lengths(x, plant.track)
    stretch_1 = float(plant.rope_1.resting_stretch(max(F1, 1.0), length_1))
    stretch_2 = float(plant.rope_2.resting_stretch(max(F2, 1.0), length_2))
    v = read["v"] if math.isfinite(read["v"]) else 0.0
    longer_1, longer_2 = crept(t, plant.creep_1)[0], crept(t, plant.creep_2)[0]
    turned = 1 / winding(0.0, plant.winch_1).radius, 1 / winding(0.0, plant.winch_2).radius
    names = list(leaves(state_template(structure)))
    expected = dict.fromkeys(names, 0.0) | {
        "motion.plant.x": x,
        "motion.plant.v": v,
        "motion.plant.theta_1": float(angle_of(stretch_1 + x + longer_1, plant.winch_1)),
        "motion.plant.theta_2": float(angle_of(stretch_2 - x + longer_2, plant.winch_2)),
        "motion.plant.omega_1": v * float(turned[0]),
        "motion.plant.omega_2": -v * float(turned[1]),
    }
    for number, torque in enumerate(torques, start=1):
        expected |= leaves(experiment.actuator.holding_state(torque), f"actuator_{number}.")
    together = {"x": 1.0, "theta_1": turned[0], "theta_2": -turned[1]}
    directions: list[dict[str, float]] = [
        {f"motion.plant.{name}": options.position * share for name, share in together.items()},
        {"motion.plant.theta_1": options.stretch * stretch_1 * turned[0]},
        {"motion.plant.theta_2": options.stretch * stretch_2 * turned[1]},
        {
            "motion.plant.v": options.speed,
            "motion.plant.omega_1": options.speed * turned[0],
            "motion.plant.omega_2": -options.speed * turned[1],
        },
        {"motion.plant.omega_1": options.speed * turned[0]},
        {"motion.plant.omega_2": options.speed * turned[1]},
        *({f"unrecorded.{name}": each.deviation} for name, each in process.items()),
    ]
    root = np.array([[direction.get(name, 0.0) for name in names] for direction in directions], float)
    return np.array([expected[name] for name in names], float), root.T @ root
