"""The start of a search: the better of several; bounds of a machine of one's own are multiples of it."""

from dataclasses import replace

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.tuning.scoring.starts import prepare_best_start
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.tune import tune
from dualwinch.tuning.tuning_problem import tuning_problem
from tests.studies import MakeProblem

PRELOAD = "controller.coordination.preload"


def test_the_better_of_two_starts_begins(make_problem: MakeProblem) -> None:
    problem = make_problem(space=["controller.nftsm.beta"])
    mine = problem.experiment
    poor, good = (with_leaves(mine, {"controller.nftsm.beta": beta}).controller for beta in (0.01, 0.3))
    errors = [
        prepare(replace(each, starts=())).start.metrics["mse"].mean()
        for each in replace(problem, starts=(poor, good)).beginnings
    ]
    assert errors[2] < errors[0] < errors[1]
    assert prepare_best_start(replace(problem, starts=(poor,))).problem.experiment == mine
    best = prepare_best_start(replace(problem, starts=(poor, good)))
    assert leaves(best.problem.experiment)["controller.nftsm.beta"] == 0.3
    assert best.problem.ensemble is not None
    assert best.problem.ensemble.experiment == best.problem.experiment
    tuned = tune(replace(problem, starts=(good,)), trials=2)
    assert {trial.candidate.origin: trial.point for trial in tuned.trials}["start"] == {"controller.nftsm.beta": 0.3}


def test_in_an_ensemble_of_ones_own_chatter_and_load_are_bounded_by_the_starts() -> None:
    own = replace(load_ensemble("rig"), name="mine")
    labels = [bound.label for bound in tuning_problem(ensemble=own, settings=["simulation.duration=0.1"]).constraints]
    assert "mean.chatter <= 2 times the start's" in labels
    assert "mean.continuous_load <= 1.2 times the start's" in labels
    theirs = [bound.label for bound in tuning_problem(ensemble="rig").constraints]
    assert not any("start's" in label for label in theirs)
