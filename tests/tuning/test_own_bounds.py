"""Bounds that follow what they depend on, and a machine that is not the paper's."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import pytest

import dualwinch as dw
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.laws.adrc import Adrc
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Quantity, Tunable
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.space import ContinuousDimension, own_bounds, space_of
from tests.studies import FEW
from tests.tiers import mostly_slow

PRELOAD = "controller.coordination.preload"
FERRY = {
    "plant.track.length": 120,
    **{f"plant.rope_{rope}.area": 2e-4 for rope in (1, 2)},
    **{f"plant.rope_{rope}.modulus": 9e10 for rope in (1, 2)},
    "plant.vehicle.mass": 4e4,
    "controller.coordination.tension_min": 800,
    "controller.coordination.tension_max": 24000,
    PRELOAD: 15000,
}
"""A machine of 120 m with other ropes, a heavier vehicle and stronger winches."""


def bounds(name: str, experiment: Experiment) -> tuple[float, float]:
    (dimension,) = space_of({name: {}}, experiment).dimensions
    assert isinstance(dimension, ContinuousDimension)
    return dimension.lower, dimension.upper


@pytest.mark.parametrize(
    ("name", "values", "before", "after"),
    [
        (PRELOAD, {"controller.coordination.tension_min": 300}, (800, 10000), (1200, 10000)),
        (PRELOAD, {"controller.coordination.tension_max": 12000}, (800, 10000), (800, 20000)),
        ("controller.coordination.reserve", {"controller.coordination.tension_max": 12000}, (0, 700), (0, 1400)),
        ("controller.auxiliary.gamma", {"plant.vehicle.mass": 4e4}, (1e-8, 1e-3), (2.5e-9, 2.5e-4)),
        ("controller.winch.kp", {"plant.winch_1.drum_radius": 1.6}, (1e-5, 1e-2), (2e-5, 2e-2)),
        ("controller.winch_2.ki", {"plant.winch_2.gear_ratio": 18.0}, (1e-3, 1.0), (2e-3, 2.0)),
        ("controller.winch_1.ki", {"plant.winch_2.gear_ratio": 18.0}, (1e-3, 1.0), (1e-3, 1.0)),
        ("controller.nftsm.beta", FERRY, (0.005, 5.0), (0.005, 5.0)),
    ],
)
def test_bounds_follow_the_machine(
    name: str, values: dict[str, float], before: tuple[float, float], after: tuple[float, float]
) -> None:
    assert bounds(name, dw.case(4)) == before
    assert bounds(name, dw.override(dw.case(4), values)) == pytest.approx(after, rel=1e-12)


@pytest.mark.parametrize("kind", ["master-slave", "force-position"])
def test_bounds_of_other_coordinations_follow_the_winches(kind: str) -> None:
    name = {"master-slave": "controller.master_slave.kp", "force-position": "controller.force_position.band"}[kind]
    experiment = dw.override(dw.case(4), {"controller.coordination.kind": kind})
    lower, upper = bounds(name, experiment)
    stronger = dw.override(experiment, {"controller.coordination.tension_max": 9000})
    assert bounds(name, stronger) == pytest.approx((1.5 * lower, 1.5 * upper))


def test_own_bounds_hold_the_gains_own_value_and_given_ones_do_not() -> None:
    wide = dw.override(dw.case(4), {"controller.nftsm.beta": 50, "controller.winch_1.kd": 1e-4})
    assert bounds("controller.nftsm.beta", wide) == (0.005, 50)
    assert bounds("controller.winch.kd", wide) == (0, 5e-5)
    assert bounds("controller.nftsm.eta", dw.override(wide, {"controller.nftsm.eta": 0})) == (0.005, 50)
    with pytest.raises(ConfigurationError, match=r"infeasible start: controller\.nftsm\.beta = 50 is outside"):
        dw.tuning_problem(experiment=wide, space=["controller.nftsm.beta=0.005:5:log"])


def test_scaled_bounds_stay_within_the_range_of_the_gain() -> None:
    known = Tunable(0.1, 0.6, log=False, of="plant.vehicle.mass")
    experiment = dw.override(dw.case(4), {"plant.vehicle.mass": 2e4, "controller.estimator": "kalman"})
    assert own_bounds(["controller.kalman.ramp"], known, experiment) == (0.0, 0.7)


@pytest.mark.parametrize(
    ("kind", "estimator"),
    mostly_slow(
        [("fando-nftsm", "calibrating-kalman"), ("pid-cascade", "lowpass"), ("adrc", "lowpass")],
        lambda row: row[0] == "fando-nftsm",  # with the estimator of other studies of the sea
    ),
)
def test_another_machine_is_tuned_at_once(kind: str, estimator: str) -> None:
    ferry = dw.override(dw.case(4), FERRY | {"controller.kind": kind, "simulation.duration": 2.0})
    in_sea = dw.override(ferry, {"controller.estimator": estimator})
    for problem in (
        dw.tuning_problem(experiment=ferry),
        dw.tuning_problem(experiment=in_sea, ensemble="sea", scenarios=2, options=FEW),
    ):
        problem.check()
        tuned = dw.tune(problem, trials=4, test_scenarios=2, method="tpe")
        assert tuned.trials[0].outcomes.keys() == {"completed"}
        assert tuned.best.plant.track.length == 120


def test_the_papers_gains_are_compared_within_the_limits_of_the_machine() -> None:
    ferry = dw.tuning_problem(experiment=dw.override(dw.case(4), FERRY)).paper_experiment
    assert ferry.controller.limits == dw.override(dw.case(4), FERRY).controller.limits
    assert ferry.controller.law == dw.paper_controller().law
    papers = dw.tuning_problem(experiment=dw.override(dw.case(4), {PRELOAD: 3000})).paper_experiment
    assert papers.controller == dw.paper_controller()


@dataclass(frozen=True)
class Lost(Adrc):
    own: Annotated[float, Quantity("1", "factor"), Tunable(1, 2, of="plant.vehicle.mas")] = 1.0
    kind: ClassVar = "lost"


def test_bounds_that_follow_nothing_are_one_line() -> None:
    class Law(Lost):
        def step(self, state, estimate, setpoint, context):
            following, output = super().step(state, estimate, setpoint, context)
            return following, replace(output, u=self.own * output.u)

    experiment = replace(dw.case(4), controller=Controller(law=Law()))
    with pytest.raises(ConfigurationError) as caught:
        space_of({"controller.lost.own": {}}, experiment)
    assert str(caught.value).startswith(
        "space: controller.lost.own: its bounds follow 'plant.vehicle.mas', which is no number with a default; "
        "did you mean 'plant.vehicle.mass'?"
    )
