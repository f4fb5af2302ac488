"""Which scenarios decide what a point of the space is worth: the others need no gradient."""

from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.prepared import Prepared
from dualwinch.tuning.scoring.runs import counts, run_pairs
from dualwinch.tuning.space import Point

HARDEST = 3
"""Scenarios that decide on a constraint about the worst: those with the worst values, one of which it will be next."""


def deciding(prepared: Prepared, point: Point) -> list[Experiment | Scenario]:
    """The scenarios that count in the objective or in a mean, and those that decide what is worst, in their order.

    Args:
        prepared: gives scenarios, objectives and constraints.
        point: of the space; it is run in all scenarios, those for the best among them, if there are several.

    Raises:
        KeyboardInterrupt: interrupted.
    """
    scenarios, space = [*prepared.scenarios, *prepared.stress], prepared.problem.space
    if len(scenarios) <= HARDEST:
        return scenarios
    result = run_pairs(space.keys, [space.parameters(point)], scenarios)
    completed = result.outcomes[0] == "completed"
    chosen = set[int]()
    bounded = [(constraint.statistic, constraint.at_least) for constraint in prepared.constraints]
    for statistic, at_least in [(objective, None) for objective in prepared.problem.objectives] + bounded:
        if not isinstance(statistic, Statistic):
            continue
        counted = [index for index, scenario in enumerate(scenarios) if counts(statistic, scenario)]
        if statistic.kind == "worst" and at_least is not None:
            values = result.metrics[statistic.metric][0]
            ran = [index for index in counted if completed[index]]
            counted = sorted(ran, key=lambda index: values[index], reverse=not at_least)[:HARDEST]
        chosen.update(counted)
    return [scenarios[index] for index in sorted(chosen)]
