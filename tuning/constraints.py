"""Objectives and constraints on statistics of runs and on stability margins, parsed from text with units."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis.describing_function import LARGEST_SPEED_ERROR
from dualwinch.analysis.margin_survey import WorstMargin
from dualwinch.analysis.resonance import LARGE_SIGNAL, MARGIN_AMPLITUDES, RESONANCE
from dualwinch.analysis.stability import sliding_mode
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Quantity, behind_number, suggestion, unknown
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.units import UNITS, factor
from dualwinch.simulation.ensembles.result import Statistic, statistic_from
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metric import Metric


def measured(statistic: Statistic, values: NDArray[np.float64]) -> float:
    """A statistic over a metric of completed scenarios (n,); NaN if none is finite."""
    value = float(statistic.over(values))
    return value if math.isfinite(value) else math.nan


MARGINS = {
    "gain_margin": ("gain", Quantity("1", "largest factor on the loop gain")),
    "phase_margin": ("phase", Quantity("deg", "largest extra phase lag")),
    "delay_margin": ("delay", Quantity("s", "largest extra delay")),
    "disk_margin": ("disk", Quantity("1", "largest disk of simultaneous gain and phase changes; from 2 on any gain")),
    "resonance_margin": (RESONANCE, Quantity("1", "largest factor on the loop gain at the drums' resonance, by rule")),
    "large_signal_margin": (
        LARGE_SIGNAL,
        Quantity("1", f"the same for all speed errors up to {100 * LARGEST_SPEED_ERROR:g} cm/s, as after a push"),
    ),
}
"""Name of a margin → its kind (of `analysis.margins.MARGIN_KINDS` or `resonance.MARGIN_AMPLITUDES`), unit, meaning."""

MOST_PHASE = 180.0
"""Largest phase margin in degrees that a constraint may ask for."""


@dataclass(frozen=True)
class MarginStatistic:
    """The smallest value of a stability margin.

    Attributes:
        metric: one of `MARGINS`.
    """

    metric: str

    kind = "worst"
    small_is_bad = True

    @property
    def margin(self) -> str:
        """Kind of margin, a key of `analysis.margin_survey.MarginSurvey`."""
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

    @property
    def by_rule(self) -> bool:
        """Whether it follows from the rule for the drums' resonance, without a linearised loop."""
        return self.margin in MARGIN_AMPLITUDES

    def of(self, worst: Mapping[str, WorstMargin]) -> float:
        """Its value; infinite if no such change makes the loop unstable."""
        return worst[self.margin].value


def margin_statistic(text: str, own: Sequence[Metric] = ()) -> MarginStatistic | None:
    """The statistic of a name; ``None`` if it names no margin, or one of the experiment's own metrics.

    Raises:
        ConfigurationError: a statistic of a margin other than the worst, or an unknown margin.
    """
    kind, _, metric = text.strip().rpartition(".")
    if metric in {part.table() for part in own}:
        return None
    if metric in MARGINS:
        if kind != MarginStatistic.kind:
            raise ConfigurationError(f"'{text.strip()}': a margin must be bounded as {MarginStatistic(metric).name}")
        return MarginStatistic(metric)
    if metric.endswith("_margin"):
        raise ConfigurationError(f"'{text.strip()}': {unknown('margin', metric, MARGINS)}")
    return None


ANGLES = {"deg": 1.0, "rad": 180 / math.pi}
"""Unit of a phase margin → its factor to degrees."""

DECIBEL, PER_CENT = "dB", "%"
"""Units of a gain margin besides the plain factor, and of a share."""


def in_si(text: str, statistic: Statistic | MarginStatistic | None = None) -> float:
    """A number, with or without a unit, in the unit of the statistic that it bounds.

    Without a statistic it is a factor, possibly in per cent.

    Raises:
        ValueError: no number.
        ConfigurationError: a unit that does not suit the statistic.
    """
    parts = re.fullmatch(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z%].*)", text.strip())
    if not parts or re.fullmatch(r"[eE][-+]?\d+", parts[2]):
        return float(text)
    value, unit, unit_of_statistic = float(parts[1]), parts[2], "1" if statistic is None else statistic.unit
    if isinstance(statistic, MarginStatistic) and statistic.metric == "gain_margin" and unit != unit_of_statistic:
        return 10 ** (value / 20) if unit == DECIBEL else _refused(unit, [DECIBEL])
    if unit_of_statistic == "1" and not isinstance(statistic, MarginStatistic):
        return value / 100 if unit == PER_CENT else _refused(unit, [PER_CENT])
    if unit_of_statistic == "deg":
        return value * ANGLES[unit] if unit in ANGLES else _refused(unit, list(ANGLES))
    if unit_of_statistic in UNITS:
        return value * factor(unit, unit_of_statistic)
    return (
        value if unit == unit_of_statistic else _refused(unit, [] if unit_of_statistic == "1" else [unit_of_statistic])
    )


