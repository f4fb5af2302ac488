"""Candidates with as much reserve as their peaks ask for, neither more nor less.

The reserve, by which tension commands keep off `tension_max`, lowers the highest peaks by nearly its own size and costs
next to nothing, until it is the force that draws at the edge of authority lack. A search sees neither: its few
scenarios have lower peaks than hundreds do, and seldom such a draw.
"""

from collections.abc import Sequence
from dataclasses import replace

from dualwinch.tuning.by_ensemble import RESERVE
from dualwinch.tuning.constraint import Constraint
from dualwinch.tuning.scoring.evaluation import Candidate
from dualwinch.tuning.space import Interval, Space

PEAK = "worst.peak_tension"

MOST, LEAST = 0.02, 0.001
"""Excess, as a share of the bound, beyond which a peak has other reasons; and the least change worth a try."""


def on_peaks(constraints: Sequence[Constraint]) -> list[Constraint]:
    """The bounds on the highest tension."""
    return [each for each in constraints if each.statistic.name == PEAK and not each.at_least]


def reserve_in(space: Space) -> Interval | None:
    """The range of the reserve; ``None`` where it does not vary."""
    found = [each for each in space.dimensions if each.name == RESERVE and isinstance(each, Interval)]
    return found[0] if found else None


def trimmed(
    candidate: Candidate, excess: float, space: Space, constraints: Sequence[Constraint], margin: float
) -> Candidate | None:
    """The candidate with the reserve that takes its peaks to a distance from their bound.

    Args:
        candidate: has been tried.
        excess: of its highest peak over the bound, as a share; negative where it is lower.
        space: what varies.
        constraints: among them the bound on peaks.
        margin: the distance, as a share of the bound.

    Returns:
        ``None`` where the reserve does not vary, nothing bounds the peak, or the reserve is not what matters.
    """
    bounds, varies = [each.bound for each in on_peaks(constraints)], reserve_in(space)
    if not bounds or not varies or excess > MOST:
        return None
    bound = min(bounds)
    now = float(candidate.point[RESERVE])
    reserve = min(max(now + (excess + margin) * bound, varies.lower), varies.upper)
    if abs(reserve - now) < LEAST * bound:
        return None
    return replace(candidate, point=candidate.point | {RESERVE: reserve})
