"""What of an experiment shapes the compiled code, which integrator solves it, and what are numbers at run time."""

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import cache, lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple

from dualwinch.codegen.source.expressions import GRAPHS
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.nominal import Nominal, nominal_plant, nominal_structure
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant, is_distributed, plant_structure, remembers_friction
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Leaf, Mark
from dualwinch.model.quantities.tree import alike, leaves, numbers, with_leaves
from dualwinch.model.ropes import is_kelvin_voigt
from dualwinch.model.scalar import Scalar
from dualwinch.simulation.experiment import Experiment, IntegratorName, Simulation
from dualwinch.simulation.integrators import INTEGRATORS
from dualwinch.simulation.integrators.problem import fastest_rate
from dualwinch.simulation.sensors import sensors_structure

GENERAL: IntegratorName = "rk4"
"""The integrator of ropes that the others do not know."""

DISTRIBUTED: IntegratorName = "verlet"
"""The integrator of ropes with mass or weight, of gearboxes that give, and of friction with a state."""

FINE = 0.5
"""Rate of the fastest swing times sub-step in rad, at most, where nobody says how many sub-steps."""

OVERSHOOT = 1.5
"""Tension beyond tension_max, as a factor, that sub-steps still keep up with."""


MOST_SUBSTEPS = 256
"""Sub-steps of a sample at most."""


class Solver(NamedTuple):
    """An integrator by its name, and its sub-steps a sample."""

    integrator: IntegratorName
    substeps: int

    def __str__(self) -> str:
        return f"{self.integrator} with {self.substeps} sub-steps"


def is_automatic(experiment: Experiment) -> bool:
    """Whether the ropes decide about integrator and sub-steps: one of them is no Kelvin–Voigt rope."""
    return not all(map(is_kelvin_voigt, (experiment.plant.rope_1, experiment.plant.rope_2)))


def solver_of(experiment: Experiment) -> Solver:
    """Integrator and sub-steps of an experiment.

    With Kelvin–Voigt ropes they are those it asks for; where ropes have mass or weight, gearboxes give or friction has
    a state, which the exponential integrators do not know, `DISTRIBUTED` takes their place. Ropes of other laws take a
    general integrator with at least as many sub-steps as it asks for, and a power of two of them that keeps up with
    the stiffest spring on the track, at tensions up to `OVERSHOOT` times tension_max.

    Raises:
        ConfigurationError: a rope's law has no finite spring rate at these tensions, or asks for too many sub-steps.
    """
    simulation = experiment.simulation
    distributed = is_distributed(experiment.plant) or remembers_friction(experiment.plant)
    general = DISTRIBUTED if distributed else GENERAL
    knows_all = INTEGRATORS[simulation.integrator].any_plant
    if not is_automatic(experiment):
        return Solver(general if distributed and not knows_all else simulation.integrator, simulation.substeps)
    integrator = simulation.integrator if knows_all else general
    plant, limits, rates = experiment.plant, experiment.controller.limits, dict[int, float]()
    tensions = (limits.tension_min, limits.preload / 2, limits.tension_max, OVERSHOOT * limits.tension_max)
    ropes = {1: (plant.rope_1, plant.winch_1), 2: (plant.rope_2, plant.winch_2)}
    for number, (rope, winch) in ropes.items():
        rates[number] = fastest_rate(rope, winch, plant.track, tensions)
        if not math.isfinite(rates[number]):
            raise ConfigurationError(
                f"plant.rope_{number}: the tension of '{rope.kind}' must grow with the stretch, "
                f"at {tensions[0]:g} to {tensions[-1]:g} N too"
            )
    number, fastest = max(rates.items(), key=lambda rate: rate[1])
    needed = math.ceil(fastest * simulation.sample_time / FINE)
    substeps = max(simulation.substeps, 1 << (needed - 1).bit_length())
    if substeps > MOST_SUBSTEPS:
        raise ConfigurationError(
            f"simulation.sample_time = {simulation.sample_time:g}: must be <= {MOST_SUBSTEPS * FINE / fastest:.4g} s "
            f'for plant.rope_{number}.kind = "{ropes[number][0].kind}", which swings at {fastest:.4g} rad/s'
        )
    return Solver(integrator, substeps)


@cache
def unknown_keys() -> frozenset[str]:
    """Keys ``nominal.*`` of what no controller believes of a plant."""
    return frozenset(key for key, leaf in describe_parts(Plant(), "nominal.").items() if Mark.UNKNOWN in leaf.marks)


KEPT_STRUCTURES = 64
"""Latest experiments whose numbers are kept: many calls in turn are about the same scenarios."""


