"""The paper's gains, as what others are compared with."""

from dataclasses import replace

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.estimators.low_pass import LowPass
from dualwinch.controllers.limits import Limits
from dualwinch.simulation.ensembles.comparison import paper_controller


def yardstick(own: Controller) -> Controller:
    """The paper's controller with the paper's gains, for the machine that another one is for.

    Where the winches have other limits than the paper's it keeps to those, and has the other's preload: the paper's
    gains say nothing of how strong a machine is. It never keeps a reserve.
    """
    paper = paper_controller()
    limits = paper.limits
    if _strength(own.limits) != _strength(limits):
        limits = replace(own.limits, reserve=limits.reserve)
    return replace(paper, nominal=own.nominal, limits=limits)


def is_yardstick(own: Controller) -> bool:
    """Whether a controller is the paper's with the paper's gains.

    A low-pass without a time constant filters nothing, and is as good as none.
    """
    paper = yardstick(own)
    return own.estimator in (paper.estimator, LowPass(0.0)) and replace(own, estimator=paper.estimator) == paper


def _strength(limits: Limits) -> tuple[float, float]:
    return limits.tension_min, limits.tension_max
