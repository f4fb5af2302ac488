"""The catalogue: description of the closed loops for the page and its engine, as one JSON object.

Units, meanings, bounds, defaults and ranges of sliders come from the annotations; cases and figures of merit from the
paper; machines from the ensemble `rig`, and ranges of what it lacks from `site`.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dualwinch.toolbox import (
    Ensemble,
    Experiment,
    Leaf,
    Mark,
    description,
    ensembles,
    file_formats,
    idealisations,
    leaves,
    merits,
    nominal_model,
    paper,
    physics,
    references,
    runs,
    searching,
    with_leaves,
)
from dualwinch.toolboxes.lab.wasm.settings import DURATION, MOTIONS, OFF_AT_ZERO, REFERENCE_KIND, Settings
from dualwinch.toolboxes.lab.wasm.structures import REGISTRIES, LabStructure, heavy_ensemble

ACTUATOR, LAG = "actuator.kind", "actuator.motor.time_constant"

WIDER = 3.0
"""Range of a slider beyond a default, as a factor."""


@dataclass(frozen=True)
class Slider:
    """Range and scale of a slider."""

    low: float
    high: float
    scale: str = "linear"


def default_of(key: str, structure: LabStructure) -> float | None:
    """The default number of a key; None for an optional key without one."""
    return number_of(key, leaves(structure.experiment))


def number_of(key: str, values: Mapping[str, Any]) -> float | None:
    """The number of a key for a module, from the values of an experiment; None for an optional key without one."""
    usual = None
    if key not in values and key.startswith("actuator."):  # ideal motors do not lag
        usual = 0.0 if key == LAG else leaves(with_leaves(Experiment(), {ACTUATOR: "motor"})).get(key) or 0.0
    value = values.get(key, usual)
    if key == REFERENCE_KIND:
        return float(MOTIONS.index(value))
    return None if value is None else float(value)


def described(structure: LabStructure, rig: Ensemble) -> dict[str, dict[str, Any]]:
    """Key → its entry in the catalogue, for every number of a structure.

    Args:
        structure: of the lab.
        rig: an ensemble of real machines; it gives the ranges of imperfections that the paper's machine lacks.
    """
    descriptions = structure.module.described
    return {key: _key_entry(key, descriptions[key], structure, rig) for key in structure.module.keys}


def chosen(structures: Sequence[LabStructure]) -> dict[str, dict[str, Any]]:
    """Key → its entry in the catalogue, for every choice in which structures differ, with the options' labels."""
    usual, entries = structures[0], {}
    for key, default in usual.settings:
        leaf = description.describe_parts(usual.experiment)[key]
        options = list(dict.fromkeys(structure.chosen[key] for structure in structures))
        registry = REGISTRIES.get(key)
        entries[key] = {
            "unit": leaf.quantity.unit,
            "meaning": leaf.quantity.meaning,
            "source": leaf.quantity.source,
            "group": key.rpartition(".")[0],
            "kind": "part",
            "default": default,
            "choices": options,
            "labels": [registry.find(option).label if registry else str(option).lower() for option in options],
        }
    return entries


def _key_entry(key: str, leaf: Leaf, structure: LabStructure, rig: Ensemble) -> dict[str, Any]:
    default = default_of(key, structure)
    low, high = leaf.bounds if key not in OFF_AT_ZERO else (0.0, math.inf)
    if key == REFERENCE_KIND:
        low, high = 0.0, float(len(MOTIONS) - 1)
    experiment = structure.experiment
    around = _typical(key, experiment) if default is None else default
    searched = searching.own_bounds([key], leaf.tunable, structure.module.wide) if leaf.tunable else None
    reach = _range_in(rig, key) or _range_in(heavy_ensemble(), key)
    slider = _slider(leaf, around, (low, high), reach, searched)
    if Mark.SHAPES_CODE_AT_ZERO in leaf.marks and key not in OFF_AT_ZERO:  # zero is another structure
        low = slider.low
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
        "choices": list(MOTIONS) if key == REFERENCE_KIND else None,
        "slider": [slider.low, slider.high],
        "scale": slider.scale,
    }


