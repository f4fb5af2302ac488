"""Plant and controller as one symbolic step of the sampled closed loop."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from typing import Annotated, Any

import casadi as ca

from controllers.controller import Controller, ControllerState, controller_step, initial_controller_state
from controllers.nominal import nominal_plant
from controllers.signals import ControllerOutput
from model.disturbance import Disturbance
from model.plant import (
    Environment,
    Plant,
    PlantState,
    Torques,
    holding_torques,
    resting_state,
    tensions,
    vehicle_acceleration,
)
from model.quantity import Quantity, describe, leaves, numbers, with_leaves
from model.reference import Setpoint
from model.scalar import Scalar, absolute, minimum
from model.vehicle import drag, friction, inertia
from simulation.experiment import Experiment, Simulation
from simulation.integrators import INTEGRATORS, Motion, Problem
from simulation.metrics import Accumulators, Sample, accumulate
from simulation.sensors import EncoderState, Noise, Sensors, measure, read_encoders


@dataclass(frozen=True)
class Structure:
    """What shapes the compiled code; everything else is a number it takes at run time."""

    kind: str
    rope_slack: bool
    integrator: str
    substeps: int
    delay_samples: int


@dataclass(frozen=True)
class Exogenous:
    """What one sample receives from outside."""

    reference: Setpoint
    noise: Noise = field(default_factory=Noise)
    current: Annotated[Scalar, Quantity("m/s", "ambient current along the track")] = 0.0
    normal_force_variation: Annotated[Scalar, Quantity("N", "change of the force on the rail")] = 0.0
    steady: Annotated[Scalar, Quantity("1", "1 in the steady-state window")] = 0.0


@dataclass(frozen=True)
class LoopState:
    """State of the closed loop between two samples."""

    motion: Motion
    controller: ControllerState
    encoders: EncoderState = field(default_factory=EncoderState)
    sample: Annotated[Scalar, Quantity("1", "number of the sample")] = 0.0


@dataclass(frozen=True)
class Row:
    """One row of a result: the state at the beginning of a sample and what was computed from it."""

    t: Annotated[Scalar, Quantity("s", "time of the sample's beginning")]
    x: Annotated[Scalar, Quantity("m", "position of the vehicle")]
    v: Annotated[Scalar, Quantity("m/s", "speed of the vehicle")]
    theta_1: Annotated[Scalar, Quantity("rad", "angle of drum 1")]
    omega_1: Annotated[Scalar, Quantity("rad/s", "speed of drum 1")]
    theta_2: Annotated[Scalar, Quantity("rad", "angle of drum 2")]
    omega_2: Annotated[Scalar, Quantity("rad/s", "speed of drum 2")]
    x_ref: Annotated[Scalar, Quantity("m", "reference position")]
    v_ref: Annotated[Scalar, Quantity("m/s", "reference speed")]
    a_ref: Annotated[Scalar, Quantity("m/s^2", "reference acceleration")]
    e: Annotated[Scalar, Quantity("m", "tracking error x - x_ref")]
    F1: Annotated[Scalar, Quantity("N", "tension of rope 1")]
    F2: Annotated[Scalar, Quantity("N", "tension of rope 2")]
    F1_cmd: Annotated[Scalar, Quantity("N", "tension command of rope 1")]
    F2_cmd: Annotated[Scalar, Quantity("N", "tension command of rope 2")]
    u: Annotated[Scalar, Quantity("N", "force command before saturation")]
    u_sat: Annotated[Scalar, Quantity("N", "force command within the limits")]
    d_hat: Annotated[Scalar, Quantity("m/s^2", "estimated disturbance acceleration")]
    d_true: Annotated[Scalar, Quantity("m/s^2", "acceleration the nominal model does not explain")]
    L1: Annotated[Scalar, Quantity("1/s", "observer gain")]
    Z_a: Annotated[Scalar, Quantity("N s", "state of the anti-saturation system")]
    s: Annotated[Scalar, Quantity("m", "sliding variable")]
    tau1: Annotated[Scalar, Quantity("N m", "motor torque command of winch 1")]
    tau2: Annotated[Scalar, Quantity("N m", "motor torque command of winch 2")]


COLUMNS = {leaf.key: leaf.quantity for leaf in describe(Row).values()}
"""Column name → quantity, in the order of a result file."""

SWITCHES = ("vortex", "integrated_phase")
"""Switches of the disturbance that are numbers (0 or 1) at run time."""


@dataclass(frozen=True)
class ClosedLoop:
    """The closed loop as one named CasADi function, and the names of everything in its vectors.

    Attributes:
        step: ``step(state, exogenous, parameters) -> (next_state, row, margin)``: one sample. `margin` in m is
            the distance of the next position to the nearer end of the track; negative: the track was left.
        states, exogenous, parameters, columns: names of the elements of those vectors.
        metrics: how many of the last states are the `Accumulators`.
    """

    step: ca.Function
    states: tuple[str, ...]
    exogenous: tuple[str, ...]
    parameters: tuple[str, ...]
    columns: tuple[str, ...]
    metrics: int


def structure_of(experiment: Experiment) -> Structure:
    """The part of an experiment that shapes the compiled code."""
    simulation = experiment.simulation
    return Structure(
        kind=experiment.controller.kind,
        rope_slack=experiment.plant.rope_slack,
        integrator=simulation.integrator,
        substeps=simulation.substeps,
        delay_samples=simulation.delay_samples,
    )


def parameters_of(experiment: Experiment) -> dict[str, float]:
    """Every number of an experiment that the closed loop takes at run time, by its key.

    ``plant.*`` is the simulated plant, ``nominal.*`` the plant as the controller believes it to be.
    """
    disturbance = experiment.disturbance
    gains = numbers(experiment.controller, "controller.")
    values = (
        numbers(experiment.plant, "plant.")
        | numbers(nominal_plant(experiment.controller.nominal, experiment.plant), "nominal.")
        | {key: value for key, value in gains.items() if not key.startswith("controller.nominal.")}
        | {f"disturbance.{key}": float(getattr(disturbance, key)) for key in SWITCHES}
        | {f"disturbance.{key}": getattr(disturbance, key) for key in ("vortex_amplitude", "strouhal")}
        | numbers(experiment.sensors, "sensors.")
        | {"simulation.sample_time": experiment.simulation.sample_time}
    )
    return {key: float(value) for key, value in values.items()}


def _initial_loop_state(controller: Controller, plant: Plant, sensors: Sensors) -> LoopState:
    rest = resting_state(controller.coordination.preload, plant)
    return LoopState(
        motion=Motion(rest),
        controller=initial_controller_state(controller),
        encoders=read_encoders(rest, plant, sensors),
    )


def _queue_names(delay_samples: int) -> list[str]:
    return [f"queue.{place}.{name}" for place in range(delay_samples) for name in ("tau_1", "tau_2")]


def initial_state_of(experiment: Experiment) -> dict[str, float]:
    """State before the first sample: at rest at x = 0, both ropes at preload/2, equilibrium torques on their way."""
    controller = experiment.controller
    start = _initial_loop_state(controller, experiment.plant, experiment.sensors)
    held = leaves(holding_torques(controller.coordination.preload, experiment.plant))
    queue = {name: held[name.rsplit(".", 1)[1]] for name in _queue_names(experiment.simulation.delay_samples)}
    return {key: float(value) for key, value in (leaves(start) | queue | leaves(Accumulators(), "metrics.")).items()}


@cache
def closed_loop(structure: Structure) -> ClosedLoop:
    """Build the symbolic step of a structure (cached)."""
    template = Experiment(
        plant=Plant(rope_slack=structure.rope_slack),
        controller=Controller(kind=structure.kind),  # pyright: ignore[reportArgumentType]
        simulation=Simulation(delay_samples=structure.delay_samples),
    )
    names = tuple(parameters_of(template))
    p = ca.SX.sym("p", len(names))
    values = dict(zip(names, ca.vertsplit(p), strict=True))
    plant = with_leaves(template.plant, values, "plant.")
    nominal = with_leaves(template.plant, values, "nominal.")
    controller = with_leaves(template.controller, values, "controller.")
    disturbance = with_leaves(template.disturbance, values, "disturbance.")
    sensors = with_leaves(template.sensors, values, "sensors.")
    sample_time = values["simulation.sample_time"]

    state_names = tuple(initial_state_of(template))
    s = ca.SX.sym("s", len(state_names))
    of_state = dict(zip(state_names, ca.vertsplit(s), strict=True))
    state = with_leaves(_initial_loop_state(template.controller, template.plant, template.sensors), of_state)
    sums = with_leaves(Accumulators(), of_state, "metrics.")

    exogenous_template = Exogenous(reference=Setpoint(0.0, 0.0, 0.0))
    exogenous_names = tuple(leaves(exogenous_template))
    w = ca.SX.sym("w", len(exogenous_names))
    exogenous = with_leaves(exogenous_template, dict(zip(exogenous_names, ca.vertsplit(w), strict=True)))

    # the sample's beginning: sense and control
    t = state.sample * sample_time
    plant_state = state.motion.plant
    F1, F2 = tensions(plant_state, plant)
    encoders, measurement = measure(
        plant_state, (F1, F2), exogenous.noise, state.encoders, plant, sensors, sample_time
    )
    controller_state, said = controller_step(
        state.controller, measurement, exogenous.reference, controller, nominal, sample_time
    )

    # until the next sample: the plant moves on under the torques that reach the motors
    queue = [of_state[name] for name in _queue_names(structure.delay_samples)] + [said.tau1, said.tau2]
    torques = Torques(queue[0], queue[1])
    problem = Problem(
        t=t,
        duration=sample_time,
        torques=torques,
        environment=Environment(
            current=exogenous.current, normal_force_variation=exogenous.normal_force_variation
        ),
        disturbance=disturbance,
        plant=plant,
    )
    motion = INTEGRATORS[structure.integrator].advance(problem, state.motion, structure.substeps)

    next_state = LoopState(motion, controller_state, encoders, state.sample + 1)
    power_1 = plant.winch_1.gear_ratio * torques.tau_1 * plant_state.omega_1
    power_2 = plant.winch_2.gear_ratio * torques.tau_2 * plant_state.omega_2
    sums = accumulate(
        sums,
        Sample(
            error=plant_state.x - exogenous.reference.x,
            F1=F1,
            F2=F2,
            power=absolute(power_1) + absolute(power_2),
            saturated=said.saturated,
            torque_saturated=said.torque_saturated,
            steady=exogenous.steady,
        ),
        sample_time,
    )
    environment = problem.environment_at(t, plant_state.v, state.motion.phase)
    row = _row(t, plant_state, (F1, F2), exogenous.reference, said, environment, plant, nominal)
    following = leaves(next_state) | dict(zip(_queue_names(structure.delay_samples), queue[2:], strict=True))
    following |= leaves(sums, "metrics.")
    step = ca.Function(
        "step",
        [s, w, p],
        [
            ca.vertcat(*(following[name] for name in state_names)),
            ca.vertcat(*row.values()),
            _margin(motion.plant.x, plant),
        ],
        ["state", "exogenous", "parameters"],
        ["next_state", "row", "margin"],
        {"cse": True},
    )
    return ClosedLoop(
        step=step,
        states=state_names,
        exogenous=exogenous_names,
        parameters=names,
        columns=tuple(row),
        metrics=len(fields(Accumulators)),
    )


def _margin(x: Scalar, plant: Plant) -> Scalar:
    overrun = plant.track.rope_offset / 2
    return minimum(x + overrun, plant.track.length + overrun - x)


def _row(
    t: Scalar,
    state: PlantState,
    forces: tuple[Scalar, Scalar],
    reference: Setpoint,
    said: ControllerOutput,
    environment: Environment,
    plant: Plant,
    nominal: Plant,
) -> dict[str, Any]:
    F1, F2 = forces
    acceleration = vehicle_acceleration(state.v, F1 - F2, environment, plant.vehicle)
    believed_resistance = friction(state.v, nominal.vehicle) + drag(state.v, nominal.vehicle)
    believed = (F1 - F2 - believed_resistance) / inertia(nominal.vehicle)
    row = Row(
        t=t,
        **leaves(state),
        x_ref=reference.x,
        v_ref=reference.v,
        a_ref=reference.a,
        e=state.x - reference.x,
        F1=F1,
        F2=F2,
        F1_cmd=said.F1_cmd,
        F2_cmd=said.F2_cmd,
        **leaves(said.position),
        d_true=acceleration - believed,
        tau1=said.tau1,
        tau2=said.tau2,
    )
    return {key: value for key, value in leaves(row).items() if value is not None}
