"""Operating points and linear models of a plant without controller: by default the paper's, mid-track, at rest."""

from typing import Any

from dualwinch.model.linear.linearisation import linearise_at
from dualwinch.model.linear.operating_point import PRELOAD, OperatingPoint, operating_points
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant


def operating_point(
    x: float | None = None, v: float = 0.0, preload: float = PRELOAD, plant: Plant | None = None, **outside: float
) -> OperatingPoint:
    """One operating point."""
    return operating_points(x, v, preload, plant or Plant(), **outside)[0]


def linearise_sweep(
    x: Any = None,
    v: Any = 0.0,
    preload: Any = PRELOAD,
    plant: Plant | None = None,
    *,
    dt: float | None = None,
    **outside: float,
) -> list[LinearSystem]:
    """The plant linearised at many points."""
    machine = plant or Plant()
    return linearise_at(operating_points(x, v, preload, machine, **outside), machine, dt)


def linearise(*arguments: Any, **named: Any) -> LinearSystem:
    """The plant linearised at one point."""
    return linearise_sweep(*arguments, **named)[0]