def _kind(key: str, leaf: Leaf) -> str:
    """Kind of a value: number, integer, switch (0 or 1), or choice (index of an option)."""
    if key == REFERENCE_KIND:
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
    """Range and scale of a slider.

    Args:
        leaf: description of the number.
        around: its default.
        bounds: allowed range.
        reach: range in an ensemble, if it differs from the default.
        searched: range of the search for gains.
    """
    if leaf.tunable and searched:
        return Slider(*searched, "log" if leaf.tunable.log and searched[0] > 0 else "linear")
    finite = all(map(math.isfinite, bounds))
    if leaf.kind is not float and finite:
        return Slider(*bounds)
    if reach and not around:
        wider = 1.0 if Mark.SHAPE_PARAMETER in leaf.marks else WIDER
        return _clipped(wider * min(reach[0], 0.0), wider * reach[1], bounds)
    if around:
        return _clipped(around / WIDER, around * WIDER, bounds)
    return Slider(*bounds) if finite else _clipped(-1.0, 1.0, bounds)


def instead_of(key: str, experiment: Experiment) -> float | None:
    """The number used if an optional key is not given; None if there is none."""
    prefix = "controller.nominal."
    if key.startswith(prefix):
        nominal = nominal_model.nominal_plant(
            experiment.controller.nominal, experiment.plant, experiment.controller.limits.preload
        )
        return getattr(nominal.vehicle, key.removeprefix(prefix))
    return {DURATION: experiment.duration, "reference.speed": references.cruise_speed(experiment.reference)}.get(key)


def _typical(key: str, experiment: Experiment) -> float:
    """A typical number of an optional key, for its slider."""
    substitute = instead_of(key, experiment)
    if substitute is None and key == "reference.jerk_limit":  # ten times the least jerk that reaches the cruise speed
        return 10 * 4 * references.cruise_speed(experiment.reference) / experiment.reference.accelerate_until**2
    return substitute or 0.0


def _range_in(ensemble: Ensemble, key: str) -> tuple[float, float] | None:
    """Range of a key in an ensemble; None if that neither draws nor sets it."""
    if key in ensemble.distributions:
        ends = ensemble.distributions[key].ends(leaves(ensemble.experiment)[key])
        numbers = [float(end) for end in ends]
        return min(numbers), max(numbers)
    value = leaves(ensemble.experiment).get(key)
    return (0.0, float(value)) if isinstance(value, (int, float)) and value else None


def _clipped(low: float, high: float, bounds: tuple[float, float]) -> Slider:
    return Slider(max(low, bounds[0]), min(high, bounds[1]))


MACHINES = 20
"""Machines in the page, those of ``dualwinch simulate --ensemble rig --scenarios 20``."""


def drawn(rig: Ensemble, settings: Settings, seed: int = 0) -> dict[str, Any]:
    """The ensemble `rig` for the page: common values and the draws of its first machines.

    Args:
        rig: the ensemble.
        settings: of a structure that has its keys.
        seed: of the draws.

    Returns:
        ``values`` of every machine; ``distributions``: key → kind, ends and whether a draw is a factor on the nominal
        value; ``machines``: key → numbers of the first machines; ``seeds`` of their random signals.
    """
    of_rig = leaves(rig.experiment)
    values = {key: number_of(key, of_rig) for key in settings.keys if key in of_rig}
    defaults = {key: number_of(key, leaves(settings.experiment)) for key in settings.keys}
    machines = rig.chosen(range(MACHINES), seed)
    return {
        "name": rig.name,
        "description": rig.description,
        "seed": seed,
        "values": {key: value for key, value in values.items() if value != defaults[key] and value is not None},
        "distributions": {
            key: {"kind": draw.distribution.kind, "relative": draw.relative, "together": draw.together}
            | vars(draw.distribution)
            for key, draw in rig.distributions.items()
        },
        "machines": {
            key: [machine.draws[key] for machine in machines] for key in rig.distributions if key in settings.keys
        },
        "seeds": [machine.draws[ensembles.SEED_KEY] for machine in machines],
    }


OBSERVED = {"case": "case-4", "without": "nftsm", "with": "fando-nftsm"}
"""Case and structures of the paper's reductions (its Figure 21)."""


def cases(usual: LabStructure, offered: Sequence[LabStructure] = ()) -> list[dict[str, Any]]:
    """Cases of the paper, and Case 4 on every other machine: name, first structure, and changed values.

    Args:
        usual: the paper's structure.
        offered: all structures, including those of other machines.
    """
    begun = [
        (f"case-{number}", f"Case {number}: {label}", LabStructure(usual.settings, paper.case(number)))
        for number, label in paper.CASES.items()
    ]
    machines = {one.machine: one for one in reversed(offered) if one.machine}
    begun += [(f"case-{name}", f"Case 4 on the nominal machine of '{name}'", one) for name, one in machines.items()]
    entries = []
    for name, label, structure_of_case in begun:
        values = {
            key: default_of(key, structure_of_case)
            for key in (structure_of_case if structure_of_case.machine else usual).module.keys
        }
        usual_values = leaves(usual.experiment)
        changed = {key: value for key, value in values.items() if value != number_of(key, usual_values)}
        structure = structure_of_case.id if structure_of_case.machine else usual.id
        steady = list(structure_of_case.experiment.steady_window)
        entries.append({"id": name, "label": label, "structure": structure, "values": changed, "steady": steady})
    return entries