@lru_cache(maxsize=KEPT_STRUCTURES)
def structure_of(experiment: Experiment) -> Experiment:
    """The experiment that stands for all that share its compiled code: of the same parts, with the same numbers in all.

    Everything that code is not shaped by is a number that it takes at run time, and has some value here.
    """
    solver, simulation = solver_of(experiment), experiment.simulation
    return Experiment(
        plant=plant_structure(experiment.plant),
        controller=_alike(experiment.controller),
        sensors=sensors_structure(experiment.sensors),
        actuator=alike(experiment.actuator),
        simulation=Simulation(
            integrator=solver.integrator,
            substeps=solver.substeps,
            delay_samples=simulation.delay_samples,
            jitter=Simulation.sample_time / 4 if simulation.jitter > 0 else 0.0,
            readings=simulation.readings,
        ),
        metrics=tuple(map(alike, experiment.metrics)),
    )


def symbolic_parts(experiment: Experiment, values: Mapping[str, Scalar]) -> Any:
    """What has the parts of an experiment with other numbers, which may be symbols; an experiment's own are checked.

    Args:
        experiment: gives parts, and the numbers that no key stands for.
        values: key → number.
    """
    groups = ("plant", "controller", "sensors", "actuator", "disturbance")
    parts = {name: with_leaves(getattr(experiment, name), values, f"{name}.") for name in groups}
    return SimpleNamespace(**parts, metrics=tuple(with_leaves(m, values, "metrics.") for m in experiment.metrics))


@lru_cache(maxsize=KEPT_STRUCTURES)
def _alike(controller: Controller) -> Controller:
    """A controller of the same structure with numbers of no controller in particular; nothing computes with them."""
    found = replace(alike(controller), nominal=Nominal())
    if found.preview != controller.preview:
        raise ConfigurationError(
            "preview: a part's times ahead follow from a number that may change at run time; mark it Mark.SHAPES_CODE"
        )
    return found


@GRAPHS.cached
def described_parameters(structure: Experiment) -> dict[str, Leaf]:
    """What every parameter of a closed loop is, by its key (`parameters_of`)."""
    known = {**describe_parts(structure), **describe_parts(nominal_structure(structure.plant), "nominal.")}
    return {key: known[key] for key in parameters_of(structure)}


def parameters_of(experiment: Experiment, nominal: Plant | None = None) -> dict[str, float]:
    """Every number of an experiment that the closed loop takes at run time, by its key.

    ``plant.*`` is the simulated plant, ``nominal.*`` the plant as the controller believes it to be.

    Args:
        experiment: gives the numbers.
        nominal: the plant the controller was designed for, where ``controller.nominal`` does not say otherwise;
            default: the simulated one.
    """
    return dict(_parameters_of(experiment, nominal))


@lru_cache(maxsize=KEPT_STRUCTURES)
def _parameters_of(experiment: Experiment, nominal: Plant | None) -> dict[str, float]:
    controller = experiment.controller
    gains = _gains(controller)
    own, other = (
        nominal_plant(controller.nominal, plant, controller.limits.preload)
        for plant in (experiment.plant, nominal or experiment.plant)
    )
    # code is shaped by the simulated plant: of what that has the other one may have nothing, a zero
    believed, unknown = leaves(other, "nominal."), unknown_keys()
    values = (
        numbers(experiment.plant, "plant.")
        | {key: believed[key] for key in numbers(own, "nominal.") if key not in unknown}
        | {key: value for key, value in gains.items() if not key.startswith("controller.nominal.")}
        | numbers(experiment.disturbance, "disturbance.")
        | numbers(experiment.sensors, "sensors.")
        | numbers(experiment.actuator, "actuator.")
        | {
            f"simulation.{name}": getattr(experiment.simulation, name)
            for name in ("sample_time", "jitter", "torque_step")
        }
        | {key: value for metric in experiment.metrics for key, value in numbers(metric, "metrics.").items()}
    )
    return {key: float(value) for key, value in values.items()}


@lru_cache(maxsize=KEPT_STRUCTURES)
def _gains(controller: Controller) -> dict[str, float]:
    """Not to be changed; kept, as the scenarios of an ensemble share their controller."""
    return numbers(controller, "controller.")


def zeros_of(structure: Experiment, *parameters: Mapping[str, float], varying: Collection[str] = ()) -> frozenset[str]:
    """Parameters that are zero in all of these: what they multiply can be left out of the compiled code.

    Only those that are often zero for good count (`Mark.OFF_AT_ZERO`): each choice of zeros is code of its own.

    Args:
        structure: of the closed loop.
        parameters: as by `parameters_of`.
        varying: keys of what may be another number elsewhere; those are not among the result.
    """
    changing = set(varying)
    if any(name.startswith("controller.nominal.") for name in varying):
        changing |= {name for name in parameters[0] if name.startswith("nominal.")}
    known = described_parameters(structure)
    candidates = {name for name, leaf in known.items() if Mark.OFF_AT_ZERO in leaf.marks} - changing
    return frozenset(name for name in candidates if not any(values[name] for values in parameters))
