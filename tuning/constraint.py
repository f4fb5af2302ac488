"""What a candidate must keep to: a statistic and its bound, ``worst.peak_tension<=6000``, ``worst.delay_margin>=5ms``.

A bound is a number, maybe with its unit, ``paper`` (what the paper's controller reaches in the same scenarios), a
configuration key, or a factor on one of the latter: ``mean.chatter<=0.25*paper``,
``worst.peak_tension<=0.95*controller.coordination.tension_max``.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import behind_number, nearest
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.ensembles.result import Statistic, statistic_from
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.bound_units import in_si
from dualwinch.tuning.margin_statistic import MarginStatistic, margin_statistic
from dualwinch.tuning.scoring.measured import UNMEASURED

NONE = "none"
"""What is said for no constraint."""

NO_SLACK = "worst.min_tension>=0.4*controller.coordination.tension_min"
NO_PEAK = "worst.peak_tension<=controller.coordination.tension_max"
QUIET = "mean.chatter<=0.25*paper"
NO_LOUDER = "mean.chatter<=1*paper"
NO_HEAVIER = "mean.continuous_load<=1.05*paper"


@dataclass(frozen=True)
class Constraint:
    """A statistic that is to stay on one side of a bound.

    Attributes:
        text: as it was asked for.
        statistic: what is bounded.
        at_least: whether the bound is a lower one.
        bound: in the statistic's unit, or a factor.
        of_paper: whether the bound is a factor on what the paper's controller reaches.
    """

    text: str
    statistic: Statistic | MarginStatistic
    at_least: bool
    bound: float
    of_paper: bool = False

    def given(self, reached: float) -> "Constraint":
        """The constraint with its bound as a number, given what the paper's controller reaches."""
        return replace(self, bound=self.bound * reached, of_paper=False) if self.of_paper else self

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
        """The constraint with its bound as a number with its unit, or as a factor."""
        sign = ">=" if self.at_least else "<="
        bound = f"{self.bound:.6g}{behind_number(self.statistic.unit)}"
        if self.of_paper:
            bound = "the paper's" if self.bound == 1 else f"{self.bound:.6g} times the paper's"
        return f"{self.statistic.name} {sign} {bound}"


def default_constraints(ensemble: bool, *, lag: bool = False) -> tuple[str, ...]:
    """No slack rope, no peak beyond the limit, and quieter than the paper's.

    By far quieter, where sensors are noisy and motors pass on all the chatter that they are asked for. Where they are
    late, motors have to bear hardly more load than with the paper's gains: there a higher preload gains next to
    nothing, and gains that rest on one fail on kinder machines.

    Args:
        ensemble: whether the tuning is in one.
        lag: whether torques follow their commands late.
    """
    if ensemble and lag:
        return NO_SLACK, NO_PEAK, NO_LOUDER, NO_HEAVIER
    return NO_SLACK, NO_PEAK, QUIET if ensemble else NO_LOUDER


def constraints_from(texts: Sequence[str], experiment: Experiment) -> tuple[Constraint, ...]:
    """The constraints of some texts.

    Args:
        texts: each ``STATISTIC<=BOUND`` or ``STATISTIC>=BOUND``, or `NONE`, which bounds nothing.
        experiment: where configuration keys are looked up, and metrics beside the built-in ones.

    Raises:
        ConfigurationError: anything else, or an unknown name.
    """
    found = [_constraint(text, experiment) for text in texts if text != NONE]
    for index, constraint in enumerate(found):
        side = constraint.statistic, constraint.at_least
        if side in [(other.statistic, other.at_least) for other in found[:index]]:
            raise ConfigurationError(f"--constraint {constraint.text}: {constraint.statistic.name} is bounded twice")
    return tuple(found)


def constraints_with(
    texts: Sequence[str] | None, defaults: Sequence[str], experiment: Experiment
) -> tuple[Constraint, ...]:
    """The constraints that are meant by some texts; as of `constraints_from` beside those.

    Stability margins say nothing of runs. So where nothing else is bounded, the default constraints hold beside them.

    Args:
        texts: `NONE` among them leaves the default ones out; ``None``: these alone.
        defaults: the default ones.
        experiment: as of `constraints_from`.
    """
    if texts is None:
        return constraints_from(defaults, experiment)
    found = constraints_from(texts, experiment)
    margins = bool(found) and all(isinstance(constraint.statistic, MarginStatistic) for constraint in found)
    return (*constraints_from(defaults, experiment), *found) if margins and NONE not in texts else found


def _constraint(text: str, experiment: Experiment) -> Constraint:
    parts = re.fullmatch(r"\s*([\w.]+)\s*(<=|>=)\s*(?:([^*]+)\*)?\s*([^*]+?)\s*", text)
    if not parts:
        raise ConfigurationError(f"--constraint {text}: must be STATISTIC<=BOUND, e.g. worst.peak_tension<=6000")
    name, sign, factor, term = parts.groups()
    own = experiment.metrics
    statistic = margin_statistic(name, own) or statistic_from(name, own)
    scale = 1.0 if factor is None else _number(factor, text)
    if term == "paper":
        return Constraint(text, statistic, sign == ">=", scale, of_paper=True)
    if re.match(r"[A-Za-z]", term) and term not in {"inf", "nan"}:
        values = leaves(experiment)
        value = values.get(term)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            hint = nearest(term, ["paper", *(key for key, known in values.items() if isinstance(known, float))])
            raise ConfigurationError(f"--constraint {text}: '{term}' names no number; did you mean '{hint}'?")
        return Constraint(text, statistic, sign == ">=", scale * float(value))
    return Constraint(text, statistic, sign == ">=", scale * _number(term, text, statistic))


def _number(word: str, text: str, statistic: Statistic | MarginStatistic | None = None) -> float:
    try:
        value = in_si(word, statistic) if statistic else float(word)
    except ValueError:
        value = math.nan
    except ConfigurationError as error:
        raise ConfigurationError(f"--constraint {text}: {error}") from None
    if not math.isfinite(value):
        raise ConfigurationError(f"--constraint {text}: '{word.strip()}' must be a finite number")
    return value
