"""The figure of docs/position-laws.md: ``python -m benchmarks.predictive_figure docs/images/mpc.svg`` draws it."""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dualwinch.controllers.laws.adrc import Adrc
from dualwinch.controllers.laws.predictive.mpc import Mpc
from dualwinch.model.reference import Setpoint
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.plots.page import new_page, save
from dualwinch.simulation.plots.style import BLUE, GREY, VERMILION
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

CORNER = 18.0
"""Time in s at which the paper's profile ends its acceleration."""


@dataclass(frozen=True)
class Blind(Mpc):
    """The law without preview: it takes the reference to go on as it is."""

    kind: ClassVar = "mpc-blind"
    label: ClassVar = "MPC without preview"

    @property
    def preview(self) -> tuple[float, ...]:
        """Nothing."""
        return ()

    def step(self, state: Any, estimate: Any, setpoint: Setpoint, context: Any) -> Any:
        """One sample."""
        return super().step(state, estimate, Setpoint(setpoint.x, setpoint.v, setpoint.a), context)


def hurried_start() -> Experiment:
    """The reference sets off at once at 0.15 m/s: the force goes to its limit, stays there and leaves it."""
    hurried = {"reference.kind": "uniform", "reference.speed": 0.15, "simulation.duration": 1.0}
    return override(case(4, "mpc"), hurried | {"controller.estimator": "none"})


def predictive_figure(hurried: Experiment) -> Figure:
    """Errors around a corner of the profile, and forces where the reference asks for more than there is.

    Args:
        hurried: an experiment whose law is at its limit.
    """
    with new_page(None, 3.0, "What looking ahead does", "Case 2, and a start at 0.15 m/s from rest") as page:
        corner, start = page.panels(1, 2)
        for law, colour in ((Blind(), GREY), (Mpc(), BLUE)):
            _draw(corner, simulate(case(2, law=law)), "e", 1e6, colour, law.label)
        corner.axvline(CORNER, color=GREY, linewidth=0.8, linestyle=":")
        corner.set_xlim(CORNER - 0.6, CORNER + 1.0)
        corner.set_title("error where the acceleration ends")
        corner.set_ylabel("e (µm)")
        limit, others = hurried.controller.limits.force, simulate(_with_law(hurried, Adrc()))
        _draw(start, others, "u_sat", 1e-3, VERMILION, Adrc.label)
        _draw(start, simulate(hurried), "u_sat", 1e-3, BLUE, Mpc.label)
        for side in (-limit, limit):
            start.axhline(side / 1e3, color=GREY, linewidth=0.8, linestyle=":")
        start.set_title("force; dotted: its limits")
        start.set_ylabel("u (kN)")
        for axes in (corner, start):
            axes.set_xlabel("t (s)")
            axes.legend()
    return page.figure


def _with_law(hurried: Experiment, law: Adrc) -> Experiment:
    """The same experiment with another law."""
    return replace(hurried, controller=replace(hurried.controller, law=law))


def _draw(axes: Axes, result: Result, column: str, factor: float, colour: str, label: str) -> None:
    axes.plot(result["t"], factor * np.asarray(result[column]), color=colour, label=label)


def main() -> None:
    """Draw the figure into a file."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.predictive_figure", description=__doc__)
    parser.add_argument("file", type=Path, metavar="FILE", help=".svg, .png or .pdf")
    save(predictive_figure(hurried_start()), parser.parse_args().file)


if __name__ == "__main__":
    main()
