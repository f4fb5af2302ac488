"""The paper's four simulated cases, its three controllers, its figures, and Figure 21's reductions (Section 4)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from numbers import Integral

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.laws.nftsm import Nftsm
from dualwinch.controllers.laws.pid_cascade import PidCascade
from dualwinch.controllers.parts import Coordination, Estimator, PositionLaw
from dualwinch.controllers.registry import POSITION_LAWS
from dualwinch.model.actuators import Actuator, Ideal
from dualwinch.model.disturbance import Disturbance
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Reference
from dualwinch.model.ropes import RopeLaw
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metric import Metric
from dualwinch.simulation.metrics.metrics import Metrics

CASES = {
    1: "uniform speed, no disturbance",
    2: "profile, no disturbance",
    3: "uniform speed, vortex shedding",
    4: "profile, vortex shedding",
}
"""Case number → description."""

CONTROLLERS = {law.kind: law.label for law in (FandoNftsm, Nftsm, PidCascade)}
"""The paper's controllers: `controller.kind` → its name in figures and tables (Table 2)."""

REDUCTIONS = {"mae": -0.76, "max_abs_error": -0.67, "mse": -0.935}
"""Figure 21: relative change of the steady-state errors due to the observer in Case 4, as the paper reports it."""


@dataclass(frozen=True)
class PaperFigure:
    """One figure of the paper: its number, case and content."""

    number: int
    case: int
    content: str


CONTENTS = {
    "trajectory": "tracking trajectory",
    "error": "tracking error",
    "commands": "force commands of the coordination",
    "tensions": "rope tensions",
}
"""The four figures of a case and their titles, in the paper's order."""

FIGURES = tuple(
    PaperFigure(number, case, content) for number, (case, content) in enumerate(product(CASES, CONTENTS), start=5)
)
"""Figures 5 to 20; Figure 21 compares two controllers."""


def case(
    number: int,
    controller: str = FandoNftsm.kind,
    *,
    law: PositionLaw | None = None,
    estimator: Estimator | None = None,
    coordination: Coordination | None = None,
    rope: RopeLaw | None = None,
    actuator: Actuator | None = None,
    metrics: Sequence[Metric] = (),
) -> Experiment:
    """The experiment of a case of the paper.

    Args:
        number: 1 to 4.
        controller: a `controller.kind`.
        law: a position law with its gains, instead of `controller`; built-in or your own, as all parts below.
        estimator: replaces the low-pass filter.
        coordination: replaces differential tension.
        rope: replaces the paper's two ropes.
        actuator: of both motors, which the paper assumes to be ideal.
        metrics: your own figures of merit, in addition to the built-in ones.

    Raises:
        ConfigurationError: an unknown case or controller; the message suggests the nearest controller.

    Example:
        >>> import dualwinch as dw
        >>> dw.case(4).controller.law.label, dw.case(4, "pid-cascade").controller.law.label
        ('FANDO-NFTSM', 'PID cascade')
    """
    if isinstance(number, bool) or not isinstance(number, Integral) or number not in CASES:
        raise ConfigurationError(f"case {number!r}: must be 1, 2, 3 or 4")
    parts = {"law": law or POSITION_LAWS.find(controller)(), "estimator": estimator, "coordination": coordination}
    return Experiment(
        plant=Plant() if rope is None else Plant(rope_1=rope, rope_2=rope),
        reference=Reference(kind="uniform" if number in {1, 3} else "profile"),
        disturbance=Disturbance(vortex=number in {3, 4}),
        controller=Controller(**{name: part for name, part in parts.items() if part is not None}),
        actuator=actuator or Ideal(),
        metrics=metrics,
    )


WITH_OBSERVER, WITHOUT_OBSERVER = "fando-nftsm", "nftsm"
"""The controllers Figure 21 compares."""

COMPARED_CASE = 4
"""The case of Figure 21."""


def steady_change(metrics: Mapping[str, Metrics]) -> dict[str, float] | None:
    """Relative change of the steady-state errors due to the observer.

    Args:
        metrics: controller → figures of merit, all of one case.

    Returns:
        ``mae``, ``max_abs_error``, ``mse`` → (with observer − without) / without, so −0.76 is 76 % less; NaN where
        a run never reached its steady state. ``None`` if one of the two controllers is missing.
    """
    if WITH_OBSERVER not in metrics or WITHOUT_OBSERVER not in metrics:
        return None
    new, old = metrics[WITH_OBSERVER], metrics[WITHOUT_OBSERVER]
    pairs = {key: (getattr(new, f"steady_{key}"), getattr(old, f"steady_{key}")) for key in REDUCTIONS}
    return {key: after / before - 1 if before else float("nan") for key, (after, before) in pairs.items()}


def percent(share: float, form: str = "+.1f") -> str:
    """A relative change in percent, with a true minus sign (U+2212), e.g. −74.4 % for −0.744.

    `form` is the format of the number; ``+g`` shows all its digits.
    """
    return f"{round(100 * share, 6):{form}} %".replace("-", "−")
