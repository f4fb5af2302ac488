"""How small and how large the sizes of an imperfection may be."""

from collections.abc import Mapping
from dataclasses import dataclass

from dualwinch.tuning.stress.imperfection import Imperfection
from dualwinch.tuning.stress.ladder import AS_IT_IS, HIGHEST, LOWEST, STEPS, ladder, size
from dualwinch.tuning.stress.scaling import Scaling

HIGHEST_COMPILED = STEPS
"""Last rung where each size is compiled code of its own: ten times the ensemble's."""


@dataclass(frozen=True)
class Reach:
    """The rungs of an imperfection.

    Attributes:
        bottom, top: the first and the last; none where the last lies below the first.
        obstacle: what is wrong with the next one, in one line; empty where there might be more.
    """

    bottom: int
    top: int
    obstacle: str = ""

    @property
    def rungs(self) -> list[int]:
        """Those of the ladder."""
        return ladder(self.bottom, self.top)


def reach_of(scaling: Scaling, imperfection: Imperfection) -> Reach:
    """The rungs of an imperfection whose values are allowed in all scenarios.

    What is there or not has one alone.
    """
    bottom = AS_IT_IS if scaling.switched(imperfection) else LOWEST
    highest = HIGHEST_COMPILED if scaling.compiled(imperfection) else HIGHEST
    obstacle = ""
    for rung in range(AS_IT_IS if scaling.switched(imperfection) else highest, bottom - 1, -1):
        wrong = scaling.obstacle(dict.fromkeys(imperfection.keys, size(rung)))
        if not wrong:
            return Reach(bottom, rung, obstacle)
        obstacle = wrong
    return Reach(bottom, bottom - 1, obstacle)


def sizes_at(rung: int, reaches: Mapping[Imperfection, Reach]) -> dict[str, float]:
    """Key → size at a rung of several imperfections together; one whose range ends before stays at its end."""
    return {
        key: size(min(rung, reach.top)) if reach.rungs else 0.0
        for imperfection, reach in reaches.items()
        for key in imperfection.keys
    }


def reach_together(scaling: Scaling, reaches: Mapping[Imperfection, Reach]) -> Reach:
    """The rungs of all imperfections together: up to the last whose values go with each other."""
    obstacle = ""
    for rung in range(max(reach.top for reach in reaches.values()), LOWEST - 1, -1):
        wrong = scaling.obstacle(sizes_at(rung, reaches))
        if not wrong:
            return Reach(LOWEST, rung, obstacle)
        obstacle = wrong
    return Reach(LOWEST, LOWEST - 1, obstacle)
