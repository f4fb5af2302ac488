"""What of an experiment shapes the compiled code, and what are numbers it takes at run time."""

from collections.abc import Collection, Hashable, Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import TypeVar

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.nominal import Nominal, nominal_plant
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Leaf, Mark
from dualwinch.model.quantities.tree import numbers, with_leaves
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.metrics.metric import Metric


@dataclass(frozen=True)
class Structure:
    """What shapes the compiled code; everything else is a number it takes at run time.

    Attributes:
        controller: its parts, with all their numbers alike: only what they are made of counts.
        rope_slack, integrator, substeps, delay_samples: as in an experiment.
        metrics: figures of merit beside the built-in ones, as the controller.
    """

    controller: Controller
    rope_slack: bool
    integrator: str
    substeps: int
    delay_samples: int
    metrics: tuple[Metric, ...] = ()


def template_of(structure: Structure) -> Experiment:
    """An experiment of a structure; its numbers are those of no experiment in particular."""
    return Experiment(
        plant=Plant(rope_slack=structure.rope_slack),
        controller=structure.controller,
        simulation=Simulation(delay_samples=structure.delay_samples),
        metrics=structure.metrics,
    )


KEPT = 64
"""Latest experiments whose numbers are kept: many calls in turn are about the same scenarios."""


def structure_of(experiment: Experiment) -> Structure:
    """The part of an experiment that shapes the compiled code."""
    simulation = experiment.simulation
    return Structure(
        controller=_alike(experiment.controller),
        rope_slack=experiment.plant.rope_slack,
        integrator=simulation.integrator,
        substeps=simulation.substeps,
        delay_samples=simulation.delay_samples,
        metrics=tuple(map(_with_some_numbers, experiment.metrics)),
    )


@lru_cache(maxsize=KEPT)
def _alike(controller: Controller) -> Controller:
    """A controller of the same structure with numbers of no controller in particular; nothing computes with them."""
    return replace(_with_some_numbers(controller), nominal=Nominal())


Group = TypeVar("Group", bound=Hashable)


@lru_cache(maxsize=KEPT)
def _with_some_numbers(group: Group) -> Group:
    known = describe_parts(group)
    return with_leaves(group, {key: known[key].some_value for key in numbers(group)})


@cache
def described_parameters(structure: Structure) -> dict[str, Leaf]:
    """What every parameter of a closed loop is, by its key (`parameters_of`)."""
    template = template_of(structure)
    known = {**describe_parts(template), **describe_parts(template.plant, "nominal.")}
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
    gains = numbers(experiment.controller, "controller.")
    values = (
        numbers(experiment.plant, "plant.")
        | numbers(nominal_plant(experiment.controller.nominal, nominal or experiment.plant), "nominal.")
        | {key: value for key, value in gains.items() if not key.startswith("controller.nominal.")}
        | numbers(experiment.disturbance, "disturbance.")
        | numbers(experiment.sensors, "sensors.")
        | {"simulation.sample_time": experiment.simulation.sample_time}
        | {key: value for metric in experiment.metrics for key, value in numbers(metric, "metrics.").items()}
    )
    return {key: float(value) for key, value in values.items()}


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
