"""What of an experiment shapes the compiled code, and what are numbers it takes at run time."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import lru_cache

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.limits import Coordination
from dualwinch.controllers.nominal import nominal_plant
from dualwinch.model.plant import Plant
from dualwinch.model.quantity import numbers
from dualwinch.simulation.experiment import Experiment, Simulation


@dataclass(frozen=True)
class Structure:
    """What shapes the compiled code; everything else is a number it takes at run time."""

    kind: str
    estimator: str
    coordination: str
    rope_slack: bool
    integrator: str
    substeps: int
    delay_samples: int


def template_of(structure: Structure) -> Experiment:
    """An experiment of a structure; its numbers are those of no experiment in particular."""
    return Experiment(
        plant=Plant(rope_slack=structure.rope_slack),
        controller=Controller(
            kind=structure.kind,  # pyright: ignore[reportArgumentType]
            estimator=structure.estimator,  # pyright: ignore[reportArgumentType]
            coordination=Coordination(kind=structure.coordination),  # pyright: ignore[reportArgumentType]
        ),
        simulation=Simulation(delay_samples=structure.delay_samples),
    )


KEPT = 64
"""Latest experiments whose numbers are kept: many calls in turn are about the same scenarios."""

DISTURBANCE_NUMBERS = ("vortex", "integrated_phase", "vortex_amplitude", "strouhal")
"""What a run takes of the disturbance as numbers; the first two are switches, 0 or 1."""


def structure_of(experiment: Experiment) -> Structure:
    """The part of an experiment that shapes the compiled code."""
    simulation = experiment.simulation
    return Structure(
        kind=experiment.controller.kind,
        estimator=experiment.controller.estimator,
        coordination=experiment.controller.coordination.kind,
        rope_slack=experiment.plant.rope_slack,
        integrator=simulation.integrator,
        substeps=simulation.substeps,
        delay_samples=simulation.delay_samples,
    )


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
    disturbance = experiment.disturbance
    gains = numbers(experiment.controller, "controller.")
    values = (
        numbers(experiment.plant, "plant.")
        | numbers(nominal_plant(experiment.controller.nominal, nominal or experiment.plant), "nominal.")
        | {key: value for key, value in gains.items() if not key.startswith("controller.nominal.")}
        | {f"disturbance.{key}": getattr(disturbance, key) for key in DISTURBANCE_NUMBERS}
        | numbers(experiment.sensors, "sensors.")
        | {"simulation.sample_time": experiment.simulation.sample_time}
    )
    return {key: float(value) for key, value in values.items()}


SWITCHES_OFF = (
    "plant.",
    "nominal.",
    "sensors.",
    "disturbance.",
    "controller.speed_filter_time",
    "controller.winch_1.kd",
    "controller.winch_2.kd",
)
"""Parameters that are often zero for good, by what their names begin with: each choice of zeros is code of its own."""


def zeros_of(*parameters: Mapping[str, float], varying: Collection[str] = ()) -> frozenset[str]:
    """Parameters that are zero in all of these: what they multiply can be left out of the compiled code.

    Args:
        parameters: as by `parameters_of`.
        varying: keys of what may be another number elsewhere; those are not among the result.
    """
    changing = set(varying)
    if any(name.startswith("controller.nominal.") for name in varying):
        changing |= {name for name in parameters[0] if name.startswith("nominal.")}
    candidates = {name for name in parameters[0] if name.startswith(SWITCHES_OFF)} - changing
    return frozenset(name for name in candidates if not any(one[name] for one in parameters))
