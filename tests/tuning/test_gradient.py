"""Gradient steps: the model's minimum within box and constraints, and few rollouts to a good point."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.tuning.constraint import Constraint
from dualwinch.tuning.optimisers.gradient import Gradient
from dualwinch.tuning.optimisers.linearise import linearise
from dualwinch.tuning.optimisers.local_model import Model, closeness, level, linear_step, merit, quadratic_step
from dualwinch.tuning.problem import Problem
from dualwinch.tuning.scoring.evaluate import FAILED, Evaluator
from dualwinch.tuning.scoring.evaluation import Candidate, Evaluation
from dualwinch.tuning.scoring.statistic import statistic_from
from dualwinch.tuning.space import Point
from dualwinch.tuning.tune import tune
from tests.tuning.conftest import MakeProblem

BOWL = Model(np.array([-1.0, 0.0]), np.diag([2.0, 2.0]), np.empty(0), np.empty((0, 2)), np.empty(0, int))
"""x² − x + y²: the minimum lies at (0.5, 0)."""


def test_the_step_is_the_models_minimum_within_box_and_cube() -> None:
    centre = np.array([0.3, 0.5])
    assert quadratic_step(BOWL, centre, 0.6) == pytest.approx([0.5, 0], abs=1e-6)
    assert quadratic_step(BOWL, centre, 0.1) == pytest.approx([0.1, 0], abs=1e-6)
    assert quadratic_step(BOWL, np.array([0.8, 0.5]), 0.6) == pytest.approx([0.2, 0], abs=1e-6)


def test_a_constraint_is_kept_to_and_one_out_of_reach_is_violated_least() -> None:
    centre = np.array([0.3, 0.5])
    wall = Model(BOWL.slope, BOWL.curvature, np.array([-0.2]), np.array([[1.0, 0.0]]), np.zeros(1, int))
    assert quadratic_step(wall, centre, 0.6) == pytest.approx([0.2, 0], abs=1e-6)
    beyond = Model(BOWL.slope, BOWL.curvature, np.array([1.0]), np.array([[0.0, 1.0]]), np.zeros(1, int))
    assert quadratic_step(beyond, centre, 0.1) == pytest.approx([0.1, -0.1], abs=1e-6)


@pytest.fixture
def gentle(make_problem: MakeProblem) -> Problem:
    """Three gains, no constraint near; more than one minimum."""
    return make_problem(
        ensemble=None,
        case=4,
        assignments=["simulation.duration=3"],
        space=["controller.nftsm.beta", "controller.observer.l0", "controller.observer.kf"],
        constraints=["worst.peak_tension<=6000"],
    )


def test_few_steps_lead_to_a_minimum(gentle: Problem) -> None:
    best = tune(gentle, method="gradient", trials=24).verdict.best
    assert best.feasible
    share, moves = gentle.space.encoded(best.point), 0.01 * np.vstack([np.eye(3), -np.eye(3)])
    nearby = [Candidate(gentle.space.decoded(point), "") for point in np.clip(share + moves, 0, 1)]
    around = Evaluator(gentle).over(nearby, gentle.tuning_scenarios)
    assert min(one.objectives[0] for one in around) >= best.objectives[0] * (1 - 1e-9)


def test_after_a_minimum_others_are_looked_for(gentle: Problem) -> None:
    trials = tune(gentle, method="gradient", trials=100).trials
    values, points = (
        [one.objectives[0] for one in trials],
        np.array([gentle.space.encoded(one.point) for one in trials]),
    )
    place = int(np.argmin(values[:30]))
    assert values[place] < 1.1 * min(values)  # a later minimum may be better by little
    assert (np.ptp(points[place + 1 :], axis=0) > 0.8).all()
    assert min(values[place + 30 :]) < 1.1 * values[place]


def test_the_slopes_of_a_chaotic_run_are_no_guide(gentle: Problem) -> None:
    chaotic: Point = {"controller.nftsm.beta": 2.1, "controller.observer.l0": 90.0, "controller.observer.kf": 40.0}
    model = linearise(gentle, chaotic)
    assert np.abs(model.slope).max() < 1e6
    assert np.abs(linear_step(model, gentle.space.encoded(chaotic), 0.1)).max() <= 0.1


def test_linear_steps_end_in_a_corner_and_keep_what_constraints_they_can() -> None:
    centre = np.array([0.3, 0.5])
    slope = Model(np.array([-1.0, -0.1]), np.zeros((2, 2)), np.empty(0), np.empty((0, 2)), np.empty(0, int))
    assert linear_step(slope, centre, 0.2) == pytest.approx([0.2, 0.2])
    assert linear_step(slope, np.array([0.9, 0.5]), 0.2) == pytest.approx([0.1, 0.2])
    wall = replace(slope, violations=np.array([-0.3]), slopes=np.array([[1.0, 1.0]]))
    assert linear_step(wall, centre, 0.2) == pytest.approx([0.2, 0.1])
    beyond = replace(slope, violations=np.array([1.0]), slopes=np.array([[1.0, 0.0]]))
    assert linear_step(beyond, centre, 0.2) == pytest.approx([-0.2, 0.2])


def test_steps_go_on_along_a_curved_constraint(make_problem: MakeProblem) -> None:
    """Chatter is curved over the gains: from 5.3e-6 m² to where a thousand trials of other methods end."""
    gains = [f"controller.nftsm.{name}" for name in ("beta", "eta", "k", "phi")]
    problem = make_problem(
        ensemble=None,
        case=4,
        assignments=[],
        space=[*gains, "controller.observer.l0", "controller.observer.kf"],
        constraints=["mean.chatter<=1*paper"],
        seed=2,
    )
    best = tune(problem, method="gradient", trials=60).verdict.best
    assert best.feasible
    assert best.objectives[0] < 2e-11


def test_violations_of_upper_bounds_are_logarithms_near_the_bound() -> None:
    upper = Constraint("", statistic_from("worst.peak_tension"), at_least=False, bound=6000.0)
    assert closeness(upper, upper.violation(7500.0)) == pytest.approx((np.log(1.25), 1 / 1.25))
    assert closeness(upper, -0.95) == (-0.95, 1.0)
    lower = Constraint("", statistic_from("worst.min_tension"), at_least=True, bound=80.0)
    assert closeness(lower, 0.5) == (0.5, 1.0)


def test_the_merit_weighs_error_and_violation_and_knows_failures() -> None:
    bound = Constraint("", statistic_from("worst.peak_tension"), at_least=False, bound=6000.0)

    def evaluated(violation: float, failed: float = 0.0) -> Evaluation:
        violations = {FAILED: failed, bound.label: violation}
        return Evaluation(Candidate({}, ""), (1e-8,), violations, {}, {}, 1)

    assert merit(evaluated(-0.5), (bound,), 100.0) == pytest.approx(np.log(1e-8))
    assert merit(evaluated(0.01), (bound,), 100.0) == pytest.approx(np.log(1e-8) + 100 * np.log(1.01))
    assert merit(evaluated(-0.5, failed=0.25), (bound,), 100.0) == np.inf
    assert level(-np.e) == pytest.approx(-1.0)


def test_where_a_start_fails_scouts_are_sent_out(gentle: Problem) -> None:
    method = Gradient(gentle, 0)
    (start,) = method.ask(16)
    violations = {FAILED: 1.0} | {one.label: 0.0 for one in gentle.bounded}
    method.tell([Evaluation(Candidate(start, ""), (1e9,), violations, {}, {"diverged": 1}, 1)])
    assert len(method.ask(16)) == 16
    assert method.gradients == 0


def test_the_default_method_takes_gradient_steps_first_in_one_scenario(gentle: Problem) -> None:
    best = tune(gentle, trials=24).verdict.best
    assert best.candidate.origin == "hybrid"
    assert best.objectives == tune(gentle, method="gradient", trials=24).verdict.best.objectives
