"""Rollouts of candidates in scenarios, and statistics of what they gave."""

from collections.abc import Sequence

from dualwinch.simulation.batch.rollout import BatchResult, rollout
from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.simulation.ensembles.statistic import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.scoring.measured import measured


def run_pairs(
    keys: Sequence[str],
    parameters: Sequence[Sequence[float]],
    scenarios: Sequence[Experiment | Scenario],
    threads: int | None = None,
) -> BatchResult:
    """`rollout`, but an interrupt is raised, for half a batch is of no use here.

    Raises:
        KeyboardInterrupt: it was interrupted, even if every rollout was under way by then and is finished.
    """
    result = rollout(keys, parameters, scenarios, threads=threads)
    if result.interrupted:
        raise KeyboardInterrupt
    return result


def counts(statistic: Statistic, scenario: Experiment | Scenario) -> bool:
    """Whether a scenario counts in a statistic: one that was picked as a hard one does in what is the worst only."""
    return statistic.kind == "worst" or not (isinstance(scenario, Scenario) and scenario.hard)


def over(statistic: Statistic, result: BatchResult, row: int, scenarios: Sequence[Experiment | Scenario]) -> float:
    """A statistic of a row of a result, over the scenarios that count and ran to their end; finite."""
    counted = [counts(statistic, scenario) for scenario in scenarios]
    return measured(statistic, result.metrics[statistic.metric][row, (result.outcomes[row] == "completed") & counted])
