"""What a caption says of the lines that a figure really has: which lie on each other, and which are off the panel."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from dualwinch.simulation.paper import CONTROLLERS
from dualwinch.simulation.plots.runs import COMPARABLE
from dualwinch.simulation.plots.traces import largest, within
from dualwinch.simulation.results.result import Result

DRAWN = {"trajectory": ("x",), "error": ("e",), "commands": ("F1_cmd", "F2_cmd"), "tensions": ("F1", "F2")}
"""What a figure draws → its columns."""

COINCIDE = 0.005
"""Lines that are nowhere further apart than this share of their panel's height look like a single one."""


def told(content: str, runs: Mapping[str, Result]) -> list[str]:
    """Sentences for the caption of a figure.

    Args:
        content: one of `simulation.paper.CONTENTS`.
        runs: controller → result, all of one case.
    """
    sentences = []
    together = _together(content, runs)
    if together:
        listed = " and ".join(together) if len(together) < 3 else f"{', '.join(together[:-1])} and {together[-1]}"
        sentences.append(f"At the scale of the whole run the lines of {listed} coincide.")
    if content == "error":
        sentences += [f"There, {name} is off the panel; its range is given in words." for name in _off_the_panel(runs)]
    return sentences


def _together(content: str, runs: Mapping[str, Result]) -> list[str]:
    """Names of the controllers whose lines cannot be told apart."""
    columns = DRAWN[content]
    rows = min((len(run["t"]) for run in runs.values()), default=0)
    spans = {name: max((np.ptp(run[name][:rows]) for run in runs.values() if rows), default=0.0) for name in columns}
    found: list[str] = []
    for one, other in combinations(runs, 2):
        apart = [np.abs(runs[one][name][:rows] - runs[other][name][:rows]).max(initial=0.0) for name in columns]
        if all(distance <= COINCIDE * spans[name] for name, distance in zip(columns, apart, strict=True)):
            found += [one, other]
    return [CONTROLLERS[kind] for kind in dict.fromkeys(found)]


def _off_the_panel(runs: Mapping[str, Result]) -> list[str]:
    """Names of the controllers whose steady-state error the panel of the others cannot hold."""
    sizes = {}
    for kind, run in runs.items():
        sizes[kind] = largest(run["e"][within(run["t"], *run.experiment.steady_window)])
    smallest = min((size for size in sizes.values() if size > 0), default=0.0)
    return [CONTROLLERS[kind] for kind, size in sizes.items() if size > COMPARABLE * smallest]
