"""What a tuning problem takes where nothing is asked for, and what it refuses before anything runs."""

from pathlib import Path
from typing import Any

import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.tuning_problem import tuning_problem

SHORT: dict[str, Any] = {"settings": ["simulation.duration=1.0"], "space": ["controller.nftsm.beta"]}


def test_a_file_that_names_no_estimator_takes_that_of_the_ensemble(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("[plant.vehicle]\nmass = 12000.0\n")
    problem = tuning_problem(config=mine, ensemble="rig", **SHORT)
    assert problem.experiment.controller.estimator.kind == "self-calibrating-kalman"
    assert problem.experiment.plant.vehicle.mass == 12000.0
    (words,) = problem.choices
    assert words.startswith("estimator self-calibrating-kalman: none is named, and in 'rig'")
    mine.write_text('[controller]\nestimator = "lowpass"\n')
    named = tuning_problem(config=mine, ensemble="rig", **SHORT)
    assert named.experiment.controller.estimator.kind == "lowpass"
    assert named.choices == ()
    asked = tuning_problem(ensemble="sea", settings=["controller.estimator=kalman"], space=SHORT["space"])
    assert (asked.experiment.controller.estimator.kind, asked.choices) == ("kalman", ())


@pytest.mark.parametrize("words", [{"objectives": ["mean.steady_mse"]}, {"constraints": ["mean.steady_mae<=0.01"]}])
def test_what_no_run_has_is_refused(words: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError, match=r"steady_\w+: no run has it: the steady state begins at 18 s"):
        tuning_problem(case=4, **SHORT, **words)
