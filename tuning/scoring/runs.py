"""Rollouts of candidates in scenarios, and statistics of what they gave."""

from collections.abc import Sequence

from dualwinch.simulation.batch.rollout import WENT_SLACK, BatchResult, rollout
from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.simulation.ensembles.statistic import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.scoring.measured import measured

LEAST_TENSION = "worst.min_tension"
"""The statistic by which ropes are kept from being slack."""


def run_pairs(
    keys: Sequence[str],
    parameters: Sequence[Sequence[float]],
    scenarios: Sequence[Experiment | Scenario],
    threads: int | None = None,
    most_slack: float | None = None,
) -> BatchResult:
    """`rollout`, but an interrupt is raised, for half a batch is of no use here; arguments as there.

    Raises:
        KeyboardInterrupt: it was interrupted, even if every rollout was under way by then and is finished.
    """
    result = rollout(keys, parameters, scenarios, threads=threads, most_slack=most_slack)
    if result.interrupted:
        raise KeyboardInterrupt
    return result


def counts(statistic: Statistic, scenario: Experiment | Scenario) -> bool:
    """Whether a scenario counts in a statistic: one that was picked as a hard one does in what is the worst only."""
    return statistic.kind == "worst" or not (isinstance(scenario, Scenario) and scenario.hard)


def over(statistic: Statistic, result: BatchResult, row: int, scenarios: Sequence[Experiment | Scenario]) -> float:
    """A statistic of a row of a result, over the scenarios that count and ran to their end; finite.

    A run that was given up because a rope was slack had a tension of zero, whatever else came of it.
    """
    if statistic.name == LEAST_TENSION and (result.outcomes[row] == WENT_SLACK).any():
        return 0.0
    counted = [counts(statistic, scenario) for scenario in scenarios]
    return measured(statistic, result.metrics[statistic.metric][row, (result.outcomes[row] == "completed") & counted])
