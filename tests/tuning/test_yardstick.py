from dataclasses import replace

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.estimators.kalman import Kalman
from dualwinch.controllers.estimators.low_pass import LowPass
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.nominal import Nominal
from dualwinch.simulation.ensembles.comparison import paper_controller
from dualwinch.tuning.baseline import baseline_controller, is_baseline


def test_the_yardstick_has_the_papers_gains_on_the_own_machine() -> None:
    preloaded = Controller(estimator=Kalman(), limits=Limits(preload=5e3), nominal=Nominal(mass=9e3))
    assert baseline_controller(preloaded) == replace(paper_controller(), nominal=Nominal(mass=9e3))
    stronger = replace(preloaded, limits=Limits(tension_max=9e3, preload=5e3))
    assert baseline_controller(stronger).limits == stronger.limits


def test_what_is_the_yardstick() -> None:
    assert is_baseline(paper_controller())
    assert is_baseline(replace(paper_controller(), estimator=LowPass(0.0)))
    assert not is_baseline(replace(paper_controller(), estimator=LowPass(0.01)))
    assert not is_baseline(replace(paper_controller(), limits=Limits(preload=5e3)))
