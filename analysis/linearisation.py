"""Linear models of plant or loop at an operating point or along a sweep, with their figures and drawings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np

from dualwinch.analysis.describing_function import amplitude_sweep
from dualwinch.analysis.linear_figures import (
    closed_sweep_table,
    input_output_figures,
    margins_by_amplitude,
    margins_table,
    matrix_tables,
    modes_figures,
    modes_sweep_figures,
    operating_point_figures,
    point_columns,
    resonance_figures,
    stability_figures,
)
from dualwinch.analysis.linear_loop import OPENED_SIGNALS, learns, linear_closed_loop, linear_open_loop
from dualwinch.analysis.margins import margins
from dualwinch.model.linear.linearisation import linearise_at
from dualwinch.model.linear.operating_point import OperatingPoint, contact, operating_points
from dualwinch.model.linear.system import LinearSystem, save_sweep
from dualwinch.model.quantities.figures import Figures, FigureTable, Sentence, to_record
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import LOOP_OPENINGS
from dualwinch.simulation.settings import override

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LoopName: TypeAlias = Literal["plant", "open", "closed"]
DrawingName: TypeAlias = Literal["amplitude", "bode", "modes", "poles", "shapes"]
DRAWINGS: dict[LoopName, tuple[DrawingName, ...]] = {
    "plant": ("bode", "modes", "poles", "shapes"),
    "closed": ("poles",),
    "open": ("bode", "amplitude"),
}
"""What is linearised → its drawings, the default of one point first."""


class Point(NamedTuple):
    """A point to linearise at: position in m, speed in m/s and sum of both tensions in N."""

    x: float
    v: float
    preload: float


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Linear models of an experiment's plant, or of its loop over a sample, at one or more points.

    Attributes:
        experiment: plant and controller.
        loop: what is linearised: the plant alone, or the loop opened at a signal or closed.
        opening: signal at which the loop is opened; of no meaning otherwise.
        points: operating points.
        systems: the linear system at each.
        plant_points: operating points of the plant; none for an open loop.
        swept: name of the number that varies over the points; None: one point.
    """

    experiment: Experiment
    loop: LoopName
    opening: str
    points: Sequence[Point]
    systems: Sequence[LinearSystem]
    plant_points: Sequence[OperatingPoint]
    swept: str | None

    @cached_property
    def figures(self) -> Figures:
        """Tables and sentences: operating point and modes of a plant or closed loop, margins of an open loop."""
        figures: list[FigureTable | Sentence]
        plant, (system, *_) = self.experiment.plant, self.systems
        values = [getattr(point, self.swept or "x") for point in self.points]
        if self.loop == "open":
            figures = [*self._margins(values)]
        elif self.swept and self.loop == "closed":
            figures = [closed_sweep_table(self.systems, plant, self.swept, values)]
        elif self.swept:
            figures = [*modes_sweep_figures(self.systems, self.plant_points, plant, self.swept)]
        else:
            of_loop = self.loop == "closed"
            figures = [
                *operating_point_figures(self.plant_points[0]),
                *matrix_tables(system),
                *modes_figures(system, plant, of_loop=of_loop),
                *input_output_figures(system),
                *(stability_figures(system) if of_loop else ()),
            ]
        if self.loop != "plant" and learns(self.experiment):
            figures.append(Sentence("what the estimator learns of the machine is held, at its true values"))
        if self.loop != "plant" and not self.swept:
            x, _, preload = self.points[0]
            figures += resonance_figures(_with_preload(self.experiment, preload), x)
        return figures

    def _margins(self, values: Sequence[float]) -> Figures:
        """Margins of the open loops and, for one point of a sliding-mode law, their dependence on the amplitude."""
        plant, system = self.experiment.plant, self.systems[0]
        figures: list[Figures] = []
        responds = any(each.B.any() for each in self.systems)
        if not responds:
            signals = " and ".join(LOOP_OPENINGS[signal] for signal in OPENED_SIGNALS[self.opening])
            figures.append([Sentence(f"no loop gain: {signals} rests on its limit or does not respond here")])
        parameter = point_columns(self.swept)[0] if self.swept else None
        table, growing = margins_table("margins", parameter, values, self.systems, plant)
        ratio = f" ({', '.join(map('/'.join, zip(system.outputs, system.inputs, strict=True)))})"
        table = replace(table, title=f"margins of the loop opened at {self.opening}", subtitle=ratio)
        figures += [[table, *growing], [*map(Sentence, contact(system.operating_point, plant))]]
        if responds and not self.swept:
            x, v, preload = self.points[0]
            figures.append(margins_by_amplitude(_with_preload(self.experiment, preload), x, v, self.opening))
        return [item for group in figures for item in group]

    def save(self, path: str | PathLike[str], notes: Sequence[str] = ()) -> None:
        """Write the matrices, and the `figures` under that name with further notes, to a file: .json, .mat or .npz.

        Raises:
            ConfigurationError: unknown suffix.
            OSError: the file cannot be written.
        """
        record = to_record([*self.figures, *map(Sentence, notes)])
        if self.swept:
            save_sweep(self.systems, path, record)
        else:
            self.systems[0].save(path, record)

    def plot(self, drawing: DrawingName | None = None) -> "Figure":
        """Draw one of the `DRAWINGS`; by default modes of a plant along a sweep, otherwise the first."""
        from dualwinch.analysis.plots import linear

        experiment, systems, swept = self.experiment, self.systems, self.swept
        default = "modes" if swept and self.loop == "plant" else DRAWINGS[self.loop][0]
        match self.loop, drawing or default:
            case "closed", _:
                figure = linear.closed_loop_poles(systems, swept)
            case "open", "amplitude":
                x, v, preload = self.points[0]
                varied = amplitude_sweep(_with_preload(experiment, preload), x, v, self.opening)
                figure = linear.amplitude_margins(varied)
            case "open", _:
                figure = linear.loop_bode(systems, list(map(margins, systems)), swept)
            case _, "shapes":
                figure = linear.mode_shapes(systems[0], experiment.plant)
            case _, "poles":
                figure = linear.pole_map(systems, swept or "", experiment.plant)
            case _, "modes":
                sample_time = experiment.simulation.sample_time
                figure = linear.modal_frequencies(systems, swept or "", experiment.plant, sample_time)
            case _:
                figure = linear.bode(systems, swept)
        return figure


