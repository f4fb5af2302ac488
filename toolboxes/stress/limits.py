"""Constraints of a stress test, their violations, and formatting of numbers with units."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import (
    ConfigurationError,
    Experiment,
    Quantity,
    merit_statistics,
    merits,
    run_outcomes,
    tables,
    tuning_constraints,
)

SHARE = "share"
"""Stands for the unit of a share, which is shown in per cent."""

SMALLER = {
    "m": ((1e3, "mm"), (1e6, "µm")),
    "s": ((1e3, "ms"), (1e6, "µs")),
    "m/s": ((1e3, "mm/s"),),
    "m^2": ((1e6, "mm²"),),
    SHARE: ((100.0, "%"),),
}
"""Unit → factors and names of smaller units."""

SMALL_VALUE = 0.1
"""Values below this are shown in a smaller unit; shares always are."""


TINY, HUGE = 1e-4, 1e7
"""Numbers outside this range are shown with an exponent."""


def unit_of(quantity: Quantity) -> str:
    """The unit of a number: `SHARE` if its meaning is a share."""
    return SHARE if quantity.unit == "1" and "share" in quantity.meaning.split() else quantity.unit


def plain(value: float, digits: int = 3) -> str:
    """A number to `digits` digits, a whole one in full; without an exponent between `TINY` and `HUGE`."""
    rounded = f"{value:.{digits}g}"
    if value == round(value) and abs(value) < HUGE:
        return f"{round(value)}".replace("-", "−")
    text = f"{float(rounded):.10g}" if TINY <= abs(value) < HUGE else rounded
    return text.replace("-", "−")


def scaled_unit(largest: float, unit: str) -> tuple[float, str]:
    """Factor and name of the unit for numbers up to a largest one."""
    factor, name = 1.0, tables.readable_unit(unit)
    for larger, smaller in SMALLER.get(unit, ()):
        if abs(largest) * factor < SMALL_VALUE or unit == SHARE:
            factor, name = larger, smaller
    return factor, name


def with_unit(values: Sequence[float], unit: str) -> tuple[list[str], str]:
    """Numbers in a unit that suits the largest, and the text behind them: a space and the unit.

    They have three digits, or up to six where fewer would make different numbers equal.
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

DEFAULTS = (NO_SLACK, tuning_constraints.NO_PEAK, NO_WORSE)
"""No slack rope, no peak beyond the limit, and at most twice the paper's root mean square error.

A study's own constraint on the same metric replaces one of them.
"""

WORSE = 2.0
"""Factor on a statistic's value in the base: the eased bound, where gains violate a constraint there (`limits_of`)."""


def value_of(constraint: tuning_constraints.Constraint, runs: run_outcomes.RunOutcomes) -> float:
    """The statistic of a constraint over the completed scenarios (`measured`)."""
    statistic = statistic_of(constraint)
    return tuning_constraints.measured(statistic, runs.of_completed(statistic.metric))


@dataclass(frozen=True)
class ViolatedLimit:
    """A violated limit.

    Attributes:
        name: of the metric, or the outcome of an incomplete run.
        value: of the statistic; of an outcome, the number of its runs.
        bound: of the constraint.
        unit: of both; empty for outcomes.
        at_least: whether the bound is a lower one.
    """

    name: str
    value: float
    bound: float
    unit: str
    at_least: bool = False

    @property
    def words(self) -> str:
        """Such as ``peak tension 6980 N > 6000 N``."""
        label = self.label
        if not self.unit:
            return f"{label} in {self.value:.0f} scenario{'s' * (self.value != 1)}"
        (value, bound), unit = with_unit([self.value, self.bound], self.unit)
        return f"{label} {value}{unit} {'<' if self.at_least else '>'} {bound}{unit}"

    @property
    def label(self) -> str:
        """Name of the metric or outcome in words."""
        return merits.in_words(self.name)


ON_BOUND = 1e-6
"""Gains within this share of a bound lie on it, as the paper's do on their own: any imperfection violates it."""


