"""What of an experiment shapes the compiled code, which integrator solves it, and what are numbers at run time."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import NamedTuple

from dualwinch.codegen.source.expressions import GRAPHS
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.nominal import Nominal, nominal_plant, nominal_structure
from dualwinch.model.actuators import Actuator
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant, plant_structure
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Leaf, Mark
from dualwinch.model.quantities.tree import alike, numbers
from dualwinch.model.ropes import is_kelvin_voigt
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.integrators import INTEGRATORS
from dualwinch.simulation.integrators.problem import fastest_rate
from dualwinch.simulation.metrics.metric import Metric
from dualwinch.simulation.sensors import Sensors, Silence, silence_of

GENERAL = "rk4"
"""The integrator of ropes that the others do not know."""

FINE = 0.5
"""Rate of the fastest swing times sub-step in rad, at most, where nobody says how many sub-steps."""

OVERSHOOT = 1.5
"""Tension beyond tension_max, as a factor, that sub-steps still keep up with."""


class Solver(NamedTuple):
    """An integrator by its name, and its sub-steps a sample."""

    integrator: str
    substeps: int

    def __str__(self) -> str:
        return f"{self.integrator} with {self.substeps} sub-steps"


def is_automatic(experiment: Experiment) -> bool:
    """Whether the ropes decide about integrator and sub-steps: one of them is no Kelvin–Voigt rope."""
    return not all(map(is_kelvin_voigt, (experiment.plant.rope_1, experiment.plant.rope_2)))


def solver_of(experiment: Experiment) -> Solver:
    """Integrator and sub-steps of an experiment.

    With Kelvin–Voigt ropes they are those it asks for. Ropes of other laws take an integrator that knows nothing of
    them, with at least as many sub-steps as it asks for, and a power of two of them that keeps up with the stiffest
    spring on the track, at tensions up to `OVERSHOOT` times tension_max.

    Raises:
        ConfigurationError: a rope's law has no finite spring rate at these tensions.
    """
    simulation = experiment.simulation
    if not is_automatic(experiment):
        return Solver(simulation.integrator, simulation.substeps)
    integrator = simulation.integrator if INTEGRATORS[simulation.integrator].any_rope else GENERAL
    needed = math.ceil(max(swing_rates(experiment)) * simulation.sample_time / FINE)
    return Solver(integrator, max(simulation.substeps, 1 << (needed - 1).bit_length()))


def swing_rates(experiment: Experiment) -> tuple[float, float]:
    """Fastest swings in rad/s of both ropes with their drums, at tensions that occur.

    Raises:
        ConfigurationError: a rope's law has no finite spring rate at these tensions.
    """
    plant, limits = experiment.plant, experiment.controller.limits
    tensions = (limits.tension_min, limits.preload / 2, limits.tension_max, OVERSHOOT * limits.tension_max)
    rates = []
    for number, rope, winch in ((1, plant.rope_1, plant.winch_1), (2, plant.rope_2, plant.winch_2)):
        rate = fastest_rate(rope, winch, plant.track, tensions)
        if not math.isfinite(rate):
            raise ConfigurationError(
                f"plant.rope_{number}: the tension of '{rope.kind}' must grow with the stretch, "
                f"at {tensions[0]:g} to {tensions[-1]:g} N too"
            )
        rates.append(rate)
    return rates[0], rates[1]


@dataclass(frozen=True)
class Structure:
    """What shapes the compiled code; everything else is a number it takes at run time.

    Attributes:
        plant, controller, actuator: their parts, with all numbers alike: only what they are made of counts.
        integrator, substeps: what solves the plant.
        delay_samples: as in an experiment.
        metrics: figures of merit beside the built-in ones, likewise.
        silence: what a silent position sensor reads (`exogenous.sensors.silence_of`).
        jitters: whether samples are early or late.
        readings: whether rows hold what the sensors say.
    """

    plant: Plant
    controller: Controller
    actuator: Actuator
    integrator: str
    substeps: int
    delay_samples: int
    metrics: tuple[Metric, ...] = ()
    silence: Silence | None = None
    jitters: bool = False
    readings: bool = False


def template_of(structure: Structure) -> Experiment:
    """An experiment of a structure; its numbers are those of no experiment in particular."""
    sensors, jitter = Sensors(), Simulation.sample_time / 4 if structure.jitters else 0.0
    if structure.silence:
        sensors = Sensors(outage=structure.silence, outage_length=1.0)
    return Experiment(
        plant=structure.plant,
        controller=structure.controller,
        sensors=sensors,
        actuator=structure.actuator,
        simulation=Simulation(delay_samples=structure.delay_samples, jitter=jitter, readings=structure.readings),
        metrics=structure.metrics,
    )


@cache
def unknown_keys() -> frozenset[str]:
    """Keys ``nominal.*`` of what no controller believes of a plant."""
    return frozenset(key for key, leaf in describe_parts(Plant(), "nominal.").items() if Mark.UNKNOWN in leaf.marks)


KEPT = 64
"""Latest experiments whose numbers are kept: many calls in turn are about the same scenarios."""


def structure_of(experiment: Experiment) -> Structure:
    """The part of an experiment that shapes the compiled code."""
    solver = solver_of(experiment)
    return Structure(
        plant=plant_structure(experiment.plant),
        controller=_alike(experiment.controller),
        actuator=alike(experiment.actuator),
        integrator=solver.integrator,
        substeps=solver.substeps,
        delay_samples=experiment.simulation.delay_samples,
        metrics=tuple(map(alike, experiment.metrics)),
        silence=silence_of(experiment.sensors),
        jitters=experiment.simulation.jitter > 0,
        readings=experiment.simulation.readings,
    )


@lru_cache(maxsize=KEPT)
def _alike(controller: Controller) -> Controller:
    """A controller of the same structure with numbers of no controller in particular; nothing computes with them."""
    found = replace(alike(controller), nominal=Nominal())
    if found.preview != controller.preview:
        raise ConfigurationError(
            "preview: a part's times ahead follow from a number that may change at run time; mark it Mark.SHAPES_CODE"
        )
    return found


@GRAPHS.cached
def described_parameters(structure: Structure) -> dict[str, Leaf]:
    """What every parameter of a closed loop is, by its key (`parameters_of`)."""
    template = template_of(structure)
    known = {**describe_parts(template), **describe_parts(nominal_structure(template.plant), "nominal.")}
    return {key: known[key] for key in parameters_of(template)}


def shaping_keys(experiment: Experiment) -> frozenset[str]:
    """Keys of an experiment whose values shape the compiled code."""
    return frozenset(key for key, leaf in describe_parts(experiment).items() if leaf.shapes_code)


def parameters_of(experiment: Experiment, nominal: Plant | None = None) -> dict[str, float]:
    """Every number of an experiment that the closed loop takes at run time, by its key.

    ``plant.*`` is the simulated plant, ``nominal.*`` the plant as the controller believes it to be.

    Args:
        experiment: gives the numbers.
        nominal: the plant the controller was designed for, where ``controller.nominal`` does not say otherwise;
            default: the simulated one.
    """
    return dict(_parameters_of(experiment, nominal))


@lru_cache(maxsize=KEPT)
def _parameters_of(experiment: Experiment, nominal: Plant | None) -> dict[str, float]:
    controller = experiment.controller
    gains = _gains(controller)
    believed = nominal_plant(controller.nominal, nominal or experiment.plant, controller.limits.preload)
    unknown = unknown_keys()
    values = (
        numbers(experiment.plant, "plant.")
        | {key: value for key, value in numbers(believed, "nominal.").items() if key not in unknown}
        | {key: value for key, value in gains.items() if not key.startswith("controller.nominal.")}
        | numbers(experiment.disturbance, "disturbance.")
        | numbers(experiment.sensors, "sensors.")
        | numbers(experiment.actuator, "actuator.")
        | {f"simulation.{name}": getattr(experiment.simulation, name) for name in ("sample_time", "jitter")}
        | {key: value for metric in experiment.metrics for key, value in numbers(metric, "metrics.").items()}
    )
    return {key: float(value) for key, value in values.items()}


@lru_cache(maxsize=KEPT)
def _gains(controller: Controller) -> dict[str, float]:
    """Not to be changed; kept, as the scenarios of an ensemble share their controller."""
    return numbers(controller, "controller.")


def zeros_of(structure: Structure, *parameters: Mapping[str, float], varying: Collection[str] = ()) -> frozenset[str]:
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