def _refused(unit: str, allowed: list[str]) -> float:
    rule = f"must be one of {', '.join(allowed)}" if allowed else "must be a plain number"
    raise ConfigurationError(f'unit "{unit}": {rule}')


NONE = "none"
"""Text for no constraint."""

NO_SLACK = "worst.min_tension>=0.4*controller.coordination.tension_min"
NO_PEAK = "worst.peak_tension<=controller.coordination.tension_max"
RECOVERS = "worst.slack_share<=0.5%", "worst.peak_tension<=1.25*controller.coordination.tension_max"
"""Where overloads are drawn: a rope may be slack for 250 ms of a run of 50 s. A drive without torque for 0.1 s loses
its rope's tension within hundredths of a second, whatever the gains, and winds the rope up in as long again."""
QUIET = "mean.chatter<=0.25*paper"
NO_LOUDER = "mean.chatter<=1*paper"
NO_MORE_SATURATED = "mean.saturated_share<=1*paper"
NO_HEAVIER = "mean.continuous_load<=1.05*paper"
STIFFER = "mean.continuous_load<=1.2*paper"
"""Where drums swing: a sagging rope's stiffness grows with the cube of its tension (Ernst), so preload pays."""
NO_LOUDER_THAN_START, NO_HEAVIER_THAN_START = "mean.chatter<=2*start", "mean.continuous_load<=1.2*start"
"""Bounds for a machine of one's own: chatter and load of the paper's gains say nothing about other ropes and motors."""
LATE = 5e-3
"""Least delay margin in s: the default bound where margins are bounded; elsewhere a remark reports smaller ones."""
LATE_AT_REST = 1e-3
"""The default bound in s where drums swing: behind a gearbox that gives, a drum's damping tolerates 2 ms at most."""
ROBUST, ROBUST_AT_REST = (
    ("worst.disk_margin>=0.4", f"worst.delay_margin>={1e3 * delay:g}ms") for delay in (LATE, LATE_AT_REST)
)
DAMPED = "worst.large_signal_margin>=1"
"""Where drums swing: stable for all speed errors that saturation allows, so that a push ends in no oscillation."""


REFERENCES = ("paper", "start")
"""Names in a bound for a statistic's value with the paper's controller, and with the start of the search."""


@dataclass(frozen=True)
class Constraint:
    """A bound on a statistic.

    Attributes:
        text: as given.
        statistic: that is bounded.
        at_least: whether the bound is a lower one.
        bound: in the statistic's unit, or a factor.
        reference: of `REFERENCES`, if the bound is a factor on the statistic's value with it; else empty.
    """

    text: str
    statistic: Statistic | MarginStatistic
    at_least: bool
    bound: float
    reference: str = ""

    @property
    def kind(self) -> str:
        """What it bounds: every run (``run``), a stability margin (``margin``) or a statistic of runs (``mean``)."""
        if isinstance(self.statistic, MarginStatistic):
            return "margin"
        return "run" if self.statistic.kind == "worst" else "mean"

    def given(self, reached: float) -> "Constraint":
        """The constraint with its bound as a number, given the statistic's value with the reference.

        If that completes no run (NaN), the bound is infinite.
        """
        if not self.reference:
            return self
        nothing = -math.inf if self.at_least else math.inf
        return replace(self, bound=nothing if math.isnan(reached) else self.bound * reached, reference="")

    @property
    def unbounded(self) -> bool:
        """Whether nothing violates it."""
        return self.bound == (-math.inf if self.at_least else math.inf)

    def violation(self, value: float, margin: float = 0.0) -> float:
        """Excess of a value beyond the bound, as a share of the bound (of 1 for the bound 0); <= 0: it is satisfied.

        Args:
            value: of the statistic. NaN, a statistic that no run has, is a violation of 1; infinity is one of 1 or -1.
            margin: distance to keep from the bound, as a share of it; none from 0.
        """
        if not math.isfinite(value):
            return -1.0 if value == (math.inf if self.at_least else -math.inf) else 1.0
        if math.isinf(self.bound):
            return -1.0 if self.unbounded else 1.0
        excess = self.bound - value if self.at_least else value - self.bound
        return excess / abs(self.bound) + margin if self.bound else excess

    @property
    def label(self) -> str:
        """The constraint with its bound as a number with its unit, or as a factor."""
        if self.unbounded:
            return f"{self.statistic.name}: no bound, as the gains that it refers to complete no run"
        sign = ">=" if self.at_least else "<="
        bound = f"{self.bound:.6g}{behind_number(self.statistic.unit)}"
        if self.reference:
            bound = f"the {self.reference}'s" if self.bound == 1 else f"{self.bound:.6g} times the {self.reference}'s"
        return f"{self.statistic.name} {sign} {bound}"


