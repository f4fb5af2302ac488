"""The robustness margin: the smallest size of an imperfection at which gains break, by bisection.

1. Powers of ten from a thousandth of the ensemble's size to a hundred times it are tried.
2. The interval between the first that breaks and the one before is halved, down to one step: sizes are ``10^(step/8)``.

Not every break is monotone: gains may break at one size and hold at a larger one. What is reported is the smallest size
that breaks among all that were tried.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from dualwinch.tuning.robustness.imperfections import Imperfection, ScaledEnsemble

STEPS = 8
"""Steps between two powers of ten: a size is 1.33 times the one before."""

LOWEST, HIGHEST = -3 * STEPS, 2 * STEPS
"""Steps of a thousandth and of a hundred times."""

AS_IT_IS = 0
"""Step of the ensemble's own size."""


def size(step: int) -> float:
    """The size of a step, 1 on step 0."""
    return 10.0 ** (step / STEPS)


def decades(bottom: int, top: int) -> list[int]:
    """Steps of the powers of ten between two steps, and both; none where the top lies below the bottom."""
    within = {step for step in range(LOWEST, HIGHEST + 1, STEPS) if bottom < step < top}
    return sorted(within | {bottom, top}) if bottom <= top else []


@dataclass
class Bisection:
    """The bisection of some gains under one imperfection.

    Attributes:
        bottom, top: the first and the last step that are tried; none where the last lies below the first.
        tried: step → whether the gains broke there.
    """

    bottom: int
    top: int
    tried: dict[int, bool] = field(default_factory=dict)

    def wanted(self) -> list[int]:
        """Steps to try next; none where the search has ended."""
        if not self.tried:
            return decades(self.bottom, self.top)
        broken, held = self.broken, self.held
        if broken is None or held is None or broken - held == 1:
            return []
        return [(held + broken) // 2]

    @property
    def broken(self) -> int | None:
        """The smallest step that is broken."""
        return min((step for step, broken in self.tried.items() if broken), default=None)

    @property
    def held(self) -> int | None:
        """The largest step below that, where the gains hold."""
        broken = self.top + 1 if self.broken is None else self.broken
        return max((step for step in self.tried if step < broken), default=None)

    @property
    def monotone(self) -> bool:
        """Whether no step above the smallest broken one holds."""
        broken = self.broken
        return broken is None or all(broke for step, broke in self.tried.items() if step > broken)


HIGHEST_COMPILED = STEPS
"""Last step where each size is compiled code of its own: ten times the ensemble's."""


@dataclass(frozen=True)
class SizeRange:
    """The steps at which an imperfection may be tried.

    Attributes:
        bottom, top: the first and the last; none where the last lies below the first.
        obstacle: what is wrong with the next one, in one line; empty where there might be more.
    """

    bottom: int
    top: int
    obstacle: str = ""

    @property
    def steps(self) -> list[int]:
        """Those at which the bisection begins."""
        return decades(self.bottom, self.top)


def size_range(scaling: ScaledEnsemble, imperfection: Imperfection) -> SizeRange:
    """The steps at which the values of an imperfection are allowed in all scenarios.

    A switch, or a part of another kind, has one alone. The smallest sizes of a rope's mass may not be allowed either:
    light masses swing too fast.
    """

    def wrong(step: int) -> str:
        return scaling.obstacle(dict.fromkeys(imperfection.keys, size(step)))

    bottom = AS_IT_IS if scaling.switched(imperfection) else LOWEST
    stiffens = scaling.stiffens(imperfection)
    highest = HIGHEST_COMPILED if scaling.compiled(imperfection) else HIGHEST
    obstacle = ""
    for step in range(AS_IT_IS if scaling.switched(imperfection) else highest, bottom - 1, -1):
        if not (found := wrong(step)):
            return SizeRange(_lowest(bottom, step, wrong) if stiffens else bottom, step, obstacle)
        obstacle = found
    return SizeRange(bottom, bottom - 1, obstacle)


def sizes_at(step: int, reaches: Mapping[Imperfection, SizeRange]) -> dict[str, float]:
    """Key → size at a step of several imperfections together.

    One whose range ends before stays at its end; one whose range begins above is left out.
    """
    return {
        key: 0.0 if not reach.steps or step < reach.bottom < AS_IT_IS else size(min(step, reach.top))
        for imperfection, reach in reaches.items()
        for key in imperfection.keys
    }


def joint_range(scaling: ScaledEnsemble, reaches: Mapping[Imperfection, SizeRange]) -> SizeRange:
    """The steps of all imperfections together whose values go with each other."""

    def wrong(step: int) -> str:
        return scaling.obstacle(sizes_at(step, reaches))

    stiffens, obstacle = any(map(scaling.stiffens, reaches)), ""
    for step in range(max(reach.top for reach in reaches.values()), LOWEST - 1, -1):
        if not (found := wrong(step)):
            return SizeRange(_lowest(LOWEST, step, wrong) if stiffens else LOWEST, step, obstacle)
        obstacle = found
    return SizeRange(LOWEST, LOWEST - 1, obstacle)


def _lowest(bottom: int, top: int, wrong: Callable[[int], str]) -> int:
    """The first step from the bottom that is allowed, below one that is."""
    return next(step for step in range(bottom, top + 1) if step == top or not wrong(step))
