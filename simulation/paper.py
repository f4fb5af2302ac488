"""The paper's four simulated cases, its three controllers and its figures (Section 4)."""

from dataclasses import dataclass

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.laws.registry import POSITION_LAWS
from dualwinch.model.disturbance import Disturbance
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.reference import Reference
from dualwinch.simulation.experiment import Experiment

CASES = {
    1: "uniform speed, no disturbance",
    2: "profile, no disturbance",
    3: "uniform speed, vortex shedding",
    4: "profile, vortex shedding",
}
"""Case number → what it is."""

CONTROLLERS = {"fando-nftsm": "FANDO-NFTSM", "nftsm": "NFTSM", "pid-cascade": "PID cascade"}
"""The paper's controllers: `controller.kind` → its name in figures and tables (Table 2)."""

REDUCTIONS = {"mae": -0.76, "max_abs_error": -0.67, "mse": -0.935}
"""Figure 21: change of the steady-state errors by the observer in Case 4, as the paper reports it."""


@dataclass(frozen=True)
class PaperFigure:
    """One figure of the paper: its number, the case it shows and what it draws."""

    number: int
    case: int
    content: str


CONTENTS = ("trajectory", "error", "commands", "tensions")
"""What the four figures of a case draw, in the paper's order."""

FIGURES = tuple(
    PaperFigure(5 + 4 * (case - 1) + place, case, content) for case in CASES for place, content in enumerate(CONTENTS)
)
"""Figures 5 to 20; Figure 21 compares two controllers."""


def case(number: int, controller: str = "fando-nftsm") -> Experiment:
    """The experiment of a case of the paper.

    Args:
        number: 1 to 4.
        controller: a `controller.kind`.

    Raises:
        ConfigurationError: there is no such case.
    """
    if number not in CASES:
        raise ConfigurationError(f"case {number}: must be 1, 2, 3 or 4")
    return Experiment(
        reference=Reference(kind="uniform" if number in {1, 3} else "profile"),
        disturbance=Disturbance(vortex=number in {3, 4}),
        controller=Controller(law=POSITION_LAWS.find(controller)()),
    )
