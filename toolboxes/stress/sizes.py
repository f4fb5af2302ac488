"""The robustness margin (breakdown point): the smallest size of an imperfection at which gains break, by bisection.

1. Try powers of ten from a thousandth of the ensemble's size to a hundred times it.
2. Halve the interval between the smallest that breaks and the one below, down to one step: sizes are ``10^(step/8)``.

Breaking need not be monotone: gains may break at one size and hold at a larger one. The result is the smallest tried
size at which they break.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from dualwinch.toolboxes.stress.imperfections import Imperfection, ScaledEnsemble

STEPS = 8
"""Steps per decade: a size is 1.33 times the one before."""

LOWEST, HIGHEST = -3 * STEPS, 2 * STEPS
"""Steps of a thousandth and of a hundred times the ensemble's size."""

AS_IT_IS = 0
"""Step of the ensemble's own size."""


def size(step: int) -> float:
    """The size of a step, 1 on step 0."""
    return 10.0 ** (step / STEPS)


def decades(bottom: int, top: int) -> list[int]:
    """Steps of the powers of ten between `bottom` and `top`, and these two; empty if `top` < `bottom`."""
    within = {step for step in range(LOWEST, HIGHEST + 1, STEPS) if bottom < step < top}
    return sorted(within | {bottom, top}) if bottom <= top else []


@dataclass
class Bisection:
    """Bisection for the robustness margin of a controller against one imperfection.

    Attributes:
        bottom, top: smallest and largest step; there is none if `top` < `bottom`.
        outcomes: step → whether the gains broke there.
    """

    bottom: int
    top: int
    outcomes: dict[int, bool] = field(default_factory=dict)

    def wanted(self) -> list[int]:
        """Steps to try next; empty at the end of the search."""
        if not self.outcomes:
            return decades(self.bottom, self.top)
        breakdown, largest_held = self.breakdown, self.held
        if breakdown is None or largest_held is None or breakdown - largest_held == 1:
            return []
        return [(largest_held + breakdown) // 2]

    @property
    def breakdown(self) -> int | None:
        """The smallest tried step at which the gains break."""
        return min((step for step, broke in self.outcomes.items() if broke), default=None)

    @property
    def held(self) -> int | None:
        """The largest tried step below `breakdown`; the gains hold there."""
        breakdown = self.top + 1 if self.breakdown is None else self.breakdown
        return max((step for step in self.outcomes if step < breakdown), default=None)

    @property
    def monotone(self) -> bool:
        """Whether the gains hold at no tried step above `breakdown`."""
        breakdown = self.breakdown
        return breakdown is None or all(broke for step, broke in self.outcomes.items() if step > breakdown)


HIGHEST_COMPILED = STEPS
"""Largest step of imperfections with compiled code per size: ten times the ensemble's size."""


@dataclass(frozen=True)
class SizeRange:
    """The allowed steps of an imperfection.

    Attributes:
        bottom, top: the smallest and the largest; there is none if `top` < `bottom`.
        obstacle: error of the next larger step, in one line; empty if the range ends at the largest of all.
    """

    bottom: int
    top: int
    obstacle: str = ""

    @property
    def steps(self) -> list[int]:
        """The initial steps of the bisection."""
        return decades(self.bottom, self.top)


def size_range(scaling: ScaledEnsemble, imperfection: Imperfection) -> SizeRange:
    """The steps at which the values of an imperfection are allowed in all scenarios.

    A switch, or a part of another kind, has a single step. The smallest sizes of a rope's mass may be excluded too:
    light masses swing too fast.
    """

    def wrong(step: int) -> str:
        return scaling.obstacle(dict.fromkeys(imperfection.keys, size(step)))

    bottom, top = LOWEST, HIGHEST_COMPILED if scaling.compiled(imperfection) else HIGHEST
    if scaling.switched(imperfection):
        bottom = top = AS_IT_IS
    return _allowed(bottom, top, wrong, stiffens=scaling.stiffens(imperfection))


def sizes_at(step: int, reaches: Mapping[Imperfection, SizeRange]) -> dict[str, float]:
    """Key → size, with several imperfections at the same step.

    Above its range, an imperfection stays at the end of it; below, it is left out.
    """
    return {
        key: 0.0 if not reach.steps or step < reach.bottom < AS_IT_IS else size(min(step, reach.top))
        for imperfection, reach in reaches.items()
        for key in imperfection.keys
    }


def joint_range(scaling: ScaledEnsemble, reaches: Mapping[Imperfection, SizeRange]) -> SizeRange:
    """The steps at which the values of all imperfections together are allowed in all scenarios."""

    def wrong(step: int) -> str:
        return scaling.obstacle(sizes_at(step, reaches))

    top = max(reach.top for reach in reaches.values())
    return _allowed(LOWEST, top, wrong, stiffens=any(map(scaling.stiffens, reaches)))


def _allowed(bottom: int, top: int, wrong: Callable[[int], str], *, stiffens: bool) -> SizeRange:
    """The allowed steps from `bottom` to `top`; the smallest ones are tried only if small sizes may swing faster."""
    obstacle = ""
    for step in range(top, bottom - 1, -1):
        if not (error := wrong(step)):
            if stiffens:
                bottom = next((small for small in range(bottom, step) if not wrong(small)), step)
            return SizeRange(bottom, step, obstacle)
        obstacle = error
    return SizeRange(bottom, bottom - 1, obstacle)
