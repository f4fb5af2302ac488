"""Search and steps in turns."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.ensembles.ensemble import Drawn, Uniform
from dualwinch.tuning.optimisers import compile_ahead, linearise
from dualwinch.tuning.optimisers import gradient as steps
from dualwinch.tuning.optimisers.gradient import GradientSearch
from dualwinch.tuning.optimisers.hybrid import HybridSearch
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation, feasibility_first
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.space import Point
from tests.studies import MakeProblem

BATCH = 16
"""What is asked for: a search proposes as many, steps fewer."""


def test_steps_go_on_from_the_search_and_the_search_around_where_they_led(make_problem: MakeProblem) -> None:
    prepared = prepare(make_problem())
    space, method, evaluator = prepared.problem.space, HybridSearch(prepared, 2), Evaluator(prepared)
    trials, turns = list[Evaluation](), list[tuple[int, float]]()
    bests, points = list[Evaluation](), list[Point]()
    while len(turns) < 3:
        points = method.ask(BATCH)
        if not turns or turns[-1][0] != len(points):
            spread = np.std([space.encoded(point) for point in points], axis=0).mean()
            turns.append((len(points), float(spread)))
            bests = [trials[index] for index in feasibility_first(trials)[:1]]
        found = evaluator.evaluate([Candidate(point, "") for point in points])
        method.tell(found)
        trials += found
        assert len(trials) < 1000
    assert [count for count, _ in turns] == [BATCH, 8, BATCH]
    assert method.rollouts > 0
    assert turns[2][1] < 0.1, "a small step of the search, around the best"
    (best,) = bests
    around = np.mean([space.encoded(point) for point in points], axis=0)
    assert np.abs(around - space.encoded(best.point)).max() < 0.1


def test_a_gradient_is_taken_once_at_a_point(make_problem: MakeProblem, monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps begin again at the point where they got no further: larger ones, by the model that is there."""
    prepared = prepare(make_problem())
    method, evaluator, points = GradientSearch(prepared, 1), Evaluator(prepared), list[Point]()
    whole = steps.linearise
    monkeypatch.setattr(
        steps, "linearise", lambda prepared, among, point: points.append(point) or whole(prepared, among, point)
    )
    asked = 0
    while not method.minima:
        found = evaluator.evaluate([Candidate(point, "") for point in method.ask(BATCH)])
        method.tell(found)
        asked += len(found)
        assert asked < 1000
    assert len(points) == len({tuple(point.items()) for point in points}) == method.gradients
    assert method.minima[0].point == points[-1]


@pytest.mark.parametrize("ensemble", ["sea", None])
def test_a_space_without_derivatives_is_searched_without_steps(ensemble: str | None, make_problem: MakeProblem) -> None:
    prepared = prepare(make_problem(ensemble=ensemble, space=["controller.nftsm.p/q"]))
    compile_ahead("hybrid", prepared.problem, prepared.scenarios[0])
    method, evaluator = HybridSearch(prepared, 1), Evaluator(prepared)
    for _ in range(10):
        method.tell(evaluator.evaluate([Candidate(point, "") for point in method.ask(BATCH)]))
    assert method.rollouts == 0
    with pytest.raises(ConfigurationError, match="--method gradient: --space must have a gain that is a continuous"):
        GradientSearch(prepared, 1)


GEAR = ("plant.winch_2.rotor_inertia=0.02", "plant.winch_2.gear_stiffness=1.4e6", "plant.winch_2.backlash=9e-4")


@pytest.mark.parametrize(
    ("settings", "guide"),
    [
        ((), True),
        (("plant.vehicle.bristle_stiffness=5e6",), False),
        (("plant.rope_1.hysteresis=7",), False),
        (GEAR[:2], True),
        (GEAR, False),
    ],
)
def test_a_plant_that_sticks_or_rattles_is_searched_without_steps(
    settings: tuple[str, ...], guide: bool, make_problem: MakeProblem
) -> None:
    method = ("simulation.integrator=verlet", "simulation.substeps=8") if settings else ()
    problem = make_problem(settings=["simulation.duration=0.1", *settings, *method])
    assert linearise.smooth(problem)
    assert linearise.gradients_guide(problem) is guide


def test_so_is_one_of_which_only_draws_stick(make_problem: MakeProblem) -> None:
    problem = make_problem()
    assert problem.ensemble is not None
    drawn = dict(problem.ensemble.distributions) | {"plant.rope_1.hysteresis": Drawn(Uniform(0.0, 7.0))}
    sticking = replace(problem, ensemble=replace(problem.ensemble, distributions=drawn))
    assert linearise.gradients_guide(problem)
    assert not linearise.gradients_guide(sticking)
