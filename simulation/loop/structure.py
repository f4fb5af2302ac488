"""Structure of a closed loop, which determines its compiled code; its integrator; its run-time parameters."""

import math
from collections import ChainMap
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from dualwinch.codegen.source.expressions import GRAPHS
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.nominal import Nominal, nominal_plant, nominal_structure
from dualwinch.model.actuators import Actuator
from dualwinch.model.disturbance import Disturbance
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant, blank_state, is_distributed, plant_structure, remembers_friction
from dualwinch.model.quantities.description import describe, describe_parts
from dualwinch.model.quantities.quantity import Leaf, Mark
from dualwinch.model.quantities.tree import alike, leaves, numbers, with_leaves
from dualwinch.model.ropes import is_kelvin_voigt, kelvin_voigt
from dualwinch.model.scalar import Scalar
from dualwinch.simulation.experiment import Experiment, IntegratorName, Simulation
from dualwinch.simulation.integrators import INTEGRATORS, Motion
from dualwinch.simulation.integrators.stability import (
    bristle_swing_rate,
    fastest_rate,
    side_rate,
    stiff_keys,
    swing_rate,
)
from dualwinch.simulation.metrics.metric import Metric
from dualwinch.simulation.sensors import Sensors, sensors_structure

GENERAL: IntegratorName = "rk4"
"""Integrator for ropes that the exponential integrators do not support."""

DISTRIBUTED: IntegratorName = "verlet"
"""Integrator for ropes with mass or weight, elastic gearboxes, and friction with a state."""

FINE = 0.5
"""Highest natural frequency times sub-step in rad, at most, where the number of sub-steps is automatic."""

OVERSHOOT = 1.5
"""Tension up to which automatic sub-steps are short enough, as a multiple of tension_max."""

MOST_SUBSTEPS = int(describe(Simulation)["substeps"].bounds[1])
"""Maximum number of sub-steps per sample."""


class Solver(NamedTuple):
    """Name of an integrator and its number of sub-steps per sample."""

    integrator: IntegratorName
    substeps: int

    def __str__(self) -> str:
        return f"{self.integrator} with {self.substeps} sub-steps"


def is_automatic(experiment: Experiment) -> bool:
    """Whether the ropes determine integrator and sub-steps, as one of them is no Kelvin–Voigt rope."""
    return not all(map(is_kelvin_voigt, (experiment.plant.rope_1, experiment.plant.rope_2)))


def solver_of(experiment: Experiment) -> Solver:
    """Integrator and sub-steps of an experiment.

    With Kelvin–Voigt ropes they are the configured ones, except that `DISTRIBUTED` replaces an exponential integrator
    where ropes have mass or weight, gearboxes are elastic or friction has a state, and that the adaptive one has more
    sub-steps (a power of two) where the plant needs them (`stable_substeps`). Ropes of other laws use a general
    integrator with at least the configured number of sub-steps, or more (a power of two) where tensions up to
    `OVERSHOOT` times tension_max need them: for the accuracy of the stiffest spring on the track with its drum
    (`FINE`), and for the stability of the whole plant (`swing_rates`).

    Raises:
        ConfigurationError: a rope's law has no finite spring rate at these tensions, or needs too many sub-steps.
    """
    simulation = experiment.simulation
    distributed = is_distributed(experiment.plant) or remembers_friction(experiment.plant)
    general = DISTRIBUTED if distributed else GENERAL
    knows_all = INTEGRATORS[simulation.integrator].any_plant
    plant, limits, rates = experiment.plant, experiment.controller.limits, dict[int, float]()
    if not is_automatic(experiment):
        integrator = general if distributed and not knows_all else simulation.integrator
        needed = stable_substeps(plant, simulation, integrator, limits) if simulation.integrator == ADAPTIVE else 1
        return Solver(integrator, simulation.substeps if needed <= simulation.substeps else power_of_two(needed))
    integrator = simulation.integrator if knows_all else general
    tensions = tensions_of(limits)
    ropes = {1: (plant.rope_1, plant.winch_1), 2: (plant.rope_2, plant.winch_2)}
    for number, (rope, winch) in ropes.items():
        rates[number] = fastest_rate(rope, winch, plant.track, tensions)
        if not math.isfinite(rates[number]):
            raise ConfigurationError(
                f"plant.rope_{number}: the tension of '{rope.kind}' must grow with the stretch, "
                f"at {tensions[0]:g} to {tensions[-1]:g} N too"
            )
    number, fastest = max(rates.items(), key=lambda rate: rate[1])
    if fastest * simulation.sample_time > MOST_SUBSTEPS * FINE:
        raise ConfigurationError(
            f"simulation.sample_time = {simulation.sample_time:g}: must be <= {MOST_SUBSTEPS * FINE / fastest:.4g} s "
            f'for plant.rope_{number}.kind = "{ropes[number][0].kind}", which oscillates at {fastest:.4g} rad/s'
        )
    stable = stable_substeps(plant, simulation, integrator, limits)
    needed = max(math.ceil(fastest * simulation.sample_time / FINE), stable)
    return Solver(integrator, max(simulation.substeps, power_of_two(needed)))


