from dataclasses import replace

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.estimators.kalman import Kalman
from dualwinch.controllers.estimators.low_pass import LowPass
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.nominal import Nominal
from dualwinch.controllers.paper_controller import adapted, has_paper_gains, paper_controller
from dualwinch.model.quantities.tree import leaves, with_leaves


def test_for_a_machine_it_has_the_papers_gains_and_the_machines_limits() -> None:
    preloaded = Controller(estimator=Kalman(), limits=Limits(preload=5e3), nominal=Nominal(mass=9e3))
    assert paper_controller(preloaded) == replace(paper_controller(), nominal=Nominal(mass=9e3))
    stronger = replace(preloaded, limits=Limits(tension_max=9e3, preload=5e3))
    assert paper_controller(stronger).limits == stronger.limits


def test_which_controllers_have_the_papers_gains() -> None:
    assert has_paper_gains(paper_controller())
    assert has_paper_gains(replace(paper_controller(), estimator=LowPass(0.0)))
    assert not has_paper_gains(replace(paper_controller(), estimator=LowPass(0.01)))
    assert not has_paper_gains(replace(paper_controller(), limits=Limits(preload=5e3)))


def test_heavy_drums_are_damped_as_the_machines_are() -> None:
    own = with_leaves(Controller(), {"winch_1.damping": 200.0, "winch_2.damping": 200.0, "winch_1.lead": 2e-3})
    paper = leaves(paper_controller(own))
    assert [paper[f"winch_1.{gain}"] for gain in ("damping", "lead")] == [200, 2e-3]
    assert adapted(paper_controller(own)) == "damping of drums"
    assert adapted(paper_controller()) == ""
    stronger = paper_controller(replace(own, limits=Limits(tension_max=9e3)))
    assert adapted(stronger) == "damping of drums, tension limits and preload"


def test_its_nominal_plant_is_stated() -> None:
    own = Controller(nominal=Nominal(mass=9e3))
    assert adapted(paper_controller(own)) == "nominal model"
    damped = with_leaves(own, {"winch_1.damping": 200.0, "winch_2.damping": 200.0})
    assert adapted(paper_controller(damped)) == "nominal model and damping of drums"
