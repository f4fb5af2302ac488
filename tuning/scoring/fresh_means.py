"""Bounds on means in the fresh draws of a candidate, decided by paired differences where another controller is run."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t

from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.results.outcomes import RunOutcomes, concatenated
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.scoring.certificate import series
from dualwinch.tuning.scoring.rollouts import counts, over
from dualwinch.tuning.scoring.scorer import Scorer


class FreshMeans:
    """Violations of bounds on means, over all fresh draws within the motors' authority.

    1. The candidate's mean is that over all draws so far.
    2. A bound that refers to the paper's gains or the start is a factor on their mean in the same draws: these are run
       there as well, since differences in the same draw vary much less than either mean.
    3. They are run in no more draws once the sign of the mean difference is settled: by Student's t-test of paired
       differences (Casella and Berger, Statistical Inference, 2002, Section 8.3), whose error is divided among the
       looks as that of the certificate among its stages. Bounds on medians and quantiles are never settled.

    Args:
        scorer: runs the other controllers.
        error: of all looks together.
        referring: whether bounds that refer to another controller are evaluated.

    Attributes:
        reference_runs: number of rollouts of other controllers so far.
    """

    def __init__(self, scorer: Scorer, error: float, *, referring: bool = True) -> None:
        self._scorer, self._error, self._looks = scorer, error, 0
        self.reference_runs = 0
        pairs = zip(scorer.problem.constraints, scorer.training.constraints, strict=True)
        self._bounds = {
            trained.label: bound
            for bound, trained in pairs
            if bound.kind == "mean" and (referring or not bound.reference)
        }
        self._statistics = {
            label: bound.statistic for label, bound in self._bounds.items() if isinstance(bound.statistic, Statistic)
        }
        self._open = set(self._bounds)
        self._scenarios: dict[str, list[Experiment | Scenario]] = {label: [] for label in self._bounds}
        self._runs: dict[str, list[RunOutcomes]] = {label: [] for label in self._bounds}
        self._references: dict[str, list[RunOutcomes]] = {label: [] for label in self._bounds}

    def add(self, runs: RunOutcomes, scenarios: Sequence[Experiment | Scenario]) -> None:
        """Add a candidate's runs in further draws, one row."""
        self._looks += 1
        named = {self._bounds[label].reference for label in self._open} - {""}
        references = {name: self._scorer.reference_runs(name, scenarios) for name in named}
        self.reference_runs += len(named) * len(scenarios)
        for label, bound in self._bounds.items():
            if bound.reference and label not in self._open:
                continue
            self._runs[label].append(runs)
            self._scenarios[label] += scenarios
            if bound.reference:
                self._references[label].append(references[bound.reference])
        self._open -= {label for label in self._open if self._settled(label)}

    @property
    def controllers(self) -> int:
        """Number of controllers that run in further draws: the candidate, and those that open bounds refer to."""
        return 1 + len({self._bounds[label].reference for label in self._open} - {""})

    @property
    def violations(self) -> dict[str, float]:
        """Label of a bound in training → its violation, over the draws in which it was evaluated; <= 0: satisfied."""
        return {label: self._bound(label).violation(self._mean(label)) for label in self._bounds}

    @property
    def violated(self) -> dict[str, float]:
        """Label of a violated bound, as a number in these draws → its violation."""
        return {self._bound(label).label: violation for label, violation in self.violations.items() if violation > 0}

    @property
    def rejected(self) -> bool:
        """Whether a bound is violated beyond doubt."""
        return any(violation > 0 and label not in self._open for label, violation in self.violations.items())

    def _mean(self, label: str) -> float:
        return over(self._statistics[label], concatenated(self._runs[label]), 0, self._scenarios[label])

    def _bound(self, label: str) -> Constraint:
        """A bound as a number in these draws."""
        bound = self._bounds[label]
        if not bound.reference:
            return bound
        reference = concatenated(self._references[label])
        return bound.given(over(self._statistics[label], reference, 0, self._scenarios[label]))

    def _settled(self, label: str) -> bool:
        """Whether the mean difference from a bound differs from 0 by Student's test."""
        statistic, constraint = self._statistics[label], self._bounds[label]
        if statistic.kind != "mean":
            return False
        values = self._values(statistic, self._runs[label])
        bound: NDArray[np.float64] | float = constraint.bound
        if constraint.reference:
            bound = bound * self._values(statistic, self._references[label])
        counted = np.array([counts(statistic, scenario) for scenario in self._scenarios[label]])
        differences = (values - bound)[counted]
        differences = differences[np.isfinite(differences)]
        if len(differences) < 2:
            return False
        deviation = differences.std(ddof=1) / np.sqrt(len(differences))
        quantile = float(t.isf(series(self._error, self._looks), len(differences) - 1))
        return bool(abs(differences.mean()) > quantile * deviation)

    @staticmethod
    def _values(statistic: Statistic, runs: Sequence[RunOutcomes]) -> NDArray[np.float64]:
        """(draws,) the metric of a statistic in each draw; NaN where the run was not completed."""
        outcomes = concatenated(list(runs))
        return np.where(outcomes.outcomes[0] == "completed", outcomes.metrics[statistic.metric][0], np.nan)