@dataclass(frozen=True)
class StressLimit:
    """A constraint of a stress test, the same for all gains.

    Attributes:
        constraint: that applies, with its bound as a number; eased if gains violate it in the base or lie on its
            bound.
        requested: the requested constraint, with its bound as a number.
        on_bound: names of the gains that lie on the requested bound in the base.
        violated_by: names of the gains that violate it there.
    """

    constraint: tuning_constraints.Constraint
    requested: tuning_constraints.Constraint
    on_bound: tuple[str, ...] = ()
    violated_by: tuple[str, ...] = ()

    @property
    def eased(self) -> bool:
        """Whether the bound is eased."""
        return bool(self.on_bound or self.violated_by)

    def easing(self, whom: str = "") -> str:
        """Which bound is eased, to what, and because of which gains; empty if it is not.

        `whom` are the gains to which it applies, such as ``for all gains``.
        """
        reasons = [
            f"{_listed(names)} {verb if len(names) > 1 else singular} it"
            for names, verb, singular in (
                (self.on_bound, "lie on", "lies on"),
                (self.violated_by, "violate", "violates"),
            )
            if names
        ]
        bound = self.constraint.label.rpartition("= ")[2]
        change = " ".join(filter(None, (f"{self.requested.label} is eased to {bound}", whom)))
        return f"{change}: {' and '.join(reasons)} in the base" if reasons else ""

    @property
    def of_paper(self) -> bool:
        """Whether the requested bound is a factor on the value with the paper's gains."""
        return self.requested.text.endswith("paper")

    @property
    def vacuous(self) -> bool:
        """Whether no run can violate it: a share of at most 1, or a tension of at least 0 N."""
        constraint = self.constraint
        if constraint.at_least:
            return constraint.bound <= 0
        return unit_of(constraint.statistic.quantity) == SHARE and constraint.bound >= 1

    @property
    def words(self) -> str:
        """The requested constraint with its bound as a number, and the factor on the paper's value if there is one."""
        return self.requested.label + (f" ({self.requested.text.partition('=')[2].strip()})" if self.of_paper else "")

    def to_record(self) -> dict[str, Any]:
        """As a dictionary for JSON."""
        constraint = self.constraint
        return {
            "asked": self.requested.text,
            "statistic": constraint.statistic.name,
            "at_least": constraint.at_least,
            "asked_bound": self.requested.bound,
            "bound": constraint.bound,
            "unit": constraint.statistic.unit,
            "eased": self.eased,
            "on_bound": list(self.on_bound),
            "violated_by": list(self.violated_by),
        }


def _listed(names: Sequence[str]) -> str:
    *names_before, name = names or ("",)
    return f"{', '.join(names_before)} and {name}" if names_before else name


def constraints_of(
    texts: Sequence[str] | None, noted: Sequence[str], experiment: Experiment
) -> tuple[tuning_constraints.Constraint, ...]:
    """Parse the constraints of a stress test; by default those of a study (`noted`), and `DEFAULTS` on other metrics.

    Margins among those of a study are skipped, as they are not measured in runs; so are multiples of the values with
    the gains that its search started from.

    Raises:
        ConfigurationError: a text that is no constraint on a metric.
    """
    if texts is not None:
        constraints = tuning_constraints.constraints_from(texts, experiment)
        for constraint in constraints:
            statistic_of(constraint)
        return constraints
    measured_ones = [
        each
        for each in tuning_constraints.constraints_from(noted, experiment)
        if isinstance(each.statistic, merit_statistics.Statistic) and each.reference != "start"
    ]
    metrics = {constraint.statistic.metric for constraint in measured_ones}
    defaults = tuning_constraints.constraints_from(DEFAULTS, experiment)
    return (*measured_ones, *(constraint for constraint in defaults if constraint.statistic.metric not in metrics))


def statistic_of(constraint: tuning_constraints.Constraint) -> merit_statistics.Statistic:
    """The statistic of a constraint.

    Raises:
        ConfigurationError: it is no statistic of runs.
    """
    if not isinstance(constraint.statistic, merit_statistics.Statistic):
        raise ConfigurationError(
            f"--constraint {constraint.text}: must be on a figure of merit of runs, e.g. {NO_SLACK}"
        )
    return constraint.statistic


