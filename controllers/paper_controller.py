"""The paper's controller with the paper's gains, which others are compared with."""

from dataclasses import replace

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.estimators.low_pass import LowPass
from dualwinch.controllers.estimators.unfiltered import Unfiltered
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.nominal import Nominal
from dualwinch.model.arguments import instance
from dualwinch.model.quantities.tree import leaves, with_leaves

DAMPINGS = tuple(f"winch_{number}.{gain}" for gain in ("damping", "lead") for number in (1, 2))
"""Keys of the drums' damping, which the paper has not."""

UNFADED = 1e-3
"""Fade of a winch's gains that is below the shortest rope."""


def paper_controller(own: Controller | None = None) -> Controller:
    """The paper's controller with the paper's gains, for a machine.

    It sees the sensors as they are, and never keeps a reserve. For the machine of another controller it believes of the
    plant what that one does, and has that one's damping of the drums, on ropes of any length: the paper has none, and
    without it heavy drums swing until they are lost. Where the winches have other limits than the paper's it has
    those, and the other's preload: the paper's gains say nothing of how strong a machine is.

    Args:
        own: the controller of the machine; default: the paper's machine.

    Raises:
        ConfigurationError: it is none.
    """
    paper = Controller(estimator=Unfiltered())
    if own is None:
        return paper
    instance("own", own, Controller, hint=" (of an experiment: experiment.controller)")
    limits = paper.limits
    if _strength(own.limits) != _strength(limits):
        limits = replace(own.limits, reserve=limits.reserve)
    known = leaves(own)
    damping = {key: known[key] for key in DAMPINGS if key in known}
    return _damped_throughout(replace(with_leaves(paper, damping), nominal=own.nominal, limits=limits))


def has_paper_gains(own: Controller) -> bool:
    """Whether a controller is the paper's with the paper's gains.

    A low-pass without a time constant filters nothing, and is as good as none.
    """
    paper = paper_controller(own)
    return own.estimator in (paper.estimator, LowPass(0.0)) and (
        _damped_throughout(replace(own, estimator=paper.estimator)) == paper
    )


def adapted(paper: Controller) -> str:
    """What a paper's controller for a machine has of that machine's own controller, in words; empty: nothing."""
    known, words = leaves(paper), []
    if paper.nominal != Nominal():
        words.append("nominal model")
    if any(known.get(key) for key in DAMPINGS):
        words.append("damping of drums")
    if _strength(paper.limits) != _strength(Limits()):
        words += ["tension limits", "preload"]
    return " and ".join([*([", ".join(words[:-1])] if words[1:] else []), *words[-1:]])


def _damped_throughout(controller: Controller) -> Controller:
    """A controller whose winches, where they damp their drums, do so on ropes of any length."""
    known = leaves(controller)
    damped = (key.partition(".")[0] for key in DAMPINGS if known.get(key))
    return with_leaves(controller, {f"{winch}.fade": UNFADED for winch in damped})


def _strength(limits: Limits) -> tuple[float, float]:
    return limits.tension_min, limits.tension_max
