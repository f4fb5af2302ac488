"""The machines on which the stability margins of candidates are looked at: the nominal one, and drawn ones."""

from collections.abc import Sequence

from dualwinch.simulation.analysis.worst_margins import MarginSurvey
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.problem import Problem

HARDEST = 2
"""Drawn machines on which every candidate is looked at: those on which the start has the least margins."""

MACHINES = 32
"""Drawn machines on which candidates are looked at where they are chosen and scored, vertices first."""


def survey(
    problem: Problem,
    scenarios: Sequence[Experiment | Scenario],
    threads: int | None = None,
    *,
    experiment: Experiment | None = None,
) -> MarginSurvey | None:
    """The nominal machine and those of some scenarios; ``None`` where no margin is bounded.

    Args:
        problem: says what is bounded and what varies.
        scenarios: drawn machines, `MACHINES` of which are taken.
        threads: default: one a core.
        experiment: with another controller than the problem's, whose gains do not vary.
    """
    if not problem.margins:
        return None
    machines = [experiment or problem.experiment, *taken(scenarios)]
    return MarginSurvey(machines, () if experiment else problem.space.keys, threads)


def taken(scenarios: Sequence[Experiment | Scenario]) -> list[Scenario]:
    """The scenarios whose machines are looked at: the first `MACHINES`, vertices before draws."""
    drawn = [scenario for scenario in scenarios if isinstance(scenario, Scenario)]
    return sorted(drawn, key=lambda scenario: not scenario.vertex)[:MACHINES]


def hardest_machines(
    problem: Problem, scenarios: Sequence[Experiment | Scenario], threads: int | None = None
) -> list[int]:
    """Indices of the scenarios on whose machines the start has the least margins, of any kind that is bounded."""
    drawn = [index for index, scenario in enumerate(scenarios) if isinstance(scenario, Scenario)]
    if not (problem.margins and drawn):
        return []
    looked_at = MarginSurvey([scenarios[index] for index in drawn], problem.space.keys, threads)
    kinds = [statistic.margin for statistic in problem.margins]
    (found,) = looked_at.each([problem.space.parameters(problem.start)], kinds)
    least = {kind: min(of[kind].value for of in found) for kind in kinds}
    nearness = [min(of[kind].value / (least[kind] or 1.0) for kind in kinds) for of in found]
    order = sorted(range(len(drawn)), key=lambda index: nearness[index])
    chosen: dict[tuple[str, ...], int] = {}
    for index in order:  # vertices may differ in what no margin depends on: one of such twins is enough
        chosen.setdefault(tuple(f"{found[index][kind].value:.9g}" for kind in kinds), drawn[index])
    return list(chosen.values())[:HARDEST]


def machine_name(machine: Experiment | Scenario) -> str:
    """What a machine is called."""
    if not isinstance(machine, Scenario):
        return "the nominal machine"
    return f"{'vertex' if machine.vertex else 'draw'} {machine.index}"
