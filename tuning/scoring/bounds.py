"""Bounds as numbers: a share of what the paper's controller reaches is one of what it reaches in the same scenarios."""

from collections.abc import Sequence

from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.constraint import Constraint
from dualwinch.tuning.prepared import Prepared
from dualwinch.tuning.scoring.runs import over


def bounds_in(
    prepared: Prepared, paper: BatchResult, scenarios: Sequence[Experiment | Scenario]
) -> tuple[Constraint, ...]:
    """The constraints of a problem in other scenarios than those that it is tuned in.

    Shares of the paper's stability margins stay those of the machines that it is tuned on.

    Args:
        prepared: the problem.
        paper: the paper's controller in the scenarios, one row.
        scenarios: the others.
    """
    return tuple(
        constraint.given(over(constraint.statistic, paper, 0, scenarios))
        if constraint.of_paper and isinstance(constraint.statistic, Statistic)
        else known
        for constraint, known in zip(prepared.problem.constraints, prepared.constraints, strict=True)
    )