ADAPTIVE: IntegratorName = "adaptive"
"""The integrator whose number of sub-steps is a least one."""


def power_of_two(number: int) -> int:
    """The smallest power of two that is not less than a whole number."""
    return 1 << (number - 1).bit_length()


@lru_cache(maxsize=1024)
def stable_substeps(plant: Plant, simulation: Simulation, integrator: IntegratorName, limits: Limits) -> int:
    """Least number of sub-steps per sample that an integrator needs for a plant.

    Cached, as tangents of a rope of any law take Newton's method.

    Raises:
        ConfigurationError: it is more than `MOST_SUBSTEPS`.
        OverflowError: a number of the plant overflows.
    """
    needed = math.ceil(float(substeps_for(plant, simulation, integrator, limits)))
    if needed > MOST_SUBSTEPS:
        mode = stiffest_mode(plant, integrator, limits)
        allowed = MOST_SUBSTEPS * INTEGRATORS[integrator].reach / mode.rate
        raise ConfigurationError(
            f"simulation.sample_time = {simulation.sample_time:g}: must be <= {allowed:.4g} s for {mode.keys}, with "
            f"{MOST_SUBSTEPS} sub-steps of {integrator} ({mode})"
        )
    return needed


def substeps_for(plant: Plant, simulation: Simulation, integrator: IntegratorName, limits: Limits) -> Any:
    """Sub-steps per sample, not rounded, that an integrator needs for a plant; an array for a plant of arrays."""
    fastest = np.maximum.reduce(np.broadcast_arrays(*swing_rates(plant, integrator, limits).values()))
    return fastest * simulation.sample_time / INTEGRATORS[integrator].reach


def swing_rates(plant: Plant, integrator: IntegratorName, limits: Limits) -> dict[str, Any]:
    """Rates in rad/s whose product with the sub-step an integrator bounds (`Integrator.reach`).

    Returns:
        ``rope_1`` and ``rope_2``, each with its winch, and ``vehicle`` on its bristles; arrays for a plant of arrays.
    """
    rate, tensions = INTEGRATORS[integrator].rate, tensions_of(limits)
    rates: dict[str, Any] = {"vehicle": bristle_swing_rate(plant.vehicle)}
    for side in plant.sides:
        rates[f"rope_{side.number}"] = (
            swing_rate(kelvin_voigt(side.rope), side.winch, plant.track)
            if rate is None
            else side_rate(side, plant.vehicle, plant.track, tensions, rate)
        )
    return rates


def tensions_of(limits: Limits) -> tuple[float, ...]:
    """Tensions in N at which ropes are linearised for the choice of sub-steps."""
    return limits.tension_min, limits.preload / 2, limits.tension_max, OVERSHOOT * limits.tension_max


class StiffMode(NamedTuple):
    """What limits an integrator's step: its rate in rad/s, the part that moves, and the keys that make it stiff."""

    rate: float
    part: str
    verb: str
    keys: str

    def __str__(self) -> str:
        return f"the {self.part} {self.verb} at {self.rate:.4g} rad/s"


