"""Gradient steps: the model's minimum within box and constraints, and few rollouts to a good point."""

import numpy as np
import pytest

from tests.tuning.conftest import MakeProblem
from tuning.optimisers.gradient import Model, step
from tuning.tune import tune

BOWL = Model(np.array([-1.0, 0.0]), np.diag([2.0, 2.0]), np.empty(0), np.empty((0, 2)))
"""x² − x + y²: the minimum lies at (0.5, 0)."""


def test_the_step_is_the_models_minimum_within_box_and_cube() -> None:
    centre = np.array([0.3, 0.5])
    assert step(BOWL, centre, 0.6) == pytest.approx([0.5, 0], abs=1e-6)
    assert step(BOWL, centre, 0.1) == pytest.approx([0.1, 0], abs=1e-6)
    assert step(BOWL, np.array([0.8, 0.5]), 0.6) == pytest.approx([0.2, 0], abs=1e-6)


def test_a_constraint_is_kept_to_and_one_out_of_reach_is_violated_least() -> None:
    centre = np.array([0.3, 0.5])
    wall = Model(BOWL.slope, BOWL.curvature, np.array([-0.2]), np.array([[1.0, 0.0]]))
    assert step(wall, centre, 0.6) == pytest.approx([0.2, 0], abs=1e-6)
    beyond = Model(BOWL.slope, BOWL.curvature, np.array([1.0]), np.array([[0.0, 1.0]]))
    assert step(beyond, centre, 0.1) == pytest.approx([0.1, -0.1], abs=1e-6)


def test_few_steps_beat_many_random_candidates(make_problem: MakeProblem) -> None:
    problem = make_problem(
        ensemble=None,
        case=4,
        assignments=["simulation.duration=3"],
        space=["controller.nftsm.beta", "controller.observer.l0", "controller.observer.kf"],
        constraints=["worst.peak_tension<=6000"],
    )
    stepped, drawn = tune(problem, method="gradient", trials=24), tune(problem, method="random", trials=200)
    assert stepped.verdict.best.feasible
    assert stepped.verdict.best.objectives[0] < drawn.verdict.best.objectives[0]


def test_steps_go_on_along_a_curved_constraint(make_problem: MakeProblem) -> None:
    """Chatter is curved over the gains: without its correction every step that helps is refused at 5.1e-9 m²."""
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
    assert best.objectives[0] < 1e-9
