"""The gains that laws come with are by hand: a short search finds better ones."""

import pytest

from dualwinch.simulation.simulate import simulate
from dualwinch.tuning.tune import tune
from tests.studies import MakeProblem


@pytest.mark.parametrize(
    "kind", ["eid", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("lqi", "rbf-sliding-mode"))]
)
def test_tuning_improves_gains_by_hand(kind: str, make_problem: MakeProblem) -> None:
    problem = make_problem(
        ensemble=None,
        case=4,
        settings=["simulation.duration=5", f"controller.kind={kind}"],
        space=[f"controller.{kind.replace('-', '_')}"],
        constraints=["mean.chatter<=1.1*paper"],
    )
    tuned = tune(problem, trials=40)
    best, start = (simulate(experiment, stride=0).metrics for experiment in (tuned.best, problem.experiment))
    assert best.mse < start.mse / 2
