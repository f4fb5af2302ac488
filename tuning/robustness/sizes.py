"""Which sizes of an imperfection are tried: a ladder of powers of ten, then halves of what lies below the first break.

Sizes are ``10^(rung/8)``, from a thousandth of the ensemble's to a hundred times it. Not every break is monotone: gains
may break at one size and hold at a larger one. What is looked for is the smallest rung that is broken among all that
are tried.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from dualwinch.tuning.robustness.imperfections import Imperfection, ScaledEnsemble

STEPS = 8
"""Rungs between two powers of ten: a size is 1.33 times the one before."""

LOWEST, HIGHEST = -3 * STEPS, 2 * STEPS
"""Rungs of a thousandth and of a hundred times."""

AS_IT_IS = 0
"""Rung of the ensemble's own size."""


def size(rung: int) -> float:
    """The size of a rung, 1 on rung 0."""
    return 10.0 ** (rung / STEPS)


def decades(bottom: int, top: int) -> list[int]:
    """Rungs of the powers of ten between two rungs, and both; none where the top lies below the bottom."""
    within = {rung for rung in range(LOWEST, HIGHEST + 1, STEPS) if bottom < rung < top}
    return sorted(within | {bottom, top}) if bottom <= top else []


@dataclass
class Bisection:
    """What is known of some gains under one imperfection.

    Attributes:
        bottom, top: the first and the last rung that are tried; none where the last lies below the first.
        tried: rung → whether the gains broke there.
    """

    bottom: int
    top: int
    tried: dict[int, bool] = field(default_factory=dict)

    def wanted(self) -> list[int]:
        """Rungs to try next; none where the search has ended."""
        if not self.tried:
            return decades(self.bottom, self.top)
        broken, held = self.broken, self.held
        if broken is None or held is None or broken - held == 1:
            return []
        return [(held + broken) // 2]

    @property
    def broken(self) -> int | None:
        """The smallest rung that is broken."""
        return min((rung for rung, broken in self.tried.items() if broken), default=None)

    @property
    def held(self) -> int | None:
        """The largest rung below that, where the gains hold."""
        broken = self.top + 1 if self.broken is None else self.broken
        return max((rung for rung in self.tried if rung < broken), default=None)

    @property
    def monotone(self) -> bool:
        """Whether no rung above the smallest broken one holds."""
        broken = self.broken
        return broken is None or all(broke for rung, broke in self.tried.items() if rung > broken)


HIGHEST_COMPILED = STEPS
"""Last rung where each size is compiled code of its own: ten times the ensemble's."""


@dataclass(frozen=True)
class SizeRange:
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
        return decades(self.bottom, self.top)


def size_range(scaling: ScaledEnsemble, imperfection: Imperfection) -> SizeRange:
    """The rungs of an imperfection whose values are allowed in all scenarios.

    What is there or not has one alone. The smallest of a rope's mass may not be allowed either: light
    masses swing too fast.
    """

    def wrong(rung: int) -> str:
        return scaling.obstacle(dict.fromkeys(imperfection.keys, size(rung)))

    bottom = AS_IT_IS if scaling.switched(imperfection) else LOWEST
    stiffens = scaling.stiffens(imperfection)
    highest = HIGHEST_COMPILED if scaling.compiled(imperfection) else HIGHEST
    obstacle = ""
    for rung in range(AS_IT_IS if scaling.switched(imperfection) else highest, bottom - 1, -1):
        if not (found := wrong(rung)):
            return SizeRange(_lowest(bottom, rung, wrong) if stiffens else bottom, rung, obstacle)
        obstacle = found
    return SizeRange(bottom, bottom - 1, obstacle)


def sizes_at(rung: int, reaches: Mapping[Imperfection, SizeRange]) -> dict[str, float]:
    """Key → size at a rung of several imperfections together.

    One whose range ends before stays at its end; one whose range begins above is left out.
    """
    return {
        key: 0.0 if not reach.rungs or rung < reach.bottom < AS_IT_IS else size(min(rung, reach.top))
        for imperfection, reach in reaches.items()
        for key in imperfection.keys
    }


def joint_range(scaling: ScaledEnsemble, reaches: Mapping[Imperfection, SizeRange]) -> SizeRange:
    """The rungs of all imperfections together whose values go with each other."""

    def wrong(rung: int) -> str:
        return scaling.obstacle(sizes_at(rung, reaches))

    stiffens, obstacle = any(map(scaling.stiffens, reaches)), ""
    for rung in range(max(reach.top for reach in reaches.values()), LOWEST - 1, -1):
        if not (found := wrong(rung)):
            return SizeRange(_lowest(LOWEST, rung, wrong) if stiffens else LOWEST, rung, obstacle)
        obstacle = found
    return SizeRange(LOWEST, LOWEST - 1, obstacle)


def _lowest(bottom: int, top: int, wrong: Callable[[int], str]) -> int:
    """The first rung from the bottom that is allowed, below one that is."""
    return next(rung for rung in range(bottom, top + 1) if rung == top or not wrong(rung))