def default_constraints(
    ensemble: bool,
    *,
    lag: bool = False,
    swinging: bool = False,
    resonance: bool = False,
    own: bool = False,
    overloads: bool = False,
) -> tuple[str, ...]:
    """No slack rope, no peak beyond the limit, less chatter than the paper's, stability margins, a damped resonance.

    Without an ensemble this is the paper's own problem, the least error subject to saturation: commands are saturated
    no longer than the paper's.

    In an ensemble, sensors are noisy, and motors without lag pass on all the chatter of their commands: it is bounded
    to a quarter of the paper's. Motors with lag may bear hardly more load than with the paper's gains: a higher preload
    gains almost nothing there, and gains that rely on it fail on other machines. Where drums swing on ropes that sag,
    more load is allowed, for a preload that stiffens the ropes. Margins are bounded in an ensemble only: in a run
    without noise they would be those of infinitely small motions. Where drums swing, they are those at small speed
    errors, the delay margin has a smaller bound, and the drums' resonance must be damped for all speed errors up to
    those after a push, if its rule applies to the law (`resonance`). In an ensemble of one's own (`own`), chatter and
    load are bounded by multiples of those of the gains that the search starts from. Where overloads are drawn, the
    bounds of the tensions are those of a recovery (`RECOVERS`).
    """
    tensions = RECOVERS if overloads else (NO_SLACK, NO_PEAK)
    robust = ROBUST_AT_REST if swinging else ROBUST
    damped = (*(robust if ensemble else ()), *((DAMPED,) if resonance else ()))
    if ensemble and own:
        return *tensions, NO_LOUDER_THAN_START, NO_HEAVIER_THAN_START, *damped
    if ensemble and lag:
        return *tensions, NO_LOUDER, STIFFER if swinging else NO_HEAVIER, *damped
    if ensemble:
        return *tensions, QUIET, *damped
    return *tensions, NO_LOUDER, NO_MORE_SATURATED, *damped


def constraints_from(texts: Sequence[str], experiment: Experiment) -> tuple[Constraint, ...]:
    """Parse constraints, each ``STATISTIC<=BOUND`` or ``STATISTIC>=BOUND``, or `NONE`, which is skipped.

    Statistics may be of the experiment's own metrics, and bounds may be its keys.

    Raises:
        ConfigurationError: anything else, or an unknown name.
    """
    constraints = [_constraint(text, experiment) for text in texts if text != NONE]
    for index, constraint in enumerate(constraints):
        side = constraint.statistic, constraint.at_least
        if side in [(other.statistic, other.at_least) for other in constraints[:index]]:
            raise ConfigurationError(f"--constraint {constraint.text}: {constraint.statistic.name} is bounded twice")
    return tuple(constraints)


def constraints_with(
    texts: Sequence[str] | None, defaults: Sequence[str], experiment: Experiment
) -> tuple[Constraint, ...]:
    """Parse constraints, and add the default ones on other statistics or sides; errors as in `constraints_from`.

    `NONE` among the texts, or an empty list, drops the default ones.
    """
    constraints = constraints_from(texts or (), experiment)
    if texts is not None and (NONE in texts or not texts):
        return constraints
    sides = {(constraint.statistic, constraint.at_least) for constraint in constraints}
    usual = constraints_from(defaults, experiment)
    return (*(each for each in usual if (each.statistic, each.at_least) not in sides), *constraints)