def stiffest_mode(plant: Plant, integrator: IntegratorName, limits: Limits) -> StiffMode:
    """The mode of a plant that limits an integrator's step."""
    rates = swing_rates(plant, integrator, limits)
    part = max(rates, key=lambda name: float(rates[name]))
    number = part.partition("_")[2]
    parts = (part, f"winch_{number}") if number else (part,)
    keys = stiff_keys(plant, parts, lambda changed: float(swing_rates(changed, integrator, limits)[part]))
    words = ", ".join(f"{key} = {value:g}" for key, value in keys.items())
    moving = "vehicle on its bristles"
    if number:
        moving = f"gearbox of winch {number}" if any("gear" in key for key in keys) else "shortest rope"
        rope = getattr(plant, part)
        if not is_kelvin_voigt(rope) and not any("gear" in key or key.endswith("friction") for key in keys):
            words = f'plant.{part}.kind = "{rope.kind}"'
    settles = any(key.endswith(("damping", "loss_factor", "friction")) for key in keys)
    return StiffMode(float(rates[part]), moving, "settles" if settles else "oscillates", words)


@cache
def unknown_keys() -> frozenset[str]:
    """Keys ``nominal.*`` of plant parameters that no controller knows."""
    return frozenset(key for key, leaf in describe_parts(Plant(), "nominal.").items() if Mark.UNKNOWN in leaf.marks)


PARTS = ("plant", "controller", "sensors", "actuator", "disturbance")
"""Parts with run-time parameters, whose keys begin with the part's name; beside them the figures of merit."""


@dataclass(frozen=True)
class LoopStructure:
    """What shapes the compiled code of a closed loop: its parts, and how they are sampled and integrated.

    Experiments of one structure share their code, and differ only in the numbers that it takes as `parameters`. The
    same numbers have no meaning in the parts here, where each has a value that depends on its bounds alone, so that
    structures of the same code are equal.

    Attributes:
        plant, controller, sensors, actuator, metrics, disturbance: the parts, with the numbers that shape code.
        integrator, substeps: of the plant between two samples.
        delay_samples: delay of torque commands in samples.
        jitter: whether samples are early or late.
        readings: whether rows include sensor readings.
    """

    plant: Plant
    controller: Controller
    sensors: Sensors
    actuator: Actuator
    metrics: tuple[Metric, ...]
    integrator: IntegratorName
    substeps: int
    delay_samples: int = 0
    jitter: bool = False
    readings: bool = False
    disturbance: Disturbance = field(default_factory=Disturbance)

    @property
    def parameters(self) -> dict[str, Leaf]:
        """Key → metadata of every run-time parameter (`parameters_of`), in the order of the code's vector."""
        return _described_parameters(self)

    @property
    def motion(self) -> Motion:
        """State of the plant between two samples, all zero."""
        return Motion(blank_state(self.plant))

    @property
    def nominal(self) -> Plant:
        """Structure of the controller's nominal plant, whose parameters are ``nominal.*``."""
        return nominal_structure(self.plant)


@lru_cache
def structure_of(experiment: Experiment) -> LoopStructure:
    """The structure of an experiment's closed loop.

    Raises:
        ConfigurationError: the ropes need too many sub-steps (`solver_of`), or preview times vary at run time.
    """
    solver, simulation = solver_of(experiment), experiment.simulation
    return LoopStructure(
        plant=plant_structure(experiment.plant),
        controller=_alike(experiment.controller),
        sensors=sensors_structure(experiment.sensors),
        actuator=alike(experiment.actuator),
        metrics=tuple(map(alike, experiment.metrics)),
        integrator=solver.integrator,
        substeps=solver.substeps,
        delay_samples=simulation.delay_samples,
        jitter=simulation.jitter > 0,
        readings=simulation.readings,
    )


def symbolic_parts(owner: Experiment | LoopStructure, values: Mapping[str, Scalar]) -> Any:
    """The parts of an experiment or a structure with other numbers, which may be symbols or arrays, in a namespace.

    Numbers without a key in `values` are those of the owner.
    """
    parts = {name: with_leaves(getattr(owner, name), values, f"{name}.") for name in PARTS}
    return SimpleNamespace(**parts, metrics=tuple(with_leaves(m, values, "metrics.") for m in owner.metrics))


