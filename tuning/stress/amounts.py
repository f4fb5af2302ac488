"""How large an imperfection is, in its own unit."""

from dataclasses import dataclass
from typing import Any

from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.quantities.validation import shown
from dualwinch.simulation.ensembles.ensemble import Drawn
from dualwinch.tuning.stress.imperfection import Imperfection
from dualwinch.tuning.stress.scaling import Scaling, between
from dualwinch.tuning.stress.words import SHARE, unit_of, with_unit


@dataclass(frozen=True)
class Amount:
    """How far an imperfection goes.

    Attributes:
        low, high: least and largest departure of what is drawn from the base's nominal value, or the value itself,
            twice, where it is set and not drawn; ``None`` where it is no number.
        unit: of both; `SHARE` for shares, such as those of the base's nominal value.
        drawn: whether it is drawn.
        text: what stands for a value that is no number.
    """

    low: float | None
    high: float | None
    unit: str
    drawn: bool
    text: str = ""

    def __str__(self) -> str:
        """Such as ``±0.2 %``."""
        if self.low is None or self.high is None:
            return self.text
        (low, high), unit = with_unit([self.low, self.high], self.unit)
        if not self.drawn or low == high:
            return f"{high}{unit}"
        if abs(self.low + self.high) <= 1e-9 * abs(self.high):
            return f"±{high}{unit}"
        return f"{low} to {high}{unit}"


def amount_of(scaling: Scaling, imperfection: Imperfection, size: float) -> Amount | None:
    """How large an imperfection of some size is: that of its values that goes furthest; ``None`` for all together."""
    if imperfection not in scaling.single:
        return None
    amounts = [_of_key(scaling, key, size) for key in imperfection.keys]
    parts = [
        amount for amount, key in zip(amounts, imperfection.keys, strict=True) if Mark.PART in scaling.known[key].marks
    ]
    return max(parts or amounts, key=lambda amount: max(abs(amount.low or 0.0), abs(amount.high or 0.0)))


def _of_key(scaling: Scaling, key: str, size: float) -> Amount:
    leaf = scaling.known[key]
    base, ensemble = (leaves(each.experiment).get(key) for each in (scaling.base, scaling.ensemble))
    drawn = scaling.ensemble.distributions.get(key)
    if drawn is None or base is None or leaf.kind not in {int, float}:
        value = between(leaf, base, ensemble, size)
        if isinstance(value, bool | str) or value is None:
            return Amount(None, None, "", drawn=False, text=value if isinstance(value, str) else shown(value))
        return Amount(value, value, unit_of(leaf.quantity), drawn=False)
    ends = [between(leaf, *pair, size) - base for pair in _ends(scaling.base.distributions.get(key), drawn, base)]
    shares = drawn.relative and base != 0
    low, high = (end(ends) / abs(base) if shares else end(ends) for end in (min, max))
    return Amount(low, high, SHARE if shares else unit_of(leaf.quantity), drawn=True)


def _ends(ours: Drawn | None, theirs: Drawn, nominal: Any) -> list[tuple[Any, Any]]:
    """The values of a base that draws, or does not, and of an ensemble at both ends of its distribution."""
    ends = theirs.ends(nominal)
    starts = ours.ends(nominal) if ours else ()
    return list(zip(starts if len(starts) == len(ends) else [nominal] * len(ends), ends, strict=True))
