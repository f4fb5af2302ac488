"""What a stress test has found, as data; `tuning.robustness.result` shows it."""

import math
from dataclasses import dataclass
from functools import cached_property

from dualwinch.controllers.controller import Controller
from dualwinch.tuning.robustness.imperfections import Imperfection, ImperfectionSize, ScaledEnsemble, amount_of
from dualwinch.tuning.robustness.limits import BrokenLimit, RobustnessLimit
from dualwinch.tuning.robustness.sizes import SizeRange


@dataclass(frozen=True)
class Breakdown:
    """Where gains break under an imperfection.

    Attributes:
        size: the smallest size that was tried and is broken, 1 being the ensemble's; ``None``: none is.
        held: the largest size below that was tried and holds; 0: only without the imperfection.
        broken: what is broken there; the worst first.
        monotone: whether no larger size that was tried holds.
    """

    size: float | None
    held: float
    broken: tuple[BrokenLimit, ...]
    monotone: bool

    @property
    def order(self) -> float:
        """Number to sort by: what breaks first comes first."""
        return math.inf if self.size is None else self.size


@dataclass(frozen=True)
class ImperfectionResult:
    """One imperfection, or all together.

    Attributes:
        imperfection: what is scaled.
        reach: its smallest and largest size, and what is wrong with larger ones.
        breaks: name of the gains → where they break.
    """

    imperfection: Imperfection
    reach: SizeRange
    breaks: dict[str, Breakdown]

    @property
    def switched(self) -> bool:
        """Whether the imperfection is there or not, with nothing in between."""
        return self.reach.bottom == self.reach.top


@dataclass(frozen=True, repr=False)
class RobustnessFindings:
    """Which imperfections gains break at, and how large those are.

    Attributes:
        scaling: base, ensemble, imperfections, number of scenarios and seed.
        controllers: name → controller, that with the paper's gains first.
        limits: name → what those gains are held to.
        lost: name → how runs in the base ended that were not completed; such gains are not made to bear more.
        rows: imperfections.
    """

    scaling: ScaledEnsemble
    controllers: dict[str, Controller]
    limits: dict[str, tuple[RobustnessLimit, ...]]
    lost: dict[str, tuple[BrokenLimit, ...]]
    rows: tuple[ImperfectionResult, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the gains that hold without any imperfection."""
        return tuple(name for name in self.controllers if not self.lost[name])

    @cached_property
    def ranking(self) -> tuple[ImperfectionResult, ...]:
        """The rows, what breaks the last of the gains first."""
        names = self.names[::-1]
        return tuple(sorted(self.rows, key=lambda row: [row.breaks[name].order for name in names]))

    def amount(self, row: ImperfectionResult, size: float) -> ImperfectionSize | None:
        """How large a row's imperfection of some size is, in its own unit; ``None`` for all together."""
        return amount_of(self.scaling, row.imperfection, size)
