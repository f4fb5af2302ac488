"""Plant and controller as one symbolic step of the sampled closed loop."""

from dataclasses import dataclass, field
from functools import cache
from typing import Annotated

import casadi as ca

from controllers.controller import Controller, ControllerState, controller_step, initial_controller_state
from controllers.coordination import Coordination
from model.plant import Environment, Plant, Torques, holding_torques, resting_state, tensions
from model.quantity import Quantity, leaves, with_leaves
from model.reference import Setpoint
from model.scalar import Scalar, absolute, minimum
from simulation.experiment import Experiment, Simulation
from simulation.integrators import INTEGRATORS, Motion, Problem
from simulation.metrics import Accumulators, Sample, accumulate
from simulation.row import row_of
from simulation.sensors import EncoderState, Noise, Sensors, measure, read_encoders
from simulation.structure import Structure, parameters_of


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
class ClosedLoop:
    """The closed loop as named CasADi functions, and the names of everything in their vectors.

    Attributes:
        step: ``step(state, exogenous, parameters) -> (next_state, row, margin)``: one sample. `margin` in m is
            the distance of the next position to the nearer end of the track; negative: the track was left.
        shortcut: ``shortcut(state, exogenous, parameters) -> (next_state, row, margin, valid)``: a cheaper step
            with the same result wherever ``valid > 0``; None where the integrator has none.
        states, exogenous, parameters, columns: names of the elements of those vectors.
    """

    step: ca.Function
    shortcut: ca.Function | None
    states: tuple[str, ...]
    exogenous: tuple[str, ...]
    parameters: tuple[str, ...]
    columns: tuple[str, ...]


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
        controller=Controller(
            kind=structure.kind,  # pyright: ignore[reportArgumentType]
            estimator=structure.estimator,  # pyright: ignore[reportArgumentType]
            coordination=Coordination(kind=structure.coordination),  # pyright: ignore[reportArgumentType]
        ),
        simulation=Simulation(delay_samples=structure.delay_samples),
    )
    queued = _queue_names(structure.delay_samples)
    vectors = {
        "state": tuple(initial_state_of(template)),
        "exogenous": tuple(leaves(Exogenous(Setpoint(0.0, 0.0, 0.0)))),
        "parameters": tuple(parameters_of(template)),
    }
    symbols = {name: ca.SX.sym(name, len(names)) for name, names in vectors.items()}
    of_state, outside, values = (
        dict(zip(names, ca.vertsplit(symbols[name]), strict=True)) for name, names in vectors.items()
    )
    plant = with_leaves(template.plant, values, "plant.")
    nominal = with_leaves(template.plant, values, "nominal.")
    controller = with_leaves(template.controller, values, "controller.")
    sensors = with_leaves(template.sensors, values, "sensors.")
    sample_time = values["simulation.sample_time"]
    state = with_leaves(_initial_loop_state(template.controller, template.plant, template.sensors), of_state)
    exogenous = with_leaves(Exogenous(Setpoint(0.0, 0.0, 0.0)), outside)
    plant_state = state.motion.plant

    # the sample's beginning: sense and control
    forces = tensions(plant_state, plant)
    encoders, measurement = measure(plant_state, forces, exogenous.noise, state.encoders, plant, sensors, sample_time)
    controller_state, said = controller_step(
        state.controller, measurement, exogenous.reference, controller, nominal, sample_time
    )

    # until the next sample: the plant moves on under the torques that reach the motors
    queue = [*(of_state[name] for name in queued), said.tau1, said.tau2]
    torques = Torques(queue[0], queue[1])
    sea = Environment(current=exogenous.current, normal_force_variation=exogenous.normal_force_variation)
    problem = Problem(
        t=state.sample * sample_time,
        duration=sample_time,
        torques=torques,
        environment=sea,
        disturbance=with_leaves(template.disturbance, values, "disturbance."),
        plant=plant,
    )

    environment = problem.environment_at(problem.t, plant_state.v, state.motion.phase)
    row = row_of(problem.t, plant_state, forces, exogenous.reference, said, environment, plant, nominal)
    power_1 = plant.winch_1.gear_ratio * torques.tau_1 * plant_state.omega_1
    power_2 = plant.winch_2.gear_ratio * torques.tau_2 * plant_state.omega_2
    sample = Sample(
        error=row["e"],
        F1=row["F1"],
        F2=row["F2"],
        tau_1=torques.tau_1,
        tau_2=torques.tau_2,
        power=absolute(power_1) + absolute(power_2),
        saturated=said.saturated,
        torque_saturated=said.torque_saturated,
        steady=exogenous.steady,
    )
    sums = accumulate(with_leaves(Accumulators(), of_state, "metrics."), sample, sample_time)
    overrun = plant.track.rope_offset / 2

    def outputs(motion: Motion) -> list[ca.SX]:
        following = leaves(LoopState(motion, controller_state, encoders, state.sample + 1))
        following |= dict(zip(queued, queue[2:], strict=True)) | leaves(sums, "metrics.")
        margin = minimum(motion.plant.x + overrun, plant.track.length + overrun - motion.plant.x)
        return [
            ca.vertcat(*(following[name] for name in vectors["state"])),
            ca.vertcat(*row.values()),
            margin,
        ]

    integrator = INTEGRATORS[structure.integrator]
    names = ["next_state", "row", "margin"]
    moved = integrator.advance(problem, state.motion, structure.substeps)
    shortcut = None
    if integrator.shortcut:
        quick, valid = integrator.shortcut(problem, state.motion)
        shortcut = _function("shortcut", symbols, [*outputs(quick), valid], [*names, "valid"])
    return ClosedLoop(
        step=_function("step", symbols, outputs(moved), names),
        shortcut=shortcut,
        states=vectors["state"],
        exogenous=vectors["exogenous"],
        parameters=vectors["parameters"],
        columns=tuple(row),
    )


def _function(name: str, inputs: dict[str, ca.SX], outputs: list[ca.SX], names: list[str]) -> ca.Function:
    return ca.Function(name, list(inputs.values()), outputs, list(inputs), names, {"cse": True})