def reproduced() -> dict[str, dict[str, dict[str, float]]]:
    """Figures of merit of the paper's cases and controllers: case → structure → metric → value."""
    return {
        f"case-{number}": {
            controller: dict(runs.simulate(paper.case(number, controller), stride=0).metrics)
            for controller in paper.CONTROLLERS
        }
        for number in paper.CASES
    }


def claims() -> dict[str, Any]:
    """The paper's reductions of steady-state errors by its observer (Figure 21), as relative changes."""
    return OBSERVED | {"change": {f"steady_{metric}": change for metric, change in paper.REDUCTIONS.items()}}


SAME_RUN = frozenset({"engine", "readings", "integrator", "substeps"})
"""Settings of the simulation that change how a run is computed or recorded, not the machine."""


def file_defaults() -> dict[str, Any]:
    """Values of the keys that an experiment's file does not give.

    Returns:
        ``common``: key → value, for the keys of every experiment; ``parts``: choice → option → key → value, for those
        that only some options of a choice have.
    """
    common, parts = leaves(Experiment()), {}
    for choice, registry in {**REGISTRIES, ACTUATOR: physics.ACTUATORS}.items():
        by_option = {option: leaves(with_leaves(Experiment(), {choice: option})) for option in registry}
        shared = set.intersection(*map(set, by_option.values()))
        parts[choice] = {option: _plain(values, shared) for option, values in by_option.items()}
        common = {key: value for key, value in common.items() if key in shared}
    same = {f"simulation.{name}" for name in SAME_RUN}
    return {"common": _plain(common, same), "parts": parts, "same": sorted(same)}


def _plain(values: Mapping[str, Any], without: Collection[str]) -> dict[str, Any]:
    return {key: file_formats.plain(value) for key, value in values.items() if key not in without}


def fixed(structure: LabStructure) -> dict[str, Any]:
    """Key → value, where a structure has no parameter for a key and not the default of `Experiment`."""
    usual = leaves(Experiment())
    return {
        key: file_formats.plain(value)
        for key, value in leaves(structure.experiment).items()
        if key in usual and value != usual[key] and key not in {*structure.module.keys, *structure.chosen}
    }


def catalogue(structures: Sequence[LabStructure], rig: Ensemble, version: str) -> dict[str, Any]:
    """The catalogue of structures.

    Args:
        structures: the paper's first.
        rig: the ensemble of the page's machines.
        version: of dualwinch.
    """
    keys: dict[str, dict[str, Any]] = {}
    entries = []
    for structure in structures:
        descriptions = described(structure, rig)
        keys |= {key: entry for key, entry in descriptions.items() if key not in keys}
        differing = {
            key: entry["default"] for key, entry in descriptions.items() if entry["default"] != keys[key]["default"]
        }
        entries.append(_structure_entry(structure, differing))
    return {
        "version": version,
        "structures": entries,
        "keys": chosen(structures) | keys,
        "metrics": [
            {"name": name, "unit": quantity.unit, "label": quantity.label, "meaning": quantity.meaning}
            for name, quantity in merits.metric_quantities().items()
        ],
        "cases": cases(structures[0], structures),
        "paper": reproduced(),
        "claims": claims(),
        "rig": drawn(rig, structures[0].module),
        "file": file_defaults(),
    }


def _structure_entry(structure: LabStructure, defaults: dict[str, Any]) -> dict[str, Any]:
    """Entry of a structure in the catalogue."""
    module = structure.module
    return {
        "id": structure.id,
        "label": structure.label,
        "settings": structure.chosen,
        "module": structure.id,
        "machine": structure.machine,
        "parameters": list(module.keys),
        "nominal": list(module.nominal),
        "optional": list(module.optional),
        "defaults": defaults,
        "fixed": fixed(structure),
        "idle": sorted(module.idle),
        "idealised": [
            {"name": one.name, "part": one.part, "atLeast": one.at_least, "brief": one.brief}
            for one in idealisations.idealisation_checks(module.wide.plant, module.wide.controller.limits.tension_min)
        ],
        "columns": [
            {"name": name, "unit": quantity.unit, "label": quantity.meaning}
            for name, quantity in module.loop.closed.quantities.items()
        ],
    }
