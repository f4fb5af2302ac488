"""Constraints of a stress test, their violations, and numbers as people read them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.quantities.tables import readable_unit
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metrics import in_words
from dualwinch.simulation.results.outcomes import RunOutcomes
from dualwinch.tuning.constraints import NO_PEAK, Constraint, constraints_from, measured

SHARE = "share"
"""Stands for the unit of a number that is a share of something, and is read in per cent."""

SMALLER = {
    "m": ((1e3, "mm"), (1e6, "µm")),
    "s": ((1e3, "ms"), (1e6, "µs")),
    "m/s": ((1e3, "mm/s"),),
    "m^2": ((1e6, "mm²"),),
    SHARE: ((100.0, "%"),),
}
"""Unit → factors and names of the units in which smaller values of it are read."""

SMALL_VALUE = 0.1
"""Below this a value is read in a smaller unit; a share always is."""


TINY, HUGE = 1e-4, 1e7
"""Numbers beyond these have an exponent."""


def unit_of(quantity: Quantity) -> str:
    """The unit a number is read in: `SHARE` where its meaning says so."""
    return SHARE if quantity.unit == "1" and "share" in quantity.meaning.split() else quantity.unit


def plain(value: float, digits: int = 3) -> str:
    """A number of some digits, a whole one in full; without an exponent where it is neither tiny nor huge."""
    rounded = f"{value:.{digits}g}"
    if value == round(value) and abs(value) < HUGE:
        return f"{round(value)}".replace("-", "−")
    text = f"{float(rounded):.10g}" if TINY <= abs(value) < HUGE else rounded
    return text.replace("-", "−")


def scaled_unit(largest: float, unit: str) -> tuple[float, str]:
    """Factor and name of the unit in which numbers up to a largest one are read."""
    factor, name = 1.0, readable_unit(unit)
    for larger, smaller in SMALLER.get(unit, ()):
        if abs(largest) * factor < SMALL_VALUE or unit == SHARE:
            factor, name = larger, smaller
    return factor, name


def with_unit(values: Sequence[float], unit: str) -> tuple[list[str], str]:
    """Numbers in a unit that suits the largest of them, and what stands behind them, with a space.

    They have as many digits as it takes to tell them apart, up to six.
    """
    factor, name = scaled_unit(max(map(abs, values)), unit)
    words: list[str] = []
    for digits in range(3, 7):
        words = [plain(factor * value, digits) for value in values]
        if len(set(words)) == len(set(values)):
            break
    return words, f" {name}".rstrip()


def multiple(size: float) -> str:
    """A size as a multiple of the ensemble's, such as ``0.0075×``."""
    return f"{float(f'{size:.2g}'):g}×"


Floats = NDArray[np.float64]

NO_SLACK = "worst.slack_share<=0"
NO_WORSE = "worst.mse<=4*paper"
"""Twice the root mean square error of the paper's gains without imperfections."""

DEFAULTS = (NO_SLACK, NO_PEAK, NO_WORSE)
"""No slack rope, no peak beyond the limit, and an error that is not twice the paper's.

A study's own constraints come before them: they take the place of those on the same figure of merit.
"""

WORSE = 2.0
"""How many times as bad as in the base gains may become that violate a constraint even there.

Unless that bounds nothing or the ropes bear too much already (`failures`).
"""


def value_of(constraint: Constraint, runs: RunOutcomes) -> float:
    """What a constraint is on, over the scenarios that ran to their end (`measured`)."""
    statistic = statistic_of(constraint)
    return measured(statistic, runs.of_completed(statistic.metric))


@dataclass(frozen=True)
class BrokenLimit:
    """A limit that is broken.

    Attributes:
        what: name of the figure of merit, or of the outcome of a run that did not end well.
        value: of the statistic; of an outcome, the number of its runs.
        bound: what was allowed.
        unit: of both; empty for outcomes.
        at_least: whether the bound is a lower one.
    """

    what: str
    value: float
    bound: float
    unit: str
    at_least: bool = False

    @property
    def words(self) -> str:
        """Such as ``peak tension 6980 N > 6000 N``."""
        name = self.label
        if not self.unit:
            return f"{name} in {self.value:.0f} scenario{'s' * (self.value != 1)}"
        (value, bound), unit = with_unit([self.value, self.bound], self.unit)
        return f"{name} {value}{unit} {'<' if self.at_least else '>'} {bound}{unit}"

    @property
    def label(self) -> str:
        """What broke, alone."""
        return in_words(self.what)


ON_BOUND = 1e-6
"""Share of a bound within which gains are on it, as the paper's are on theirs: any imperfection takes them across."""


