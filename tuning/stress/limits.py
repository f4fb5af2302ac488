"""What gains must keep to under imperfections, and whether they do."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.constraint import NO_PEAK, Constraint, constraints_from
from dualwinch.tuning.scoring.measured import measured
from dualwinch.tuning.stress.words import unit_of, with_unit

Floats = NDArray[np.float64]

NO_SLACK = "worst.slack_share<=0"
NO_WORSE = "worst.mse<=4*paper"
"""Twice the root mean square error of the paper's gains without imperfections."""

DEFAULTS = (NO_SLACK, NO_PEAK, NO_WORSE)
"""No slack rope, no peak beyond the limit, and an error that is not twice the paper's.

A study's own constraints come before them: they take the place of those on the same figure of merit.
"""

WORSE = 2.0
"""How many times as bad as in the base gains may become that do not keep to a constraint even there."""

COMPLETED = "completed"


@dataclass(frozen=True)
class Reached:
    """What the scenarios of one size came to.

    Attributes:
        outcomes: (scenarios,) words.
        metrics: figure of merit → (scenarios,), NaN where a run was not completed.
    """

    outcomes: NDArray[np.str_]
    metrics: Mapping[str, Floats]

    def over(self, constraint: Constraint) -> float:
        """What a constraint is on, over the scenarios that ran to their end; finite (`measured`)."""
        statistic = statistic_of(constraint)
        return measured(statistic, self.metrics[statistic.metric][self.outcomes == COMPLETED])


@dataclass(frozen=True)
class Broken:
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
        return self.what.upper() if self.what in {"mse", "mae"} else self.what.replace("_", " ")


NEAR = 1e-6
"""Share of a bound within which gains are on it, as the paper's are on theirs: any imperfection takes them across."""


@dataclass(frozen=True)
class Limit:
    """A constraint as it holds for some gains.

    Attributes:
        constraint: with its bound as a number.
        asked: the same, as it was asked for; another one where the gains do not keep to it in the base, or are
            just on it.
    """

    constraint: Constraint
    asked: Constraint

    @property
    def eased(self) -> bool:
        """Whether the gains break the constraint in the base, and so have another bound."""
        return self.constraint is not self.asked


def constraints_of(texts: Sequence[str] | None, noted: Sequence[str], experiment: Experiment) -> tuple[Constraint, ...]:
    """What gains have to keep to.

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


def limits_of(constraints: Sequence[Constraint], paper: Reached, own: Reached) -> tuple[Limit, ...]:
    """Constraints as they hold for some gains.

    Args:
        constraints: maybe with factors on what the paper's gains reach; that is what they reach in the base.
        paper: what the paper's gains came to in the base.
        own: what these gains came to in the base.
    """
    found = []
    for constraint in constraints:
        asked, near = constraint.given(paper.over(constraint)), NEAR if constraint.of_paper else 0.0
        reached = own.over(asked)
        larger = (reached > 0) is not asked.at_least  # of two numbers that differ by the factor, the worse one
        eased = replace(asked, bound=reached * WORSE if larger else reached / WORSE)
        found.append(Limit(asked if asked.violation(reached, near) <= 0 else eased, asked))
    return tuple(found)


def broken(limits: Sequence[Limit], runs: Reached) -> tuple[Broken, ...]:
    """What gains do not keep to: runs that did not end well first, then what is exceeded by the largest share."""
    lost = [str(outcome) for outcome in runs.outcomes if outcome != COMPLETED]
    found = [Broken(outcome, lost.count(outcome), 0, "") for outcome in dict.fromkeys(sorted(lost))]
    exceeded = []
    for limit in limits:
        constraint = limit.constraint
        value = runs.over(constraint)
        beyond = constraint.violation(value)
        if beyond > 0 and (runs.outcomes == COMPLETED).any():
            unit = unit_of(constraint.statistic.quantity)
            exceeded.append(
                (beyond, Broken(constraint.statistic.metric, value, constraint.bound, unit, constraint.at_least))
            )
    return (*found, *(entry for _, entry in sorted(exceeded, key=lambda pair: -pair[0])))
