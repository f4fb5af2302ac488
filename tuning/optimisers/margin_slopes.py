"""Slopes of stability margins over the gains, by differences: they are exact to a few parts in 1e11."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dualwinch.tuning.margin_statistic import MarginStatistic
from dualwinch.tuning.prepared import Prepared
from dualwinch.tuning.space import Interval, Point

Floats = NDArray[np.float64]

APART = 1e-5
"""Share of a gain's range between two points."""

NEAR = 1.2
"""How much larger than the worst a machine's margin may be to count: which is the worst changes within a step."""


def margin_slopes(
    prepared: Prepared, point: Point, dimensions: Sequence[Interval], statistic: MarginStatistic
) -> list[tuple[float, Floats]]:
    """A margin of every machine on which it is nearly the worst, and its slopes by the shares of the gains' ranges.

    Args:
        prepared: says on which machines margins are looked at.
        point: of the space.
        dimensions: what the slopes are by, d of them.
        statistic: which margin.

    Returns:
        Value and slopes (d,) for each machine; a loop that is unstable has 0 and no slopes.

    Raises:
        KeyboardInterrupt: interrupted.
    """
    if prepared.margins is None:
        raise ValueError("no margin is bounded")
    space, kind = prepared.problem.space, statistic.margin
    (here,) = prepared.margins.each([space.parameters(point)], [kind])
    values = [statistic.of(worst) for worst in here]
    near = [machine for machine, value in enumerate(values) if value <= NEAR * min(values)]
    steps, moved = [], []
    for dimension in dimensions:
        share = dimension.encoded(point[dimension.name])
        step = APART if share < 0.5 else -APART
        steps.append(step)
        moved.append(point | {dimension.name: dimension.decoded(share + step)})
    there = prepared.margins.each([space.parameters(each) for each in moved], [kind], near)
    shifted = np.array([[statistic.of(worst) for worst in row] for row in there])
    slopes = (shifted - np.array(values)[near]) / np.array(steps)[:, None]
    return [(values[machine], slopes[:, column]) for column, machine in enumerate(near)]
