"""A tuning problem from Python: experiments and ensembles of one's own."""

from dataclasses import replace

import pytest

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.estimators.kalman import Kalman, KalmanGains
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.tuning.tuning_problem import tuning_problem
from tests.own_parts import StateFeedback

OWN = replace(case(4), controller=Controller(law=StateFeedback(bandwidth=6.0), estimator=Kalman(KalmanGains(ramp=0.2))))


def test_an_experiment_is_started_from_with_its_own_parts() -> None:
    problem = tuning_problem(OWN, settings=["simulation.duration=0.5"], space=["controller.state_feedback.bandwidth"])
    assert problem.experiment == override(OWN, {"simulation.duration": 0.5})
    assert problem.start == {"controller.state_feedback.bandwidth": 6.0}


def test_in_a_named_ensemble_it_keeps_its_controller() -> None:
    problem = tuning_problem(OWN, ensemble="sea", space=["controller.state_feedback.bandwidth"])
    assert problem.experiment.controller == OWN.controller
    assert problem.experiment.sensors == load_ensemble("sea").experiment.sensors


def test_an_ensemble_of_ones_own_is_taken_as_it_is() -> None:
    sea = load_ensemble("sea")
    calm = replace(sea, experiment=override(sea.experiment, {"simulation.duration": 3.0}))
    assert tuning_problem(ensemble=calm, settings=["controller.estimator=kalman"]).ensemble == replace(
        calm, experiment=override(calm.experiment, {"controller.estimator": "kalman"})
    )
    drawn = tuning_problem(OWN, ensemble=calm, space=["controller.state_feedback.bandwidth"]).ensemble
    assert drawn == replace(calm, experiment=replace(calm.experiment, controller=OWN.controller))


def test_a_start_is_given_once() -> None:
    with pytest.raises(ConfigurationError, match="experiment: give it alone, without case or config"):
        tuning_problem(OWN, case=4)
