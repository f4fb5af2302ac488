"""Every optimiser: within the space, reproducible, better than where it started, and led by constraints."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.tuning.optimisers import METHODS, optimiser
from dualwinch.tuning.optimisers.cma import CmaSearch
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation, feasibility_first, merit
from dualwinch.tuning.scoring.training_set import TrainingSet, prepare
from dualwinch.tuning.space import Point
from tests.studies import MakeProblem

AVAILABLE = [method for method in METHODS if method != "gp"]  # gp needs PyTorch


def bowl(prepared: TrainingSet, point: Point, objectives: int = 1) -> Evaluation:
    """A bowl with its bottom at 0.7 of every range, of which only the part with a first share <= 0.6 is allowed."""
    shares = prepared.problem.space.encoded(point)
    height = float(((shares - 0.7) ** 2).sum())
    values = (height, float(shares[1]))[:objectives]
    violations = {prepared.constraints[0].label: float(shares[0] - 0.6)}
    return Evaluation(Candidate(point, ""), values, violations, {}, {}, 1)


def run(prepared: TrainingSet, method: str, batches: int, seed: int = 0) -> list[Evaluation]:
    proposer, done = optimiser(method, prepared, seed), []
    for _ in range(batches):
        fresh = [bowl(prepared, point, len(prepared.problem.objectives)) for point in proposer.ask(16)]
        proposer.tell(fresh)
        done += fresh
    return done


@pytest.mark.parametrize("method", AVAILABLE)
def test_candidates_are_within_the_space_and_reproducible(method: str, make_problem: MakeProblem) -> None:
    gains = ["controller.nftsm.beta", "controller.nftsm.p/q", "controller.winch.kp"]
    prepared = prepare(make_problem(space=gains))
    found = [trial.point for trial in run(prepared, method, 3)]
    assert all(
        dimension.holds(point[dimension.name]) for point in found for dimension in prepared.problem.space.dimensions
    )
    assert [trial.point for trial in run(prepared, method, 3)] == found
    assert [trial.point for trial in run(prepared, method, 3, seed=1)] != found


@pytest.mark.parametrize(("method", "batches", "reached"), [("cmaes", 40, 0.0102), ("tpe", 20, 0.02)])
def test_the_bottom_is_found_where_the_constraint_allows(
    method: str, batches: int, reached: float, make_problem: MakeProblem
) -> None:
    """The allowed minimum is (0.6 − 0.7)² = 0.01, on the constraint."""
    done = run(prepare(make_problem()), method, batches)
    best = done[feasibility_first(done)[0]]
    assert best.feasible
    assert 0.01 <= best.objectives[0] < reached


def test_a_strategy_that_stops_begins_again_at_its_best(make_problem: MakeProblem) -> None:
    prepared = prepare(make_problem())
    trials = run(prepared, "cmaes", 200)
    shares = np.array([prepared.problem.space.encoded(trial.point) for trial in trials])
    batches = np.split(shares, 200)
    spreads = np.array([batch.std(axis=0).mean() for batch in batches])
    calm = int(np.flatnonzero(spreads < 1e-3)[0])
    restart = calm + int(np.flatnonzero(spreads[calm:] > 0.05)[0])
    leader = min(trials[: 16 * restart], key=merit)
    centre = batches[restart].mean(axis=0)
    assert np.abs(centre - prepared.problem.space.encoded(leader.point)).max() < 0.15


def test_the_evolution_strategy_learns_the_same_from_a_storage(make_problem: MakeProblem) -> None:
    """What it has learned is a function of the trials alone, so a resumed study goes on where it was."""
    prepared = prepare(make_problem())
    problem, done = prepared.problem, run(prepared, "cmaes", 8)
    resumed = CmaSearch(prepared, 5)
    resumed.tell(done)
    points = np.array([problem.space.encoded(point) for point in resumed.ask(64)])
    best = problem.space.encoded(done[feasibility_first(done)[0]].point)
    assert np.abs(points.mean(axis=0) - best).max() < 0.15


def test_several_objectives_have_their_methods(make_problem: MakeProblem) -> None:
    prepared = prepare(make_problem(objectives=["mean.mse", "mean.chatter"]))
    assert len({trial.objectives for trial in run(prepared, "nsga2", 3)}) == 48
    with pytest.raises(Exception, match="takes a single objective; use nsga2"):
        optimiser("cmaes", prepared, 0)
    with pytest.raises(Exception, match=r"--method simplex: .*; must be one of cmaes, tpe"):
        optimiser("simplex", prepared, 0)


def test_where_the_start_leads_the_first_generation_is_drawn_again_nearer_to_it(make_problem: MakeProblem) -> None:
    prepared = prepare(make_problem())
    space, problem = prepared.problem.space, prepared.problem

    def distances(height: float) -> list[float]:
        """Median distances from the start of three generations, where the start has an objective of its own."""
        proposer, medians = CmaSearch(prepared, 0), []
        start = replace(bowl(prepared, problem.start), objectives=(height,), violations={})
        for generation in range(3):
            trials = [bowl(prepared, point) for point in proposer.ask(15 if generation == 0 else 16)]
            proposer.tell([*([start] if generation == 0 else []), *trials])
            away = [np.abs(space.encoded(each.point) - space.encoded(problem.start)).max() for each in trials]
            medians.append(float(np.median(away)))
        return medians

    narrow, wide = distances(1e-9), distances(1e9)
    assert narrow[1] < 0.5 * narrow[0]
    assert narrow[2] < 0.5 * narrow[1]
    assert wide[0] == narrow[0]
    assert wide[1] > 0.5 * wide[0]
