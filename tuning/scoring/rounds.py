"""The scenarios in which the best is chosen, round by round; no search has seen them."""

from dataclasses import replace

from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.problem import SELECTION, Problem
from dualwinch.tuning.scoring.exact import every_second_exact
from dualwinch.tuning.scoring.plan import Plan
from dualwinch.tuning.scoring.scenarios import choosable, demanding, drawn, overwhelming, vertices


def to_choose_in(problem: Problem, plan: Plan) -> tuple[list[Scenario], list[Scenario], list[Scenario]]:
    """Scenarios to choose in, of both rounds, and overwhelming ones.

    Draws (`choosable`), to the first of which hard ones and vertices come.
    """
    if problem.ensemble is None:
        raise ValueError("only an ensemble has scenarios to choose in")
    ensemble = replace(problem.ensemble, experiment=problem.experiment)
    seed, drawn_before = problem.seed + SELECTION, plan.draws + plan.last_draws
    corners = vertices(ensemble, plan.vertices, seed)
    further = range(drawn_before, drawn_before + plan.looked_at)
    picks = [*demanding(ensemble, plan.hard, further, seed), *corners]
    draws = list(ensemble.scenarios(drawn_before, seed))
    first = [*drawn(picks, ensemble, seed), *choosable(draws[: plan.draws])]
    beyond = drawn(overwhelming(ensemble, seed, corners), ensemble, seed)
    return first, choosable(every_second_exact(draws[plan.draws :])), beyond


def unseen(problem: Problem, plan: Plan) -> list[Scenario]:
    """Draws behind all those in which the best is chosen; none without an ensemble."""
    if problem.ensemble is None:
        return []
    before = plan.draws + plan.last_draws + plan.looked_at
    ensemble = replace(problem.ensemble, experiment=problem.experiment)
    return ensemble.chosen(range(before, before + plan.confirmed), problem.seed + SELECTION)