@lru_cache
def _alike(controller: Controller) -> Controller:
    """A controller of the same structure with placeholder numbers."""
    shape = replace(alike(controller), nominal=Nominal())
    if shape.preview != controller.preview:
        raise ConfigurationError(
            "preview: a part's times ahead follow from a number that may change at run time; mark it Mark.SHAPES_CODE"
        )
    return shape


@GRAPHS.cached
def _described_parameters(structure: LoopStructure) -> dict[str, Leaf]:
    groups = {name: getattr(structure, name) for name in PARTS}
    groups |= {"nominal": structure.nominal, "simulation": Simulation()}
    descriptions = [describe_parts(group, f"{name}.") for name, group in groups.items()]
    described = ChainMap(*map(dict, descriptions), *(dict(describe_parts(m, "metrics.")) for m in structure.metrics))
    nominal = nominal_plant(Nominal(), structure.plant, structure.controller.limits.preload)
    names = _values(structure, Simulation(), nominal, nominal)
    return {name: described[name] for name in names}


def parameters_of(experiment: Experiment, nominal: Plant | None = None) -> dict[str, float]:
    """Run-time parameters of the closed loop of an experiment, by key.

    ``plant.*`` is the simulated plant, ``nominal.*`` the controller's model of it: the plant it was designed for
    (default: the simulated one), unless ``controller.nominal`` overrides it.
    """
    return dict(_parameters_of(experiment, nominal))


@lru_cache
def _parameters_of(experiment: Experiment, nominal: Plant | None) -> dict[str, float]:
    controller = experiment.controller
    nominal_simulated, assumed = (
        nominal_plant(controller.nominal, plant, controller.limits.preload)
        for plant in (experiment.plant, nominal or experiment.plant)
    )
    values = _values(experiment, experiment.simulation, nominal_simulated, assumed)
    return {key: float(value) for key, value in values.items()}


def _values(parts: Experiment | LoopStructure, simulation: Simulation, own: Plant, assumed: Plant) -> dict[str, Any]:
    """Run-time parameters of a loop's parts; `own`, the simulated plant's nominal, determines which are ``nominal.*``.

    Code has the structure of the simulated plant: parameters that the assumed plant lacks are zero.
    """
    nominal, unknown = leaves(assumed, "nominal."), unknown_keys()
    return (
        numbers(parts.plant, "plant.")
        | {key: nominal[key] for key in numbers(own, "nominal.") if key not in unknown}
        | {key: value for key, value in _gains(parts.controller).items() if not key.startswith("controller.nominal.")}
        | numbers(parts.disturbance, "disturbance.")
        | numbers(parts.sensors, "sensors.")
        | numbers(parts.actuator, "actuator.")
        | {f"simulation.{name}": getattr(simulation, name) for name in ("sample_time", "jitter", "torque_step")}
        | {key: value for metric in parts.metrics for key, value in numbers(metric, "metrics.").items()}
    )


@lru_cache
def _gains(controller: Controller) -> dict[str, float]:
    """Gains by key (read-only); cached, as the scenarios of an ensemble share their controller."""
    return numbers(controller, "controller.")


def zeros_of(
    structure: LoopStructure, *parameters: Mapping[str, float], varying: Collection[str] = ()
) -> frozenset[str]:
    """Parameters that are zero in all these sets (`parameters_of`), so that compiled code can leave out their terms.

    Only parameters marked `Mark.OFF_AT_ZERO` are considered, as every set of zeros needs its own compiled code;
    `varying` keys, whose values may differ elsewhere, are excluded.
    """
    changing = set(varying)
    if any(name.startswith("controller.nominal.") for name in varying):
        changing |= {name for name in parameters[0] if name.startswith("nominal.")}
    candidates = {name for name, leaf in structure.parameters.items() if Mark.OFF_AT_ZERO in leaf.marks} - changing
    return frozenset(name for name in candidates if not any(values[name] for values in parameters))
