"""The catalogue: everything that the page and its engine have to know, as one JSON object."""

from collections.abc import Sequence
from typing import Any

from dualwinch.lab.catalogue.cases import cases, claims, reproduced
from dualwinch.lab.catalogue.keys import chosen, described
from dualwinch.lab.catalogue.rig import drawn
from dualwinch.lab.wasm.structures import LabStructure
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.metrics.metrics import metric_quantities


def catalogue(structures: Sequence[LabStructure], rig: Ensemble, version: str) -> dict[str, Any]:
    """The catalogue of some structures.

    Args:
        structures: the paper's first.
        rig: the ensemble that machines are drawn from.
        version: of the product.
    """
    keys: dict[str, dict[str, Any]] = {}
    entries = []
    for structure in structures:
        own = described(structure, rig)
        keys |= {key: entry for key, entry in own.items() if key not in keys}
        differing = {key: entry["default"] for key, entry in own.items() if entry["default"] != keys[key]["default"]}
        entries.append(_entry(structure, differing))
    return {
        "version": version,
        "structures": entries,
        "keys": chosen(structures) | keys,
        "metrics": [
            {"name": name, "unit": quantity.unit, "meaning": quantity.meaning}
            for name, quantity in metric_quantities().items()
        ],
        "cases": cases(structures[0]),
        "paper": reproduced(),
        "claims": claims(),
        "rig": drawn(rig, structures[0].module),
    }


def _entry(structure: LabStructure, defaults: dict[str, Any]) -> dict[str, Any]:
    """What the catalogue says of a structure."""
    module = structure.module
    return {
        "id": structure.id,
        "label": structure.label,
        "settings": structure.chosen,
        "module": structure.id,
        "parameters": list(module.keys),
        "believed": list(module.believed),
        "optional": list(module.optional),
        "defaults": defaults,
        "columns": [
            {"name": name, "unit": quantity.unit, "label": quantity.meaning}
            for name, quantity in module.loop.closed.quantities.items()
        ],
    }