def limits_of(
    constraints: Sequence[tuning_constraints.Constraint],
    paper: run_outcomes.RunOutcomes,
    gains: Mapping[str, run_outcomes.RunOutcomes],
) -> tuple[StressLimit, ...]:
    """Constraints with bounds as numbers, the same for all gains, so that their robustness margins are comparable.

    A bound that some gains violate in the base, or lie on, as the paper's lie on their own value, measures no
    robustness: they break at any size. It is eased for all gains, to `WORSE` times the worst value of these. Factors on
    the paper's value are skipped if the paper's gains complete no run. All runs are in the base, `gains` by their name.
    """
    limits = []
    for constraint in constraints:
        requested = constraint.given(value_of(constraint, paper))
        if requested.unbounded:
            continue
        values = {name: value_of(requested, runs) for name, runs in gains.items()}
        violations = {name: requested.violation(value) for name, value in values.items() if math.isfinite(value)}
        tolerance = ON_BOUND if constraint.reference and requested.bound else 0.0  # twice 0 is no easier bound
        on_bound = tuple(name for name, share in violations.items() if abs(share) < tolerance)
        violated_by = tuple(name for name, share in violations.items() if share >= tolerance and share > 0)
        bounds = [_eased(requested, values[name]) for name in (*on_bound, *violated_by)]
        loosest = (min if requested.at_least else max)(bounds, key=lambda each: each.bound, default=requested)
        limits.append(StressLimit(loosest, requested, on_bound, violated_by))
    return tuple(limits)


def where_paper_is_no_measure(
    constraints: Sequence[tuning_constraints.Constraint], bounds: Mapping[str, float | None]
) -> tuple[tuple[tuning_constraints.Constraint, ...], tuple[tuning_constraints.Constraint, ...]]:
    """Constraints for gains that are judged by multiples of their own values, and those that are left out.

    Gains cannot be better than themselves: a factor that asks for that is replaced by the constraint's number in the
    gains' study (`bounds`, by its text), or left out where there is none.
    """
    applicable, left_out = list[tuning_constraints.Constraint](), list[tuning_constraints.Constraint]()
    for constraint in constraints:
        number = bounds.get(constraint.text)
        if not constraint.reference or (constraint.bound <= 1 if constraint.at_least else constraint.bound >= 1):
            applicable.append(constraint)
        elif number is None:
            left_out.append(constraint)
        else:
            text = f"{constraint.statistic.name}{'>=' if constraint.at_least else '<='}{number:g}"
            applicable.append(replace(constraint, text=text, bound=number, reference=""))
    return tuple(applicable), tuple(left_out)


def _eased(requested: tuning_constraints.Constraint, reached: float) -> tuning_constraints.Constraint:
    """A constraint whose bound is `WORSE` times as bad as a value."""
    larger = (reached > 0) is not requested.at_least  # whether multiplying, not dividing, by the factor eases the bound
    return replace(requested, bound=reached * WORSE if larger else reached / WORSE)


def failures(
    limits: Sequence[StressLimit], runs: run_outcomes.RunOutcomes, tension_max: float
) -> tuple[ViolatedLimit, ...]:
    """Limits (`limits_of`) for which gains already fail in the base; empty if their robustness margins are computed.

    Gains fail there if a run is incomplete, a tension exceeds the limit of ropes and motors (`tension_max`, in N), or
    easing a violated bound on a share or a tension would make it vacuous.
    """
    if incomplete := violated_limits((), runs):
        return incomplete
    requested = [
        StressLimit(limit.requested, limit.requested) for limit in limits if limit.eased and not limit.of_paper
    ]
    vacuous = {limit.requested for limit in limits if limit.vacuous}
    return tuple(
        violation
        for limit in requested
        for violation in violated_limits([limit], runs)
        if limit.requested in vacuous or (violation.name == "peak_tension" and violation.value > tension_max)
    )


def is_no_measure(failures: Sequence[ViolatedLimit]) -> bool:
    """Whether gains with these failures are unusable as baseline: multiples of their values are no sensible bounds.

    A violated least tension alone does not count: a rope may have been slack for a moment.
    """
    return any(not failure.at_least for failure in failures)


def violated_limits(limits: Sequence[StressLimit], runs: run_outcomes.RunOutcomes) -> tuple[ViolatedLimit, ...]:
    """Violated limits: first incomplete runs, then constraints in descending order of violation."""
    outcomes = [str(outcome) for outcome in runs.outcomes[~runs.completed]]
    incomplete = [ViolatedLimit(outcome, outcomes.count(outcome), 0, "") for outcome in dict.fromkeys(sorted(outcomes))]
    violations = []
    for limit in limits:
        constraint = limit.constraint
        value = value_of(constraint, runs)
        violation = constraint.violation(value)
        if violation > 0 and runs.completed.any():
            unit = unit_of(constraint.statistic.quantity)
            violations.append(
                (
                    violation,
                    ViolatedLimit(constraint.statistic.metric, value, constraint.bound, unit, constraint.at_least),
                )
            )
    return (*incomplete, *(entry for _, entry in sorted(violations, key=lambda pair: -pair[0])))
