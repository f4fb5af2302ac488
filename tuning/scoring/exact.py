"""Scenarios on a machine that is what its data sheets say."""

from collections.abc import Sequence
from dataclasses import replace

from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.simulation.scenario import Scenario


def exact(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """Draws of one ensemble with every error of the machine and its sensors set to 0 (`Mark.UNKNOWN`).

    Everything else stays: what acts on the vehicle, noise, silence, lags, and plants that data sheets tell roughly.
    """
    if not scenarios:
        return []
    first = scenarios[0]
    values = leaves(first.base)
    errors = {
        key: 0.0
        for key, leaf in describe_parts(first.base).items()
        if Mark.UNKNOWN in leaf.marks and Mark.COURSE not in leaf.marks and (key in first.draws or values[key])
    }
    base = with_leaves(first.base, errors)
    return [
        replace(scenario, base=base, draws={key: value for key, value in scenario.draws.items() if key not in errors})
        for scenario in scenarios
    ]


def every_second_exact(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """Draws of one ensemble, the second, fourth, ... on machines without errors."""
    found = list(scenarios)
    found[1::2] = exact(found[1::2])
    return found