@dataclass(frozen=True)
class RobustnessLimit:
    """A constraint as it holds for some gains.

    Attributes:
        constraint: with its bound as a number.
        asked: the same, as it was asked for; another one where the gains violate it in the base, or are
            just on it.
    """

    constraint: Constraint
    asked: Constraint

    @property
    def eased(self) -> bool:
        """Whether the gains break the constraint in the base, and so have another bound."""
        return self.constraint is not self.asked

    @property
    def of_paper(self) -> bool:
        """Whether the constraint was asked for as a factor on what the paper's gains reach."""
        return self.asked.text.endswith("paper")

    @property
    def vacuous(self) -> bool:
        """Whether nothing can break it: a share of 1, or a tension of at least 0 N."""
        constraint = self.constraint
        if constraint.at_least:
            return constraint.bound <= 0
        return unit_of(constraint.statistic.quantity) == SHARE and constraint.bound >= 1

    @property
    def words(self) -> str:
        """The constraint as asked for, as a number, and as the factor on what the paper's gains reach."""
        return self.asked.label + (f" ({self.asked.text.partition('=')[2].strip()})" if self.of_paper else "")

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        constraint = self.constraint
        return {
            "asked": self.asked.text,
            "statistic": constraint.statistic.name,
            "at_least": constraint.at_least,
            "bound": constraint.bound,
            "unit": constraint.statistic.unit,
            "eased": self.eased,
        }


def constraints_of(texts: Sequence[str] | None, noted: Sequence[str], experiment: Experiment) -> tuple[Constraint, ...]:
    """The constraints on gains.

    Args:
        texts: as asked for; ``None``: what a study has noted, and those `DEFAULTS` that it says nothing of.
        noted: constraints of a study. Margins among them are left out: they are not measured in runs.
        experiment: where configuration keys are looked up, and metrics beside the built-in ones.

    Raises:
        ConfigurationError: a text that is no constraint on a figure of merit.
    """
    if texts is not None:
        asked = constraints_from(texts, experiment)
        for constraint in asked:
            statistic_of(constraint)
        return asked
    kept = [each for each in constraints_from(noted, experiment) if isinstance(each.statistic, Statistic)]
    known = {constraint.statistic.metric for constraint in kept}
    others = constraints_from(DEFAULTS, experiment)
    return (*kept, *(constraint for constraint in others if constraint.statistic.metric not in known))


def statistic_of(constraint: Constraint) -> Statistic:
    """What a constraint is on.

    Raises:
        ConfigurationError: it is no figure of merit of runs.
    """
    if not isinstance(constraint.statistic, Statistic):
        raise ConfigurationError(
            f"--constraint {constraint.text}: must be on a figure of merit of runs, e.g. {NO_SLACK}"
        )
    return constraint.statistic


def limits_of(constraints: Sequence[Constraint], paper: RunOutcomes, own: RunOutcomes) -> tuple[RobustnessLimit, ...]:
    """Constraints as they hold for some gains; without factors on what the paper's gains reach, where they do not.

    Args:
        constraints: maybe with factors on what the paper's gains reach; that is what they reach in the base.
        paper: what the paper's gains came to in the base.
        own: what these gains came to in the base.
    """
    found = []
    for constraint in constraints:
        asked, near = constraint.given(value_of(constraint, paper)), ON_BOUND if constraint.of_paper else 0.0
        if asked.unbounded:
            continue
        reached = value_of(asked, own)
        larger = (reached > 0) is not asked.at_least  # of two numbers that differ by the factor, the worse one
        eased = replace(asked, bound=reached * WORSE if larger else reached / WORSE)
        found.append(RobustnessLimit(asked if asked.violation(reached, near) <= 0 else eased, asked))
    return tuple(found)


def failures(limits: Sequence[RobustnessLimit], runs: RunOutcomes, tension_max: float) -> tuple[BrokenLimit, ...]:
    """Why gains fail already in the base; nothing where they are good enough to be tried further.

    A run was not completed, a tension is beyond what ropes and motors bear, or a broken bound on a share or a tension
    would become one that nothing can break if it were eased.

    Args:
        limits: of these gains (`limits_of`).
        runs: what they came to in the base.
        tension_max: upper force limit of their winches in N.
    """
    if lost := broken((), runs):
        return lost
    asked = [RobustnessLimit(limit.asked, limit.asked) for limit in limits if limit.eased and not limit.of_paper]
    hopeless = {limit.asked for limit in limits if limit.vacuous}
    return tuple(
        found
        for limit in asked
        for found in broken([limit], runs)
        if limit.asked in hopeless or (found.what == "peak_tension" and found.value > tension_max)
    )


def is_no_measure(failures: Sequence[BrokenLimit]) -> bool:
    """Whether gains that fail like that are lost, so that multiples of what they reach bound nothing.

    A least tension that is not kept does not say so: a rope may have been slack for a moment.
    """
    return any(not failure.at_least for failure in failures)


def broken(limits: Sequence[RobustnessLimit], runs: RunOutcomes) -> tuple[BrokenLimit, ...]:
    """Violations: runs that were not completed first, then what is exceeded by the largest share."""
    lost = [str(outcome) for outcome in runs.outcomes[~runs.completed]]
    found = [BrokenLimit(outcome, lost.count(outcome), 0, "") for outcome in dict.fromkeys(sorted(lost))]
    exceeded = []
    for limit in limits:
        constraint = limit.constraint
        value = value_of(constraint, runs)
        beyond = constraint.violation(value)
        if beyond > 0 and runs.completed.any():
            unit = unit_of(constraint.statistic.quantity)
            exceeded.append(
                (beyond, BrokenLimit(constraint.statistic.metric, value, constraint.bound, unit, constraint.at_least))
            )
    return (*found, *(entry for _, entry in sorted(exceeded, key=lambda pair: -pair[0])))
