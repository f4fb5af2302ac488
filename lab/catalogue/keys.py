"""What every number of the lab is: unit, meaning, bounds, default, range of a slider; all from the annotations."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dualwinch.controllers.nominal import nominal_plant
from dualwinch.lab.wasm.settings import DURATION, KIND, MOTIONS
from dualwinch.lab.wasm.structures import REGISTRIES, LabStructure
from dualwinch.lab.wasm.wide import LAG
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Leaf, Mark
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.reference import cruise_speed
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.space import own_bounds

WIDER = 3.0
"""How far a slider reaches beyond a default, as a factor."""


@dataclass(frozen=True)
class Slider:
    """Where a number is moved by hand, and on which scale."""

    low: float
    high: float
    scale: str = "linear"


def default_of(key: str, structure: LabStructure) -> float | None:
    """The number of a key where nothing is said; None where it is left open."""
    return number_of(key, leaves(structure.experiment))


def number_of(key: str, values: Mapping[str, Any]) -> float | None:
    """The number of a key among the values of an experiment, as a module takes it; None where it is left open."""
    value = values.get(key, 0.0 if key == LAG else None)
    if key == KIND:
        return float(MOTIONS.index(value))
    return None if value is None else float(value)


def described(structure: LabStructure, rig: Ensemble) -> dict[str, dict[str, Any]]:
    """Every key of a structure with what it is, as the catalogue has it.

    Args:
        structure: whose keys.
        rig: an ensemble of real machines, which says how far imperfections reach that a perfect machine lacks.
    """
    known = structure.module.described
    return {key: _entry(key, known[key], structure, rig) for key in structure.module.keys}


def chosen(structures: Sequence[LabStructure]) -> dict[str, dict[str, Any]]:
    """What structures differ in, likewise: every key with what may be chosen, and what people call it."""
    usual, found = structures[0], {}
    for key, default in usual.settings:
        leaf = describe_parts(usual.experiment)[key]
        options = list(dict.fromkeys(structure.chosen[key] for structure in structures))
        registry = REGISTRIES.get(key)
        found[key] = {
            "unit": leaf.quantity.unit,
            "meaning": leaf.quantity.meaning,
            "source": leaf.quantity.source,
            "group": key.rpartition(".")[0],
            "kind": "part",
            "default": default,
            "choices": options,
            "labels": [registry.find(option).label if registry else str(option).lower() for option in options],
        }
    return found


def _entry(key: str, leaf: Leaf, structure: LabStructure, rig: Ensemble) -> dict[str, Any]:
    default = default_of(key, structure)
    low, high = leaf.bounds if key != LAG else (0.0, math.inf)
    if key == KIND:
        low, high = 0.0, float(len(MOTIONS) - 1)
    experiment = structure.experiment
    around = _typical(key, experiment) if default is None else default
    searched = own_bounds([key], leaf.tunable, structure.module.wide) if leaf.tunable else None
    slider = _slider(leaf, around, (low, high), _of_rig(key, rig), searched)
    return {
        "unit": leaf.quantity.unit,
        "meaning": leaf.quantity.meaning,
        "source": leaf.quantity.source,
        "group": key.rpartition(".")[0],
        "kind": _kind(key, leaf),
        "low": None if math.isinf(low) else low,
        "high": None if math.isinf(high) else high,
        "default": default,
        "instead": instead_of(key, experiment),
        "optional": leaf.optional,
        "tunable": leaf.tunable is not None,
        "choices": list(MOTIONS) if key == KIND else None,
        "slider": [slider.low, slider.high],
        "scale": slider.scale,
    }


def _kind(key: str, leaf: Leaf) -> str:
    """What a value is: a number, a whole number, a switch (0 or 1), or the index of a choice."""
    if key == KIND:
        return "choice"
    if Mark.SWITCH in leaf.marks:
        return "switch"
    return "integer" if leaf.kind is int else "number"


def _slider(
    leaf: Leaf,
    around: float,
    bounds: tuple[float, float],
    reach: tuple[float, float] | None,
    searched: tuple[float, float] | None,
) -> Slider:
    """Where a slider goes.

    Args:
        leaf: what the number is.
        around: the number where nothing is said.
        bounds: of what is allowed.
        reach: what a rig's number may be, where that is another one.
        searched: where it is searched for when it is tuned.
    """
    if leaf.tunable and searched:
        return Slider(*searched, "log" if leaf.tunable.log and searched[0] > 0 else "linear")
    finite = all(map(math.isfinite, bounds))
    if leaf.kind is not float and finite:
        return Slider(*bounds)
    if reach and not around:
        wider = 1.0 if Mark.COURSE in leaf.marks else WIDER
        return _clipped(wider * min(reach[0], 0.0), wider * reach[1], bounds)
    if around:
        return _clipped(around / WIDER, around * WIDER, bounds)
    return Slider(*bounds) if finite else _clipped(-1.0, 1.0, bounds)


def instead_of(key: str, experiment: Experiment) -> float | None:
    """The number that stands in for an optional one that is left open; None where there is none."""
    prefix = "controller.nominal."
    if key.startswith(prefix):
        believed = nominal_plant(experiment.controller.nominal, experiment.plant, experiment.controller.limits.preload)
        return getattr(believed.vehicle, key.removeprefix(prefix))
    return {DURATION: experiment.duration, "reference.speed": cruise_speed(experiment.reference)}.get(key)


def _typical(key: str, experiment: Experiment) -> float:
    """A number to begin with of an optional one that is left open."""
    instead = instead_of(key, experiment)
    if instead is None and key == "reference.jerk_limit":  # ten times the least that its speed can be gained with
        return 10 * 4 * cruise_speed(experiment.reference) / experiment.reference.accelerate_until**2
    return instead or 0.0


def _of_rig(key: str, rig: Ensemble) -> tuple[float, float] | None:
    """What a rig's number of a key may be; None where it is that of a perfect machine."""
    if key in rig.distributions:
        ends = rig.distributions[key].ends(leaves(rig.experiment)[key])
        numbers = [float(end) for end in ends]
        return min(numbers), max(numbers)
    value = leaves(rig.experiment).get(key)
    return (0.0, float(value)) if isinstance(value, (int, float)) and value else None


def _clipped(low: float, high: float, bounds: tuple[float, float]) -> Slider:
    return Slider(max(low, bounds[0]), min(high, bounds[1]))
