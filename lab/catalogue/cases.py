"""The paper's cases: values over the defaults, figures of merit of its controllers, and what it claims of them."""

from typing import Any

from dualwinch.lab.catalogue.keys import default_of
from dualwinch.lab.wasm.structures import LabStructure
from dualwinch.simulation.paper import CASES, CONTROLLERS, REDUCTIONS, case
from dualwinch.simulation.simulate import simulate

OBSERVED = {"case": "case-4", "without": "nftsm", "with": "fando-nftsm"}
"""What the paper's reductions are of (its Figure 21)."""


def cases(usual: LabStructure) -> list[dict[str, Any]]:
    """Every case of the paper: its name, the structure to begin with, what it changes, its steady state."""
    found = []
    for number, label in CASES.items():
        there = LabStructure(usual.settings, case(number))
        values = {key: default_of(key, there) for key in usual.module.keys}
        changed = {key: value for key, value in values.items() if value != default_of(key, usual)}
        found.append(
            {
                "id": f"case-{number}",
                "label": f"Case {number}: {label}",
                "structure": usual.id,
                "values": changed,
                "steady": list(there.experiment.steady_window),
            }
        )
    return found


def reproduced() -> dict[str, dict[str, dict[str, float]]]:
    """Figures of merit of the paper's cases and controllers: case → structure → metric → value."""
    return {
        f"case-{number}": {
            controller: dict(simulate(case(number, controller), stride=0).metrics) for controller in CONTROLLERS
        }
        for number in CASES
    }


def claims() -> dict[str, Any]:
    """What the paper says that its observer changes, as shares of the figures of merit in the steady state."""
    return OBSERVED | {"change": {f"steady_{metric}": change for metric, change in REDUCTIONS.items()}}
