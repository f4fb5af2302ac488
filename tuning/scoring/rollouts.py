"""Rollouts of candidates in scenarios, and statistics of their results."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.simulation.batch.rollout import BatchResult, rollout
from dualwinch.simulation.batch.workers import Workers
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.progress import Progress, no_progress
from dualwinch.simulation.results.outcomes import WORDS, RunOutcomes
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.constraints import Constraint, measured

LEAST_TENSION = "worst.min_tension"
"""The statistic whose lower bound forbids slack ropes."""


def run_pairs(
    keys: Sequence[str],
    parameters: Sequence[Sequence[float]],
    scenarios: Sequence[Experiment | Scenario],
    workers: Workers = None,
    max_slack: float | None = None,
    progress: Progress = no_progress,
) -> BatchResult:
    """`rollout` that raises an interrupt, because an incomplete batch is useless here; arguments as there.

    It does so even if every rollout had already started and is finished.
    """
    result = rollout(keys, parameters, scenarios, workers=workers, max_slack=max_slack, progress=progress)
    if result.interrupted:
        raise KeyboardInterrupt
    return result


def counts(statistic: Statistic, scenario: Experiment | Scenario) -> bool:
    """Whether a scenario counts in a statistic; hard ones count in the worst case only."""
    return statistic.kind == "worst" or not (isinstance(scenario, Scenario) and scenario.hard)


def keeps_tight(constraints: Sequence[Constraint]) -> bool:
    """Whether constraints forbid slack ropes."""
    return any(
        constraint.statistic.name == LEAST_TENSION and constraint.at_least and constraint.bound > 0
        for constraint in constraints
    )


def worst_of(result: RunOutcomes, constraints: Sequence[Constraint]) -> NDArray[np.float64]:
    """Largest violation of a bound on the worst case in each run (candidates, scenarios), as a share of the bound.

    It is infinite for incomplete runs.
    """
    worst = np.full(result.outcomes.shape, -np.inf)
    for constraint in constraints:
        statistic = constraint.statistic
        if isinstance(statistic, Statistic) and statistic.kind == "worst":
            violations = [[constraint.violation(value) for value in row] for row in result.metrics[statistic.metric]]
            worst = np.maximum(worst, violations)
    return np.where(result.outcomes == "completed", worst, np.inf)


def over(statistic: Statistic, result: RunOutcomes, row: int, scenarios: Sequence[Experiment | Scenario]) -> float:
    """A statistic of a row of a result, over the completed scenarios that count; NaN without any.

    The least tension is 0 if a run was stopped because of a slack rope.
    """
    if statistic.name == LEAST_TENSION and (result.outcomes[row] == WORDS[Outcome.GIVEN_UP]).any():
        return 0.0
    counted = [counts(statistic, scenario) for scenario in scenarios]
    return measured(statistic, result.metrics[statistic.metric][row, (result.outcomes[row] == "completed") & counted])
