"""A search on ten computers, which differ in the last bit: the same trials, ranked alike, and the same choice."""

from dataclasses import replace

import numpy as np

import dualwinch as dw
from tests.last_bit import COMPUTERS, perturbed

SHORT = dw.override(dw.case(4), {"simulation.duration": 2.0})


def search(experiment: dw.Experiment) -> dw.TuningResult:
    """Three generations and a bit."""
    space = ["controller.nftsm.beta", "controller.nftsm.k", "controller.observer.l0"]
    return dw.tune(dw.tuning_problem(experiment, space=space, constraints=["worst.slack_share<=0"]), trials=50)


@COMPUTERS
def test_the_same_trials_are_ranked_alike_and_the_same_one_is_best(seeds: range) -> None:
    tuned = search(SHORT)
    errors = np.array([trial.objectives[0] for trial in tuned.trials])
    assert len(np.unique(errors)) > 40
    for seed in seeds:
        near = search(replace(perturbed(SHORT, seed), controller=SHORT.controller))
        assert near.verdict.best.number == tuned.verdict.best.number
        # generation by generation the search repeats what rounding moved, up to its condition number
        np.testing.assert_allclose([trial.objectives[0] for trial in near.trials], errors, rtol=1e-6)
        assert [trial.number for trial in near.trials] == [trial.number for trial in tuned.trials]
