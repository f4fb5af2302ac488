"""The machine under recorded torques as a filter sees it: motion, motors, and what acts on it unrecorded.

Its equations are those of every simulation (`simulation.loop.zero_order_hold`, `model.actuators`); from sample to
sample torques and the unrecorded are held.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import casadi as ca

from dualwinch.codegen.sampled import PredictedSystem
from dualwinch.codegen.source.expressions import built_once
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.nominal import Nominal
from dualwinch.identification.sensed import sensed
from dualwinch.identification.unrecorded import NAMES, Unrecorded
from dualwinch.model.actuators import drive
from dualwinch.model.plant import Torques, torques_amid
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.scalar import Scalar, exp
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

INPUTS = ("t", "tau_1", "tau_2", "duration")
"""What the machine is given at a sample: time in s, torque commands in N m, time in s until the next sample."""

PARTS = 8
"""Sub-steps of a sample where a rope is slack or about to be."""

GROUPS = ("plant", "sensors", "actuator", "disturbance")
"""Groups of an experiment whose numbers the filter takes."""

SAMPLE_TIME = "simulation.sample_time"

TIMES = tuple(f"time.{name}" for name in NAMES)
"""Correlation times in s of what is unrecorded, as further numbers."""


@dataclass(frozen=True)
class MachineState:
    """State of the machine."""

    motion: Motion
    actuator_1: Any
    actuator_2: Any
    unrecorded: Unrecorded


def machine_of(experiment: Experiment) -> Structure:
    """What of an experiment shapes the filter's code: nothing of its controller."""
    structure = structure_of(replace(experiment, controller=Controller(nominal=Nominal()), metrics=()))
    return replace(structure, delay_samples=0, silence=None, readings=False)


def state_template(structure: Structure) -> MachineState:
    """What names the elements of the state; its numbers mean nothing."""
    actuator = template_of(structure).actuator.initial_state()
    return MachineState(MOTION_TEMPLATE, actuator, actuator, Unrecorded())


@cache
def parameter_names(structure: Structure) -> tuple[str, ...]:
    """Keys of all numbers that the filter takes, in their order."""
    begins = tuple(f"{group}." for group in GROUPS)
    own = (key for key in parameters_of(template_of(structure)) if key.startswith(begins))
    return (*own, SAMPLE_TIME, *TIMES)


@built_once
def predicted(structure: Structure, fitted: tuple[str, ...], zeros: frozenset[str] = frozenset()) -> PredictedSystem:
    """The functions of a machine, some of whose numbers are to be fitted.

    Args:
        structure: of `machine_of`.
        fitted: keys, some of `parameter_names`.
        zeros: keys of numbers that are zero for good (`simulation.loop.structure.zeros_of`), none of them fitted.
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
    readings = sensed(now.motion.plant, given["t"], plant, groups["sensors"], now.unrecorded.position_drift)

    asked = Torques(given["tau_1"], given["tau_2"])
    actuators = now.actuator_1, now.actuator_2
    actuators, torques = drive(actuators, asked, now.motion.plant, plant, groups["actuator"], sample_time)
    torques, acting = torques_amid(torques, now.motion.plant, sample_time, plant), now.unrecorded
    hold = zero_order_hold(
        structure,
        t=given["t"],
        torques=Torques(torques.tau_1 + acting.torque_1, torques.tau_2 + acting.torque_2),
        current=acting.current,
        normal_force_variation=acting.normal_force_variation,
        force=acting.force,
        duration=given["duration"],
    )
    following = leaves(MachineState(now.motion, *actuators, _fading(acting, values, sample_time)))
    rest = ca.vertcat(*(value for key, value in following.items() if not key.startswith("motion.")))
    held = ca.vertcat(*leaves(hold).values())

    def problem(hold: Any) -> Problem:
        return problem_of(hold, sample_time, plant, groups["disturbance"])

    _, one_step = between_samples(structure, problem, symbols["parameters"])
    careful = replace(structure, integrator="rk4", substeps=PARTS) if one_step else structure
    move, _ = between_samples(careful, problem, symbols["parameters"])
    return PredictedSystem(
        sense=named_function("sense", symbols, {"reading": ca.vertcat(*leaves(readings).values())}),
        prepare=named_function("prepare", symbols, {"rest": rest, "hold": held}),
        move=move,
        parts=careful.substeps,
        one_step=one_step,
        fitted=tuple(names["parameters"].index(key) for key in fitted),
    )


def _fading(acting: Unrecorded, values: Mapping[str, Scalar], sample_time: Scalar) -> Unrecorded:
    """What is expected of the unrecorded at the next sample."""
    kept = {name: exp(-sample_time / values[f"time.{name}"]) for name in NAMES}
    return Unrecorded(**{name: kept[name] * value for name, value in vars(acting).items()})
