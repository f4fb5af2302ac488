"""Gradient steps: the model's minimum within box and constraints, and few rollouts to a good point."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.simulation.ensembles.result import statistic_from
from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.optimisers.gradient import GradientSearch
from dualwinch.tuning.optimisers.linearise import linearise
from dualwinch.tuning.optimisers.local_model import (
    LocalModel,
    level,
    linear_step,
    merit,
    quadratic_step,
    scaled_violation,
)
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.evaluation import FAILED, Evaluator
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.training_set import TrainingSet, prepare
from dualwinch.tuning.space import Point
from dualwinch.tuning.tune import tune
from tests.studies import MakeProblem

BOWL = LocalModel(np.array([-1.0, 0.0]), np.diag([2.0, 2.0]), np.empty(0), np.empty((0, 2)), np.empty(0, int))
"""x² − x + y²: the minimum lies at (0.5, 0)."""


def test_the_step_is_the_models_minimum_within_box_and_cube() -> None:
    centre = np.array([0.3, 0.5])
    assert quadratic_step(BOWL, centre, 0.6) == pytest.approx([0.5, 0], abs=1e-6)
    assert quadratic_step(BOWL, centre, 0.1) == pytest.approx([0.1, 0], abs=1e-6)
    assert quadratic_step(BOWL, np.array([0.8, 0.5]), 0.6) == pytest.approx([0.2, 0], abs=1e-6)


def test_a_constraint_is_kept_to_and_one_that_is_too_far_is_violated_least() -> None:
    centre = np.array([0.3, 0.5])
    wall = LocalModel(BOWL.slope, BOWL.curvature, np.array([-0.2]), np.array([[1.0, 0.0]]), np.zeros(1, int))
    assert quadratic_step(wall, centre, 0.6) == pytest.approx([0.2, 0], abs=1e-6)
    beyond = LocalModel(BOWL.slope, BOWL.curvature, np.array([1.0]), np.array([[0.0, 1.0]]), np.zeros(1, int))
    assert quadratic_step(beyond, centre, 0.1) == pytest.approx([0.1, -0.1], abs=1e-6)


@pytest.fixture
def gentle(make_problem: MakeProblem) -> TuningProblem:
    """Three gains, no constraint near; more than one minimum."""
    return make_problem(
        ensemble=None,
        case=4,
        settings=["simulation.duration=3"],
        space=["controller.nftsm.beta", "controller.observer.l0", "controller.observer.kf"],
        constraints=["worst.peak_tension<=6000"],
    )


def is_a_minimum(prepared: TrainingSet, trial: Evaluation) -> bool:
    """Whether none of the points a hundredth of a range away is better."""
    space = prepared.problem.space
    share, moves = space.encoded(trial.point), 0.01 * np.vstack([np.eye(3), -np.eye(3)])
    nearby = [Candidate(space.decoded(point), "") for point in np.clip(share + moves, 0, 1)]
    around = Evaluator(prepared).over(nearby, prepared.scenarios)
    return min(neighbour.objectives[0] for neighbour in around) >= trial.objectives[0] * (1 - 1e-9)


def test_few_steps_lead_to_a_minimum(gentle: TuningProblem) -> None:
    tuned = tune(gentle, method="gradient", trials=24)
    assert tuned.verdict.best.feasible
    assert is_a_minimum(tuned.training, tuned.verdict.best)


def test_after_a_minimum_others_are_looked_for_in_all_of_the_space(gentle: TuningProblem) -> None:
    """There are several minima; one that is found later may be better by any factor, or worse."""
    prepared = prepare(gentle)
    method, evaluator = GradientSearch(prepared, gentle.seed), Evaluator(prepared)
    trials: list[Evaluation] = []

    def ask_and_tell() -> list[Evaluation]:
        found = evaluator.evaluate([Candidate(point, "") for point in method.ask(16)])
        method.tell(found)
        trials.extend(found)
        return found

    while not method.minima:
        ask_and_tell()
    assert trials.index(method.minima[0]) < 30
    assert is_a_minimum(prepared, method.minima[0])
    starts = ask_and_tell()
    assert len(starts) == 16
    assert (np.ptp([gentle.space.encoded(start.point) for start in starts], axis=0) > 0.8).all()
    while len(method.minima) < 2:
        ask_and_tell()
        assert len(trials) < 500
    feasible = [start.objectives[0] for start in starts if start.feasible]
    assert method.minima[1].objectives[0] < min(feasible)  # from the best of them it went down


def test_what_is_found_after_the_first_minimum_is_kept(gentle: TuningProblem) -> None:
    tuned = tune(gentle, method="gradient", trials=150)
    best = min(trial.objectives[0] for trial in tuned.trials if trial.feasible)
    assert tuned.verdict.best.objectives[0] == best
    assert min(trial.objectives[0] for trial in tuned.trials[:30]) >= best


def test_the_slopes_of_a_chaotic_run_are_no_guide(gentle: TuningProblem) -> None:
    chaotic: Point = {"controller.nftsm.beta": 2.1, "controller.observer.l0": 90.0, "controller.observer.kf": 40.0}
    prepared = prepare(gentle)
    model = linearise(prepared, prepared.scenarios, chaotic)
    assert np.abs(model.slope).max() < 1e6
    assert np.abs(linear_step(model, gentle.space.encoded(chaotic), 0.1)).max() <= 0.1


def test_linear_steps_end_in_a_corner_and_keep_what_constraints_they_can() -> None:
    centre = np.array([0.3, 0.5])
    slope = LocalModel(np.array([-1.0, -0.1]), np.zeros((2, 2)), np.empty(0), np.empty((0, 2)), np.empty(0, int))
    assert linear_step(slope, centre, 0.2) == pytest.approx([0.2, 0.2])
    assert linear_step(slope, np.array([0.9, 0.5]), 0.2) == pytest.approx([0.1, 0.2])
    wall = replace(slope, violations=np.array([-0.3]), slopes=np.array([[1.0, 1.0]]))
    assert linear_step(wall, centre, 0.2) == pytest.approx([0.2, 0.1])
    beyond = replace(slope, violations=np.array([1.0]), slopes=np.array([[1.0, 0.0]]))
    assert linear_step(beyond, centre, 0.2) == pytest.approx([-0.2, 0.2])


@pytest.mark.slow
def test_steps_go_on_along_a_curved_constraint(make_problem: MakeProblem) -> None:
    """Chatter is curved over the gains: from 5.3e-6 m² to where a thousand trials of other methods end."""
    gains = [f"controller.nftsm.{name}" for name in ("beta", "eta", "k", "phi")]
    problem = make_problem(
        ensemble=None,
        case=4,
        settings=[],
        space=[*gains, "controller.observer.l0", "controller.observer.kf"],
        constraints=["mean.chatter<=1*paper"],
        seed=2,
    )
    best = tune(problem, method="gradient", trials=60).verdict.best
    assert best.feasible
    assert best.objectives[0] < 2e-11


def test_violations_of_upper_bounds_are_logarithms_near_the_bound() -> None:
    upper = Constraint("", statistic_from("worst.peak_tension"), at_least=False, bound=6000.0)
    assert scaled_violation(upper, upper.violation(7500.0)) == pytest.approx((np.log(1.25), 1 / 1.25))
    assert scaled_violation(upper, -0.95) == (-0.95, 1.0)
    lower = Constraint("", statistic_from("worst.min_tension"), at_least=True, bound=80.0)
    assert scaled_violation(lower, 0.5) == (0.5, 1.0)


def test_the_merit_weighs_error_and_violation_and_knows_failures() -> None:
    bound = Constraint("", statistic_from("worst.peak_tension"), at_least=False, bound=6000.0)

    def evaluated(violation: float, failed: float = 0.0) -> Evaluation:
        violations = {FAILED: failed, bound.label: violation}
        return Evaluation(Candidate({}, ""), (1e-8,), violations, {}, {}, 1)

    assert merit(evaluated(-0.5), (bound,), 100.0) == pytest.approx(np.log(1e-8))
    assert merit(evaluated(0.01), (bound,), 100.0) == pytest.approx(np.log(1e-8) + 100 * np.log(1.01))
    assert merit(evaluated(-0.5, failed=0.25), (bound,), 100.0) == np.inf
    assert level(-np.e) == pytest.approx(-1.0)


def test_where_a_start_fails_scouts_are_sent_out(gentle: TuningProblem) -> None:
    prepared = prepare(gentle)
    method = GradientSearch(prepared, 0)
    (start,) = method.ask(16)
    violations = {FAILED: 1.0} | {constraint.label: 0.0 for constraint in prepared.constraints}
    method.tell([Evaluation(Candidate(start, ""), (1e9,), violations, {}, {"diverged": 1}, 1)])
    assert len(method.ask(16)) == 16
    assert method.gradients == 0


def test_the_default_method_takes_gradient_steps_first_in_one_scenario(gentle: TuningProblem) -> None:
    best = tune(gentle, trials=24).verdict.best
    assert best.candidate.origin == "hybrid"
    assert best.objectives == tune(gentle, method="gradient", trials=24).verdict.best.objectives
