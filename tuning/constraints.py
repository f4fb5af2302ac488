"""Objectives and constraints: statistics of runs and stability margins, by name and in units."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Quantity, behind_number, suggestion, unknown
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.units import UNITS, factor
from dualwinch.simulation.analysis.margin_survey import WorstMargin
from dualwinch.simulation.analysis.resonance import RESONANCE
from dualwinch.simulation.analysis.stability import sliding_mode
from dualwinch.simulation.ensembles.result import Statistic, statistic_from
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metric import Metric


def measured(statistic: Statistic, values: NDArray[np.float64]) -> float:
    """A statistic over the figure of merit of completed scenarios (n,); NaN without any that is finite."""
    found = float(statistic.over(values))
    return found if math.isfinite(found) else math.nan


MARGINS = {
    "gain_margin": ("gain", Quantity("1", "largest factor on the loop gain")),
    "phase_margin": ("phase", Quantity("deg", "largest extra phase lag")),
    "delay_margin": ("delay", Quantity("s", "largest extra delay")),
    "disk_margin": ("disk", Quantity("1", "largest disk of simultaneous gain and phase changes; from 2 on any gain")),
    "resonance_margin": (RESONANCE, Quantity("1", "largest factor on the loop gain at the drums' resonance, by rule")),
}
"""Name of a margin → its kind (`simulation.analysis.margins.MARGIN_KINDS`, or `RESONANCE`), unit and meaning."""


@dataclass(frozen=True)
class MarginStatistic:
    """The least of a margin.

    Attributes:
        metric: one of `MARGINS`.
    """

    metric: str

    kind = "worst"
    small_is_bad = True

    @property
    def margin(self) -> str:
        """Which margin, as `simulation.analysis.margin_survey.MarginSurvey` calls it."""
        return MARGINS[self.metric][0]

    @property
    def name(self) -> str:
        """Such as ``worst.delay_margin``."""
        return f"{self.kind}.{self.metric}"

    @property
    def quantity(self) -> Quantity:
        """Unit and meaning."""
        return MARGINS[self.metric][1]

    @property
    def unit(self) -> str:
        """Unit of the margin."""
        return self.quantity.unit

    def of(self, worst: Mapping[str, WorstMargin]) -> float:
        """Its value; infinite where nothing of the kind makes the loop unstable."""
        return worst[self.margin].value


def margin_statistic(text: str, own: Sequence[Metric] = ()) -> MarginStatistic | None:
    """The statistic of a name; ``None`` where it is not about a margin.

    Args:
        text: the name.
        own: the experiment's own metrics, which may be called as they like.

    Raises:
        ConfigurationError: a margin other than the worst, or one that there is not.
    """
    kind, _, metric = text.strip().rpartition(".")
    if metric in {part.table() for part in own}:
        return None
    if metric in MARGINS:
        if kind != MarginStatistic.kind:
            raise ConfigurationError(f"'{text.strip()}': a margin is the worst one, {MarginStatistic(metric).name}")
        return MarginStatistic(metric)
    if metric.endswith("_margin"):
        raise ConfigurationError(f"'{text.strip()}': {unknown('margin', metric, MARGINS)}")
    return None


ANGLES = {"deg": 1.0, "rad": 180 / math.pi}
"""Units of a phase margin, and what brings them to degrees."""

DECIBEL, PER_CENT = "dB", "%"
"""Units of a gain margin beside the plain factor, and of a share."""


def in_si(text: str, statistic: Statistic | MarginStatistic | None = None) -> float:
    """A number in the unit of a statistic.

    Args:
        text: the number, with or without a unit.
        statistic: what it bounds; ``None``: it is a factor, which may be in per cent.

    Raises:
        ValueError: no number.
        ConfigurationError: a unit that the statistic does not come in.
    """
    parts = re.fullmatch(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z%].*)", text.strip())
    if not parts or re.fullmatch(r"[eE][-+]?\d+", parts[2]):
        return float(text)
    value, unit, own = float(parts[1]), parts[2], "1" if statistic is None else statistic.unit
    if isinstance(statistic, MarginStatistic) and statistic.metric == "gain_margin" and unit != own:
        return 10 ** (value / 20) if unit == DECIBEL else _refused(unit, [DECIBEL])
    if own == "1" and not isinstance(statistic, MarginStatistic):
        return value / 100 if unit == PER_CENT else _refused(unit, [PER_CENT])
    if own == "deg":
        return value * ANGLES[unit] if unit in ANGLES else _refused(unit, list(ANGLES))
    if own in UNITS:
        return value * factor(unit, own)
    return value if unit == own else _refused(unit, [] if own == "1" else [own])


def _refused(unit: str, allowed: list[str]) -> float:
    known = f"must be one of {', '.join(allowed)}" if allowed else "must be a plain number"
    raise ConfigurationError(f'unit "{unit}": {known}')


NONE = "none"
"""What is said for no constraint."""

NO_SLACK = "worst.min_tension>=0.4*controller.coordination.tension_min"
NO_PEAK = "worst.peak_tension<=controller.coordination.tension_max"
QUIET = "mean.chatter<=0.25*paper"
NO_LOUDER = "mean.chatter<=1*paper"
NO_MORE_SATURATED = "mean.saturated_share<=1*paper"
NO_HEAVIER = "mean.continuous_load<=1.05*paper"
STIFFER = "mean.continuous_load<=1.2*paper"
"""Where drums swing: the stiffness of a rope that sags goes with the cube of its tension (Ernst), so preload pays."""
LATE = 5e-3
"""Least delay margin in s, by default where margins are bounded; below it others are told."""
ROBUST = ("worst.disk_margin>=0.4", f"worst.delay_margin>={1e3 * LATE:g}ms")
DAMPED = "worst.resonance_margin>=1"


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
        """The constraint with its bound as a number, given what the paper's controller reaches.

        What that does not reach, as it completes no run (NaN), bounds nothing: the bound is infinite.
        """
        if not self.of_paper:
            return self
        nothing = -math.inf if self.at_least else math.inf
        return replace(self, bound=nothing if math.isnan(reached) else self.bound * reached, of_paper=False)

    @property
    def unbounded(self) -> bool:
        """Whether nothing violates it."""
        return self.bound == (-math.inf if self.at_least else math.inf)

    def violation(self, value: float, margin: float = 0.0) -> float:
        """How far beyond its bound a value is, as a share of the bound (of 1 where that is 0); <= 0: it is satisfied.

        Args:
            value: of the statistic. One that no run has (NaN) violates all of the bound, an infinite one all or none.
            margin: distance to keep from the bound, as the same share.
        """
        if not math.isfinite(value):
            return -1.0 if value == (math.inf if self.at_least else -math.inf) else 1.0
        if math.isinf(self.bound):
            return -1.0 if self.unbounded else 1.0
        beyond = self.bound - value if self.at_least else value - self.bound
        return beyond / (abs(self.bound) or 1.0) + margin

    @property
    def label(self) -> str:
        """The constraint with its bound as a number with its unit, or as a factor."""
        if self.unbounded:
            return f"{self.statistic.name}: no bound, as the paper's gains complete no run"
        sign = ">=" if self.at_least else "<="
        bound = f"{self.bound:.6g}{behind_number(self.statistic.unit)}"
        if self.of_paper:
            bound = "the paper's" if self.bound == 1 else f"{self.bound:.6g} times the paper's"
        return f"{self.statistic.name} {sign} {bound}"


def default_constraints(
    ensemble: bool, *, lag: bool = False, swinging: bool = False, resonance: bool = False
) -> tuple[str, ...]:
    """No slack rope, no peak beyond the limit, quieter than the paper's, stability margins, and a damped resonance.

    Without an ensemble it is the paper's own question, the least error subject to saturation: commands are at their
    limits no longer than the paper's.

    By far quieter, where sensors are noisy and motors pass on all the chatter that they are asked for. Where they are
    late, motors have to bear hardly more load than with the paper's gains: there a higher preload gains next to
    nothing, and gains that rest on one fail on kinder machines. Where drums swing on ropes that sag, more load is
    allowed, for a preload that makes the ropes stiff. Margins are bounded in an ensemble alone: in a run without noise
    they would be those of infinitely small motions. Where drums swing that of the drums' resonance stands for them: at
    rest and at the reference's largest speed no steady motion of every machine is found there yet.

    Args:
        ensemble: whether the tuning is in one.
        lag: whether torques follow their commands late.
        swinging: whether drums swing on their ropes.
        resonance: whether they do, and the law is one that the rule for it is about.
    """
    damped = (*(ROBUST if ensemble and not swinging else ()), *((DAMPED,) if resonance else ()))
    if ensemble and lag:
        return NO_SLACK, NO_PEAK, NO_LOUDER, STIFFER if swinging else NO_HEAVIER, *damped
    if ensemble:
        return NO_SLACK, NO_PEAK, QUIET, *damped
    return NO_SLACK, NO_PEAK, NO_LOUDER, NO_MORE_SATURATED, *damped


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
    """The default constraints and those of some texts, which replace a default one on the same side of a statistic.

    Args:
        texts: as of `constraints_from`; `NONE` among them, or an empty list, leaves the default ones out.
        defaults: the default ones.
        experiment: as of `constraints_from`.
    """
    found = constraints_from(texts or (), experiment)
    if texts is not None and (NONE in texts or not texts):
        return found
    given = {(constraint.statistic, constraint.at_least) for constraint in found}
    usual = constraints_from(defaults, experiment)
    return (*(each for each in usual if (each.statistic, each.at_least) not in given), *found)


def _constraint(text: str, experiment: Experiment) -> Constraint:
    parts = re.fullmatch(r"\s*([\w.]+)\s*(<=|>=)\s*(?:([^*]+)\*)?\s*([^*]+?)\s*", text)
    if not parts:
        raise ConfigurationError(f"--constraint {text}: must be STATISTIC<=BOUND, e.g. worst.peak_tension<=6000")
    name, sign, factor, term = parts.groups()
    own = experiment.metrics
    statistic = margin_statistic(name, own) or statistic_from(name, own)
    if "." not in name:
        bad_end = text.strip() if _is_own(statistic) else text.strip().replace(sign, _sign(statistic))
        named = " or ".join(f"{kind}.{bad_end}" for kind in ("worst", "mean"))
        raise ConfigurationError(f"--constraint {text}: of which statistic? {named}")
    if isinstance(statistic, MarginStatistic) and statistic.margin == RESONANCE:
        sliding_mode(experiment, f"--constraint {text}: must be")
    scale = 1.0 if factor is None else _number(factor, text)
    if term == "paper":
        return _checked(Constraint(text, statistic, sign == ">=", scale, of_paper=True))
    if re.match(r"[A-Za-z]", term) and term not in {"inf", "nan"}:
        values = leaves(experiment)
        value = values.get(term)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            known = ["paper", *(key for key, known in values.items() if isinstance(known, float))]
            raise ConfigurationError(f"--constraint {text}: '{term}' names no number; {suggestion(term, known)}")
        return _checked(Constraint(text, statistic, sign == ">=", scale * float(value)))
    return _checked(Constraint(text, statistic, sign == ">=", scale * _number(term, text, statistic)))


def _checked(constraint: Constraint) -> Constraint:
    """A constraint that bounds the bad end of its statistic, and that something satisfies.

    A metric of one's own may be bounded at both ends: `Metric.small_is_bad` only says which of many runs is the worst.

    Raises:
        ConfigurationError: it is none.
    """
    text, statistic = constraint.text, constraint.statistic
    sign, wanted = (">=" if constraint.at_least else "<="), _sign(statistic)
    if sign != wanted and not _is_own(statistic):
        end = "small" if statistic.small_is_bad else "large"
        raise ConfigurationError(f"--constraint {text}: {end} values are the bad ones: {text.replace(sign, wanted)}")
    least = statistic.quantity.least if isinstance(statistic, Statistic) else -math.inf
    if not constraint.at_least and constraint.bound < least:
        raise ConfigurationError(
            f"--constraint {text}: nothing satisfies it, no run has less than {least:g}{behind_number(statistic.unit)}"
        )
    return constraint


def _sign(statistic: Statistic | MarginStatistic) -> str:
    """The sign of a bound on the bad end of a statistic."""
    return ">=" if statistic.small_is_bad else "<="


def _is_own(statistic: Statistic | MarginStatistic) -> bool:
    return isinstance(statistic, Statistic) and statistic.own is not None


def _number(word: str, text: str, statistic: Statistic | MarginStatistic | None = None) -> float:
    try:
        value = in_si(word, statistic)
    except ValueError:
        value = math.nan
    except ConfigurationError as error:
        raise ConfigurationError(f"--constraint {text}: {error}") from None
    if not math.isfinite(value):
        raise ConfigurationError(f"--constraint {text}: '{word.strip()}' must be a finite number")
    return value


DEFAULT_OBJECTIVES = ("mean.mse",)


def objectives_from(texts: Sequence[str], own: Sequence[Metric] = ()) -> tuple[Statistic, ...]:
    """The statistics to minimise, e.g. ``["mean.mse", "mean.chatter"]``; more than one makes a Pareto front.

    Args:
        texts: their names.
        own: the experiment's own metrics.

    Raises:
        ConfigurationError: an unknown name, one named twice, or one whose small values are the bad ones.
    """
    for text in texts:
        if margin := margin_statistic(text, own):
            raise ConfigurationError(f"--objective {margin.name}: make it a constraint, {margin.name}>=...")
    found = tuple(statistic_from(text, own) for text in texts)
    for index, statistic in enumerate(found):
        if statistic in found[:index]:
            raise ConfigurationError(f"--objective {statistic.name}: is named twice")
        if statistic.small_is_bad:
            raise ConfigurationError(
                f"--objective {statistic.name}: small is bad; make it a constraint, {statistic.name}>=..."
            )
    return found
