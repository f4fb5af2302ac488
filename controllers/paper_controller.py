"""The paper's controller with the paper's gains, the baseline of comparisons."""

from dataclasses import replace

from dualwinch.codegen.text import enumeration
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.estimators.low_pass import LowPass
from dualwinch.controllers.estimators.unfiltered import Unfiltered
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.nominal import Nominal
from dualwinch.model.arguments import instance
from dualwinch.model.quantities.tree import leaves, with_leaves

DAMPINGS = tuple(f"winch_{number}.{gain}" for gain in ("damping", "lead") for number in (1, 2))
"""Keys of the drums' damping, which the paper does not have."""

UNFADED = 1e-3
"""Fade of a winch's gains below the shortest rope: without effect."""


def paper_controller(own: Controller | None = None) -> Controller:
    """The paper's controller with the paper's gains, for a machine.

    It has no estimator and no reserve. From the machine's own controller it takes the nominal model and the damping of
    the drums, on ropes of any length: the paper has none, and without it heavy drums oscillate until the run diverges.
    Where the tension limits differ from the paper's, it takes these and the preload, on which the paper's gains do not
    depend.

    Args:
        own: the controller of the machine; default: the paper's machine.

    Raises:
        ConfigurationError: `own` is no controller.

    Example:
        >>> import dualwinch as dw
        >>> dw.paper_controller().law.kind
        'fando-nftsm'
    """
    paper = Controller(estimator=Unfiltered())
    if own is None:
        return paper
    instance("own", own, Controller, hint=" (of an experiment: experiment.controller)")
    limits = paper.limits
    if _strength(own.limits) != _strength(limits):
        limits = replace(own.limits, reserve=limits.reserve)
    values = leaves(own)
    damping = {key: values[key] for key in DAMPINGS if key in values}
    return _damped_throughout(replace(with_leaves(paper, damping), nominal=own.nominal, limits=limits))


def has_paper_gains(own: Controller) -> bool:
    """Whether a controller is the paper's with the paper's gains; a low-pass with time constant 0 counts as none."""
    paper = paper_controller(own)
    return own.estimator in (paper.estimator, LowPass(0.0)) and (
        _damped_throughout(replace(own, estimator=paper.estimator)) == paper
    )


def adapted(paper: Controller) -> str:
    """Elements that `paper_controller` took from the machine's own controller, in words; empty without any."""
    values, words = leaves(paper), []
    if paper.nominal != Nominal():
        words.append("nominal model")
    if any(values.get(key) for key in DAMPINGS):
        words.append("damping of drums")
    if _strength(paper.limits) != _strength(Limits()):
        words += ["tension limits", "preload"]
    return enumeration(words)


def _damped_throughout(controller: Controller) -> Controller:
    """A controller whose damping of the drums, if any, acts on ropes of any length."""
    values = leaves(controller)
    damped = (key.partition(".")[0] for key in DAMPINGS if values.get(key))
    return with_leaves(controller, {f"{winch}.fade": UNFADED for winch in damped})


def _strength(limits: Limits) -> tuple[float, float]:
    return limits.tension_min, limits.tension_max