def _constraint(text: str, experiment: Experiment) -> Constraint:
    parts = re.fullmatch(r"\s*([\w.]+)\s*(<=|>=)\s*(?:([^*]+)\*)?\s*([^*]+?)\s*", text)
    if not parts:
        raise ConfigurationError(f"--constraint {text}: must be STATISTIC<=BOUND, e.g. worst.peak_tension<=6000")
    name, sign, factor, term = parts.groups()
    metrics = experiment.metrics
    statistic = margin_statistic(name, metrics) or statistic_from(name, metrics)
    if "." not in name:
        bad_end = text.strip() if _is_own(statistic) else text.strip().replace(sign, _sign(statistic))
        named = " or ".join(f"{kind}.{bad_end}" for kind in ("worst", "mean"))
        raise ConfigurationError(f"--constraint {text}: of which statistic? {named}")
    if isinstance(statistic, MarginStatistic) and statistic.by_rule:
        sliding_mode(experiment, f"--constraint {text}: must be")
    scale = 1.0 if factor is None else _number(factor, text)
    if term in REFERENCES:
        return _checked(Constraint(text, statistic, sign == ">=", scale, term))
    if re.match(r"[A-Za-z]", term) and term not in {"inf", "nan"}:
        values = leaves(experiment)
        value = values.get(term)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            names = [*REFERENCES, *(key for key, names in values.items() if isinstance(names, float))]
            raise ConfigurationError(f"--constraint {text}: '{term}' names no number; {suggestion(term, names)}")
        return _checked(Constraint(text, statistic, sign == ">=", scale * float(value)))
    return _checked(Constraint(text, statistic, sign == ">=", scale * _number(term, text, statistic)))


def _checked(constraint: Constraint) -> Constraint:
    """The constraint, if it bounds the bad end of its statistic and can be satisfied.

    An own metric may be bounded at both ends: `Metric.small_is_bad` only determines which of many runs is the worst.

    Raises:
        ConfigurationError: it does not.
    """
    text, statistic = constraint.text, constraint.statistic
    sign, good_sign = (">=" if constraint.at_least else "<="), _sign(statistic)
    if sign != good_sign and not _is_own(statistic):
        end = "small" if statistic.small_is_bad else "large"
        raise ConfigurationError(f"--constraint {text}: {end} values are the bad ones: {text.replace(sign, good_sign)}")
    bound, unit = constraint.bound, behind_number(statistic.unit)
    if isinstance(statistic, MarginStatistic):
        if statistic.margin == "phase" and bound > MOST_PHASE:
            raise ConfigurationError(f"--constraint {text}: must be at most {MOST_PHASE:g}{unit}, half a turn")
        return constraint
    lower, upper = statistic.quantity.lower, statistic.quantity.upper
    if not constraint.at_least and bound < lower:
        raise ConfigurationError(f"--constraint {text}: nothing satisfies it, no run has less than {lower:g}{unit}")
    if not constraint.at_least and not constraint.reference and bound > upper:
        raise ConfigurationError(f"--constraint {text}: all runs satisfy it, none has more than {upper:g}{unit}")
    return constraint


def _sign(statistic: Statistic | MarginStatistic) -> str:
    """The sign of a bound on the bad end of a statistic."""
    return ">=" if statistic.small_is_bad else "<="


def _is_own(statistic: Statistic | MarginStatistic) -> bool:
    return isinstance(statistic, Statistic) and statistic.part is not None


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

OVERLOADED_OBJECTIVES = ("geomean.mse",)
"""Default where overloads are drawn: what these throw the vehicle off, with any gains, would decide a mean."""


def objectives_from(texts: Sequence[str], own: Sequence[Metric] = ()) -> tuple[Statistic, ...]:
    """Parse the statistics to minimise, e.g. ``["mean.mse", "mean.chatter"]``; more than one make a Pareto front.

    Raises:
        ConfigurationError: an unknown name, one named twice, or a statistic with bad small values.
    """
    for text in texts:
        if margin := margin_statistic(text, own):
            raise ConfigurationError(f"--objective {margin.name}: make it a constraint, {margin.name}>=...")
    statistics = tuple(statistic_from(text, own) for text in texts)
    for index, statistic in enumerate(statistics):
        if statistic in statistics[:index]:
            raise ConfigurationError(f"--objective {statistic.name}: is named twice")
        if statistic.small_is_bad:
            raise ConfigurationError(
                f"--objective {statistic.name}: small is bad; make it a constraint, {statistic.name}>=..."
            )
    return statistics
