"""What a rig draws: its own values, the distributions, and the first machines of a seed."""

from typing import Any

from dualwinch.lab.catalogue.keys import number_of
from dualwinch.lab.wasm.settings import Settings
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.ensembles.ensemble import SEED_KEY, Ensemble

MACHINES = 20
"""Machines that come with the page, those of ``dualwinch simulate --ensemble rig --scenarios 20``."""


def drawn(rig: Ensemble, settings: Settings, seed: int = 0) -> dict[str, Any]:
    """A rig as the page draws it, by the keys of a structure.

    Args:
        rig: the ensemble.
        settings: of a structure that has its keys.
        seed: of the machines that come with the page.

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
        "seeds": [machine.draws[SEED_KEY] for machine in machines],
    }
