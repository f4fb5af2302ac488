"""What a candidate must keep to: a statistic and its bound, ``worst.peak_tension<=6000``.

A bound is a number, ``paper`` (what the paper's gains reach in the same scenarios), a configuration key, or a factor
on one of the latter: ``mean.chatter<=0.25*paper``, ``worst.peak_tension<=0.95*controller.coordination.tension_max``.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantity import behind_number, nearest
from dualwinch.model.tree import leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.scoring.statistic import UNMEASURED, Statistic, statistic_from

NO_SLACK = "worst.min_tension>=0.4*controller.coordination.tension_min"
NO_PEAK = "worst.peak_tension<=controller.coordination.tension_max"
QUIET = "mean.chatter<=0.25*paper"
NO_LOUDER = "mean.chatter<=1*paper"


@dataclass(frozen=True)
class Constraint:
    """A statistic that is to stay on one side of a bound.

    Attributes:
        text: as it was asked for.
        statistic: what is bounded.
        at_least: whether the bound is a lower one.
        bound: in the statistic's unit.
    """

    text: str
    statistic: Statistic
    at_least: bool
    bound: float

    def violation(self, value: float, margin: float = 0.0) -> float:
        """How far beyond its bound a value is, as a share of the bound (of 1 where that is 0); <= 0: it is kept to.

        Args:
            value: of the statistic.
            margin: distance to keep from the bound, as the same share.
        """
        beyond = self.bound - value if self.at_least else value - self.bound
        share = beyond / (abs(self.bound) or 1.0) + margin
        return min(max(share, -UNMEASURED), UNMEASURED)

    @property
    def label(self) -> str:
        """The constraint with its bound as a number and with its unit."""
        sign, unit = ">=" if self.at_least else "<=", behind_number(self.statistic.unit)
        return f"{self.statistic.name} {sign} {self.bound:.6g}{unit}"


def default_constraints(ensemble: bool) -> tuple[str, ...]:
    """No slack rope, no peak beyond the limit, and quieter than the paper's gains: by far where sensors are noisy."""
    return NO_SLACK, NO_PEAK, QUIET if ensemble else NO_LOUDER


def constraints_from(
    texts: Sequence[str], experiment: Experiment, paper: Callable[[Statistic], float]
) -> tuple[Constraint, ...]:
    """The constraints of some texts.

    Args:
        texts: each ``STATISTIC<=BOUND`` or ``STATISTIC>=BOUND``.
        experiment: where configuration keys are looked up.
        paper: what the paper's gains reach.

    Raises:
        ConfigurationError: anything else, or an unknown name.
    """
    found = [_constraint(text, experiment, paper) for text in texts]
    for place, one in enumerate(found):
        if (one.statistic, one.at_least) in [(other.statistic, other.at_least) for other in found[:place]]:
            raise ConfigurationError(f"--constraint {one.text}: {one.statistic.name} is bounded twice")
    return tuple(found)


def _constraint(text: str, experiment: Experiment, paper: Callable[[Statistic], float]) -> Constraint:
    parts = re.fullmatch(r"\s*([\w.]+)\s*(<=|>=)\s*(?:([^*]+)\*)?\s*([^*]+?)\s*", text)
    if not parts:
        raise ConfigurationError(f"--constraint {text}: must be STATISTIC<=BOUND, e.g. worst.peak_tension<=6000")
    name, sign, factor, term = parts.groups()
    statistic = statistic_from(name)
    scale = 1.0 if factor is None else _number(factor, text)
    values = leaves(experiment)
    if term == "paper":
        bound = paper(statistic)
    elif re.match(r"[A-Za-z]", term) and term not in {"inf", "nan"}:
        value = values.get(term)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            hint = nearest(term, ["paper", *(key for key, known in values.items() if isinstance(known, float))])
            raise ConfigurationError(f"--constraint {text}: '{term}' names no number; did you mean '{hint}'?")
        bound = float(value)
    else:
        bound = _number(term, text)
    return Constraint(text, statistic, sign == ">=", scale * bound)


def _number(word: str, text: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ConfigurationError(f"--constraint {text}: '{word.strip()}' must be a finite number")
    return value