def linearisation(
    experiment: Experiment,
    points: Sequence[Point],
    loop: LoopName = "plant",
    opening: str = "u",
    dt: float | None = None,
    swept: str | None = None,
) -> Linearisation:
    """Linearise plant or loop at every point.

    Args:
        experiment: plant and controller; its preload is that of each point.
        points: operating points.
        loop: what to linearise.
        opening: signal at which an open loop is opened.
        dt: sample time in s of the plant alone; None: continuous time.
        swept: name of the number that varies over the points.

    Raises:
        ConfigurationError: a point without an operating point of the plant, or without steady motion of the loop.
    """
    at_points = [(_with_preload(experiment, preload), x, v) for x, v, preload in points]
    if loop == "open":
        systems = [linear_open_loop(each, x, v, opening) for each, x, v in at_points]
        return Linearisation(experiment, loop, opening, points, systems, [], swept)
    limits = experiment.controller.limits
    tension_max = limits.tension_max if loop == "plant" else limits.command_max
    x, v, preload = np.array(points).T
    plant_points = operating_points(
        x, v, preload, experiment.plant, tension_min=limits.tension_min, tension_max=tension_max
    )
    if loop == "plant":
        systems = list(linearise_at(plant_points, experiment.plant, dt))
    else:
        systems = [linear_closed_loop(each, x, v) for each, x, v in at_points]
    return Linearisation(experiment, loop, opening, points, systems, plant_points, swept)


def _with_preload(experiment: Experiment, preload: float) -> Experiment:
    return override(experiment, {"controller.coordination.preload": float(preload)})
