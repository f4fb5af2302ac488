"""The force that a run asks of its two motors: what holds the vehicle on its reference, whatever the controller."""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.source.expressions import built_once
from dualwinch.model.disturbance import Disturbance, vortex_force, vortex_frequency
from dualwinch.model.plant import Environment, Plant, symbolic_plant, vehicle_acceleration
from dualwinch.model.quantities.tree import numbers, with_leaves
from dualwinch.model.reference import setpoint
from dualwinch.model.ropes import Rope
from dualwinch.model.scalar import Scalar
from dualwinch.model.vehicle import Vehicle, inertia
from dualwinch.model.winch import Winch, drum_acceleration
from dualwinch.simulation.exogenous.signals import sea_signals
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

EVERY = 50
"""Samples between two instants looked at: what the sea does takes seconds."""


def required_force(experiment: Experiment, every: int = EVERY) -> Floats:
    """Net force in N, at the ropes, that the motors have to give at every so many samples (instants,).

    It follows from the equations of vehicle and drums (paper Sections 2.3, 2.4) with ropes that do not stretch: masses
    times the reference's acceleration, and friction, drag and vortices at its speed. The motors can give
    ``tension_max - tension_min`` either way (paper Section 3.1.1).
    """
    return np.asarray(force_law()(outside_at(experiment, every), force_parameters(experiment)), float).ravel()


def outside_at(experiment: Experiment, every: int) -> Floats:
    """What `force_law` receives at every so many samples, (7, instants)."""
    simulation = experiment.simulation
    t = np.arange(0, experiment.samples, every) * simulation.sample_time
    wanted = setpoint(t, experiment.reference)
    sea = [signal[::every] for signal in sea_signals(experiment)]
    return np.array([t, wanted.x, wanted.v, np.broadcast_to(wanted.a, len(t)), *sea], dtype=np.float64)


@dataclass(frozen=True)
class Demand:
    """What a run asks of its motors.

    Attributes:
        share: the largest force, as a share of what they can give.
        shortfall: how far in m the vehicle falls behind at most, with all the force there is until it has caught up;
            0: it need not. From the force alone: that a slower vehicle has less drag is left out.
    """

    share: float
    shortfall: float


def demand(experiment: Experiment) -> Demand:
    """What a run asks of its motors."""
    force = required_force(experiment)
    share = float(np.abs(force).max()) / experiment.controller.limits.strength
    return Demand(share, _behind(experiment, force) if share > 1 else 0.0)


def within_authority(experiment: Experiment) -> bool:
    """Whether a run stays within the actuators' authority: it asks for no more force than the motors can give."""
    limit = experiment.controller.limits.strength
    return bool(np.abs(required_force(experiment)).max() <= limit)


def _behind(experiment: Experiment, force: Floats) -> float:
    limit = experiment.controller.limits.strength
    step, mass = EVERY * experiment.simulation.sample_time, inertia(experiment.plant.vehicle)
    furthest = behind = rate = 0.0
    way = 1.0
    for value in force.tolist():
        if behind == 0:
            way = 1.0 if value > 0 else -1.0
        rate += step * (way * value - limit) / mass
        behind += step * rate
        if behind <= 0:
            behind = rate = 0.0
        furthest = max(furthest, behind)
    return furthest


def force_parameters(experiment: Experiment) -> Floats:
    """The parameters of `force_law`: the simulated plant's, and the vortices'."""
    plant = replace(experiment.plant, rope_1=Rope(), rope_2=Rope())  # ropes that do not stretch have no law
    values = [*numbers(plant).values(), *numbers(experiment.disturbance).values()]
    return np.array(values, float)


@built_once
def force_law() -> ca.Function:
    """``force(outside, parameters)`` of time, position, speed, acceleration and what acts on the vehicle (`Sea`)."""
    outside, parameters, disturbance, plant = outside_symbols()
    _, _, v, a, *_ = ca.vertsplit(outside)
    force = pull(outside, disturbance, plant)
    for winch, way in ((plant.winch_1, 1), (plant.winch_2, -1)):
        turn = way / winch.drum_radius
        force += turn * winch.gear_ratio * motor_torque(way * v, way * a, 0.0, winch)
    return ca.Function("force", [outside, parameters], [force])


def outside_symbols() -> tuple[ca.SX, ca.SX, Disturbance, Plant]:
    """What `force_law` receives, as symbols, and disturbance and plant that are made of its parameters."""
    plant, p = symbolic_plant(Plant())
    vortices, outside = numbers(Disturbance()), ca.SX.sym("outside", 7)
    switches = ca.SX.sym("switches", len(vortices))
    disturbance = with_leaves(Disturbance(), dict(zip(vortices, ca.vertsplit(switches), strict=True)))
    return outside, ca.vertcat(p, switches), disturbance, plant


def pull(outside: ca.SX, disturbance: Disturbance, plant: Plant) -> Scalar:
    """Net force F_1 − F_2 in N that the vehicle's motion asks of the ropes (paper Section 2.3)."""
    t, x, v, a, push, current, load = ca.vertsplit(outside)
    vehicle = plant.vehicle
    vortex = vortex_force(t, v, _phase(x, disturbance, vehicle), disturbance, vehicle)
    free = vehicle_acceleration(v, 0.0, Environment(push + vortex, current, load), vehicle)
    return inertia(vehicle) * (a - free)


def motor_torque(v: Scalar, a: Scalar, tension: Scalar, winch: Winch) -> Scalar:
    """Motor torque in N m that winds rope at v m/s and a m/s² against a tension in N (paper Section 2.4)."""
    idle = drum_acceleration(v / winch.drum_radius, tension, 0.0, winch)
    return winch.inertia / winch.gear_ratio * (a / winch.drum_radius - idle)


def _phase(x: Scalar, disturbance: Disturbance, vehicle: Vehicle) -> Scalar:
    """Integral of the vortex frequency, which is proportional to the speed, over the way to x in m."""
    return vortex_frequency(x, disturbance, vehicle)
