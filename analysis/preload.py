"""Lower bound of the preload of a run by optimal control, and its comparison with constant and scheduled preloads.

Only the difference of both tensions moves the vehicle; their sum, the preload, is free, and loads the motors. Its lower
bound is the solution of an optimal control problem: tensions and torques within their limits, with minimal load, peak
or energy, chosen with full knowledge of the plant and of future disturbances. A controller, which knows less, needs
more.

Where the vehicle must stay exactly on its reference the problem is convex, a quadratic or linear program. An allowed
error makes it nonlinear, because of drag and vortex forces.

Ropes stretch quasi-statically: their damping of 1 kN s/m is neglected, as the stretch changes by only millimetres per
second. Drums have their nominal radius, and the friction at the vehicle's speed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis.remarks import remarks
from dualwinch.codegen.errors import DualwinchError
from dualwinch.codegen.source.expressions import GRAPHS
from dualwinch.controllers.coordinations.differential_tension import DifferentialTension
from dualwinch.controllers.coordinations.scheduled_preload import ScheduledPreload
from dualwinch.model.arguments import instance
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant, rigid_plant
from dualwinch.model.quantities.figures import FigureColumn, Figures, FigureTable, Sentence
from dualwinch.model.quantities.tree import numbers
from dualwinch.model.ropes import Rope, compliance, kelvin_voigt, rope_lengths, tangent_rope
from dualwinch.model.scalar import absolute
from dualwinch.simulation.batch.authority import (
    central_differences,
    motor_torque,
    moved_by,
    outside_at,
    outside_symbols,
    pull,
)
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.plots.page import GivenAxes, new_page, scenario
from dualwinch.simulation.plots.style import BLUE, GOLD, GREEN, GREY, INK, VERMILION, prefixed_unit
from dualwinch.simulation.plots.traces import largest, thin
from dualwinch.simulation.progress import Progress, no_progress
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.simulate import simulate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

PreloadObjective: TypeAlias = Literal["load", "peak", "energy"]
"""Objective: `Metrics.continuous_load`, `Metrics.peak_tension` or `Metrics.energy`."""

KILONEWTONS, MILLIMETRES = 1e-3, 1e3
"""Scales of tensions and deviations in the solver."""

STANDING = 1e-3
"""Speed in m/s below which the energy of a motion with allowed errors is smoothed, as its slope jumps at rest."""

AMONG_EQUALS = 1e-4
"""Weight of the load in other objectives, whose solution is not unique: at rest preload takes no energy, and below the
peak any preload is allowed."""


@dataclass(frozen=True, repr=False)
class OptimalPreload:
    """Optimal tensions and torques over time, each (instants,), and their figures of merit.

    Attributes:
        t: time in s.
        F1, F2: tensions in N.
        tau_1, tau_2: motor torques in N m.
        e: distance from the reference in m.
        continuous_load: root mean square of both motors' torques in N m.
        peak_tension: largest tension of both ropes in N.
        energy: work of both motors in J, braking counted like driving.
    """

    t: Floats
    F1: Floats
    F2: Floats
    tau_1: Floats
    tau_2: Floats
    e: Floats
    continuous_load: float
    peak_tension: float
    energy: float

    @property
    def preload(self) -> Floats:
        """(instants,) Sum of both tensions in N."""
        return self.F1 + self.F2

    def __repr__(self) -> str:
        """Figures of merit in one line."""
        return (
            f"OptimalPreload of {self.t[-1]:g} s: continuous load {self.continuous_load:.4g} N m, "
            f"largest tension {self.peak_tension:.0f} N, energy {self.energy:.4g} J"
        )


def optimal_preload(
    experiment: Experiment,
    minimise: PreloadObjective = "load",
    *,
    error: float = 0.0,
    torque_rate: float | None = None,
    elastic: bool = True,
    every: int = 40,
) -> OptimalPreload:
    """Minimise the motor load of a run's motion over all tensions, under any controller.

    F_1 − F_2 satisfies the vehicle's equation (paper Section 2.3), and the torques follow from the drums' equations
    (Section 2.4). Tensions lie within tension_min and tension_max, torques within these limits times the lever arm, as
    the winch controllers limit them. Solved with IPOPT.

    Args:
        experiment: motion, disturbance, plant and limits. Its controller is not used.
        minimise: objective, ``load``, ``peak`` or ``energy``; ties are broken by the load.
        error: largest allowed distance from the reference in m.
        torque_rate: largest rate of each motor torque in N m/s; default: any.
        elastic: whether drums compensate for the ropes' stretch, which changes with tension.
        every: samples per step; the equations hold at the ends of steps.

    Raises:
        ConfigurationError: a value is out of its range.
        DualwinchError: no tensions within the limits produce the motion, or the solver found none.

    Example:
        >>> import dualwinch as dw
        >>> optimum = dw.optimal_preload(dw.case(2), "load", every=1000)
        >>> f"{optimum.continuous_load:.1f} N m"
        '39.9 N m'
    """
    _check(experiment, minimise, error, torque_rate, every)
    step = every * experiment.simulation.sample_time
    outside, limits = outside_at(experiment, every), experiment.controller.limits
    instants, free = outside.shape[1], error > 0
    plant = _with_tangent_ropes(experiment)
    parameter_values = [*numbers(plant).values(), *numbers(experiment.disturbance).values()]
    solver, found_from = _problem(instants, step, minimise, elastic, free)
    p = ca.vertcat(ca.vec(ca.DM(outside)), ca.DM(parameter_values))
    tension = np.array([limits.tension_min, limits.tension_max]) * KILONEWTONS
    deviation = np.full(instants if free else 0, error * MILLIMETRES)
    deviation[:2] = 0.0  # position and speed at the start
    lower = np.concatenate([np.full(2 * instants, tension[0]), -deviation, [0.0]])
    upper = np.concatenate([np.full(2 * instants, tension[1]), deviation, [np.inf]])
    levers = np.array([winch.drum_radius / winch.gear_ratio for winch in (plant.winch_1, plant.winch_2)])
    torques = np.repeat(levers, instants - 2)
    change = np.full(2 * (instants - 3), np.inf if torque_rate is None else torque_rate * step)
    below = np.full(2 * instants, -np.inf)
    solution = solver(
        x0=np.clip(tension.mean(), lower, upper),
        p=p,
        lbx=lower,
        ubx=upper,
        lbg=np.concatenate([np.zeros(instants + 2), torques * limits.tension_min, -change, below]),
        ubg=np.concatenate([np.zeros(instants + 2), torques * limits.tension_max, change, np.zeros(2 * instants)]),
    )
    if not solver.stats()["success"]:
        raise DualwinchError(
            f"optimal_preload: no tensions within {limits.tension_min:g} to {limits.tension_max:g} N"
            f"{'' if torque_rate is None else f', with torque rates of at most {torque_rate:g} N m/s,'} give the "
            f"motion to within {error:g} m (IPOPT: {solver.stats()['return_status']}); allow a larger error"
        )
    F1, F2, tau_1, tau_2, e, load, energy = (np.asarray(part, float).ravel() for part in found_from(solution["x"], p))
    peak = float(max(F1.max(), F2.max()))
    return OptimalPreload(outside[0], F1, F2, tau_1, tau_2, e, float(load[0]), peak, float(energy[0]))


def _check(experiment: Experiment, minimise: str, error: float, torque_rate: float | None, every: int) -> None:
    instance("experiment", experiment, Experiment)
    if minimise not in get_args(PreloadObjective):
        raise ConfigurationError(f"minimise = {minimise!r}: must be one of {', '.join(get_args(PreloadObjective))}")
    if not 0 <= error < np.inf:
        raise ConfigurationError(f"error = {error:g}: must be a finite number >= 0 m")
    if torque_rate is not None and not 0 < torque_rate < np.inf:
        raise ConfigurationError(f"torque_rate = {torque_rate:g}: must be a finite number > 0 N m/s")
    if every < 1 or experiment.samples < 4 * every:
        raise ConfigurationError(f"every = {every}: must be 1 to {experiment.samples // 4} (a quarter of the samples)")


def _with_tangent_ropes(experiment: Experiment) -> Plant:
    """The plant with massless straight ropes, linearised at half the preload, mid-track."""
    plant, tension = experiment.plant, experiment.controller.limits.preload / 2
    length = plant.track.length / 2 + plant.track.rope_offset
    rope_1, rope_2 = (tangent_rope(rope, tension, length) for rope in (plant.rope_1, plant.rope_2))
    rope_1, rope_2 = (Rope(rope.area, rope.modulus, rope.damping) for rope in (rope_1, rope_2))
    return replace(rigid_plant(plant), rope_1=rope_1, rope_2=rope_2)


@GRAPHS.cached
def _problem(
    instants: int, step: float, minimise: PreloadObjective, elastic: bool, free: bool
) -> tuple[ca.Function, ca.Function]:
    """Solver of the optimal control problem, and the function that evaluates its solution.

    Unknowns are both tensions in kN, the distance from the reference in mm if an error is allowed, and the peak in kN.
    The equations hold at all inner instants, with speeds and accelerations by central differences.
    """
    outside_now, parameters, disturbance, plant = outside_symbols()
    outside = ca.SX.sym("outside", 7, instants)
    F1, F2, e = (ca.SX.sym(name, 1, instants) for name in ("F1", "F2", "e"))
    top = ca.SX.sym("top")
    deviation = e / MILLIMETRES if free else ca.SX.zeros(1, instants)
    motion = moved_by(outside, deviation, step)
    needed = ca.Function("pull", [outside_now, parameters], [pull(outside_now, disturbance, plant)])(motion, parameters)

    torques, pulls = [], []
    lengths = rope_lengths(outside[1, :] + deviation, plant.track)
    ropes = ((plant.winch_1, plant.rope_1, 1), (plant.winch_2, plant.rope_2, -1))
    for tension, length, (winch, rope, way) in zip((F1 / KILONEWTONS, F2 / KILONEWTONS), lengths, ropes, strict=True):
        stretch = tension * compliance(length, kelvin_voigt(rope)) if elastic else ca.SX.zeros(1, instants)
        _, stretching = central_differences(stretch, step)
        speed, acceleration = way * motion[2, :], way * motion[3, :] + stretching
        torque = motor_torque(speed, acceleration, tension[:, 1:-1], winch)
        torques.append(torque)
        pulls.append(torque * winch.gear_ratio / winch.drum_radius)
    square = (ca.sumsqr(torques[0]) + ca.sumsqr(torques[1])) / (2 * (instants - 2))
    pace, pulled = motion[2, :], pulls[0] + pulls[1]
    energy = step * ca.dot(pulled, absolute(pace))
    smooth = step * ca.dot(pulled, ca.sqrt(pace**2 + STANDING**2)) if free else energy
    goal = {"load": square / 100, "peak": top, "energy": smooth / 1e5}[minimise]
    ends = [tension[end] - tension[inner] for tension in (F1, F2) for end, inner in ((0, 1), (-1, -2))]
    changes = [torque[:, 1:] - torque[:, :-1] for torque in torques]
    above = (F1 - top, F2 - top)
    equalities = [KILONEWTONS * needed - (F1 - F2)[:, 1:-1]]
    unknown = ca.vertcat(ca.vec(F1), ca.vec(F2), *([ca.vec(e)] if free else []), top)
    p = ca.vertcat(ca.vec(outside), parameters)
    problem = {
        "x": unknown,
        "p": p,
        "f": goal + (0 if minimise == "load" else AMONG_EQUALS * square / 100),
        "g": ca.vertcat(*(ca.vec(part) for part in (*equalities, *ends, *torques, *changes, *above))),
    }
    options = {
        "print_time": False,
        "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 300, "tol": 1e-8 if free else 1e-10},
    }
    solver = ca.nlpsol("optimal_preload", "ipopt", problem, options)
    outputs = [F1 / KILONEWTONS, F2 / KILONEWTONS, *torques, deviation, ca.sqrt(square), energy]
    return solver, ca.Function("found", [unknown, p], outputs)


MEASURE: dict[PreloadObjective, str] = {"load": "continuous_load", "peak": "peak_tension", "energy": "energy"}
"""Objective → figure of merit."""

CONSTANTS, REFINEMENTS = 96, 2
"""Number of constant preloads of a grid in the search, and of finer grids between the neighbours of the best."""

AS_GOOD = 1.01
"""Largest ratio of mean square errors at which a constant preload counts as equal to the schedule."""


@dataclass(frozen=True)
class Preloads:
    """Comparison of constant, best constant and scheduled preloads with the lower bound.

    Attributes:
        measure: the figure of merit to minimise.
        constant: the run with the experiment's own preload, held constant by differential tension.
        best: the run with the constant preload of smallest measure whose error equals that of the schedule and whose
            smallest tension is not smaller; ``None`` if there is none.
        scheduled: the run of the experiment.
        optimum: lower bound for any controller that keeps the vehicle within the given distance of its reference.
        configured: the run with the coordination that was configured; ``None`` if that is `constant` or `scheduled`.
    """

    measure: str
    constant: Result
    best: Result | None
    scheduled: Result
    optimum: OptimalPreload
    configured: Result | None = None

    @property
    def runs(self) -> dict[str, Result]:
        """The available runs, by name."""
        named = {
            "as configured": self.configured,
            "constant": self.constant,
            "best constant": self.best,
            "scheduled": self.scheduled,
        }
        return {name: run for name, run in named.items() if run is not None}

    @property
    def saved(self) -> float:
        """Saving of the schedule over the best constant preload, as a share of the lower bound's; NaN if unknown."""
        if self.best is None:
            return np.nan
        best, scheduled = (result.metrics[self.measure] for result in (self.best, self.scheduled))
        return float((best - scheduled) / (best - getattr(self.optimum, self.measure)))

    @cached_property
    def remarks(self) -> list[str]:
        """Remarks on the scheduled run."""
        return remarks(self.scheduled)

    @property
    def over_best(self) -> dict[str, float]:
        """The measure of schedule and optimum over that of the best constant preload; empty if there is none."""
        if self.best is None:
            return {}
        best, scheduled = (result.metrics[self.measure] for result in (self.best, self.scheduled))
        return {"scheduled": scheduled / best, "optimum": getattr(self.optimum, self.measure) / best}

    @cached_property
    def figures(self) -> Figures:
        """A column for every preload, the saving of the schedule, and what the coordinations are."""
        record, merits = self.to_record(), self.scheduled.metrics.quantities
        columns = [FigureColumn("preload", ""), FigureColumn("preload_extremes", "N", "preload")]
        columns += [merits[name].column(name) for name in PRINTED]
        rows = []
        for name in (*self.runs, "optimum"):
            run = record[name.replace(" ", "_")]
            outcome = run.get("outcome", "completed")
            ending = "" if outcome == "completed" else f" ({outcome})"
            extremes = "–".join(dict.fromkeys(f"{end:.0f}" for end in run["preload_extremes"]))
            rows.append([name + ending, extremes, *(run["metrics"].get(metric, np.nan) for metric in PRINTED)])
        figures: list[FigureTable | Sentence] = [FigureTable("preloads", columns, rows, layout="columns")]
        if self.configured is not None:
            figures.append(Sentence(self._coordinations))
        if self.best is None:
            words = "No constant preload has an error as small as the schedule's and keeps both ropes as taut."
            return [*figures, Sentence(words)]
        share = f"The schedule takes {self.over_best['scheduled']:.3g} of the {self.measure.replace('_', ' ')}"
        saving = f"{100 * self.saved:.3g} % of the possible saving" if self.saved > 0 else "no saving"
        words = (
            " of the best constant preload that is as precise and keeps the ropes as taut; the optimum is "
            f"{self.over_best['optimum']:.3g}: {saving}."
        )
        return [*figures, Sentence(words, share)]

    @property
    def _coordinations(self) -> str:
        """Which coordination each run has, where that of the experiment is another one."""
        kinds = {name: run.experiment.controller.coordination.kind for name, run in self.runs.items()}
        configured, constant, scheduled = kinds["as configured"], kinds["constant"], kinds["scheduled"]
        constants = "constant" if self.best is None else "constant and best constant"
        share = "shares" if self.best is None else "share"
        return (
            f"as configured: {configured}, as `simulate` runs it; {constants} {share} the force by {constant}, "
            f"scheduled by {scheduled}, each with the gains that it has in common with {configured}."
        )

    def to_record(self) -> dict[str, Any]:
        """The preloads as plain data; curves with at most `CURVE_POINTS` points."""
        record: dict[str, Any] = {}
        for name, run in self.runs.items():
            stride, preload = max(1, -(-len(run["t"]) // CURVE_POINTS)), run.experiment.controller.limits.preload
            record[name.replace(" ", "_")] = {
                "outcome": str(run.outcome),
                "coordination": run.experiment.controller.coordination.kind,
                "preload": preload,
                "preload_extremes": _extremes(run["preload"]) if "preload" in run.columns else [preload] * 2,
                "metrics": dict(run.metrics),
                "curves": {key: run[key][::stride] for key in ("t", "F1", "F2", "e")},
            }
        optimum = self.optimum
        record["optimum"] = {
            "metrics": {
                "continuous_load": optimum.continuous_load,
                "peak_tension": optimum.peak_tension,
                "min_tension": float(min(optimum.F1.min(), optimum.F2.min())),
                "energy": optimum.energy,
                "mse": float((optimum.e**2).mean()),
            },
            "preload_extremes": _extremes(optimum.preload),
            "curves": {key: getattr(optimum, key) for key in ("t", "F1", "F2", "e")},
        }
        units = {"t": "s", "F1": "N", "F2": "N", "e": "m", "preload": "N", "preload_extremes": "N"}
        units |= dict.fromkeys(("saved_share", "measure_over_best_constant"), "1")
        return record | {
            "measure": self.measure,
            "saved_share": self.saved,
            "measure_over_best_constant": self.over_best,
            "units": units | {name: quantity.unit for name, quantity in self.scheduled.metrics.quantities.items()},
        }

    def plot(self, *, ax: "Axes | Sequence[Axes] | None" = None) -> "Figure":
        """Plot the sum of both tensions, the smaller of them, and the error over time.

        Args:
            ax: axes for the three; default: a figure of its own.
        """
        return preloads_figure(self, ax=ax)


PRINTED = ("continuous_load", "peak_tension", "min_tension", "energy", "chatter", "mse")
"""Figures of merit in tables."""

CURVE_POINTS = 1000
"""Most points over time of each run in a record."""


def _extremes(preload: Floats) -> list[float]:
    """Smallest and largest preload, the commanded sum of tensions, in N."""
    return [float(preload.min()), float(preload.max())]


PRELOAD_COLOURS = {"as configured": GOLD, "constant": GREY, "best constant": VERMILION, "scheduled": BLUE}
"""Run → colour."""


def preloads_figure(result: Preloads, *, ax: GivenAxes = None) -> "Figure":
    """Sum of both tensions, smaller tension, and error over time, for every preload; a panel each."""
    experiment, best = result.scheduled.experiment, result.optimum
    loads = ", ".join(f"{name} {run.metrics.continuous_load:.1f}" for name, run in result.runs.items())
    words = f"Continuous load in N m: {loads}, optimum {best.continuous_load:.1f}"
    with new_page(ax, 5.8, f"What preload costs: {scenario(experiment)}", words) as page:
        total, smaller, _ = panels = page.panels(3, sharex=True, height_ratios=(1.3, 1, 1))
        unit, name_of_unit = prefixed_unit("m", *(largest(run["e"]) for run in result.runs.values()))
        sums = [largest(run["F1"] + run["F2"]) for run in result.runs.values()]
        force, name_of_force = prefixed_unit("N", *sums, largest(best.preload))
        for name, run in result.runs.items():
            constant = f", {run.experiment.controller.limits.preload:.0f} N" if run is not result.scheduled else ""
            signals = (run["F1"] + run["F2"]) / force, np.minimum(run["F1"], run["F2"]) / force, run["e"] / unit
            for axes, values in zip(panels, signals, strict=True):
                axes.plot(*thin(run["t"], values), color=PRELOAD_COLOURS[name], linewidth=1.0, label=name + constant)
        optimum = {"color": GREEN, "linestyle": (0, (4, 2)), "linewidth": 1.0, "label": "optimum"}
        total.plot(best.t, best.preload / force, **optimum)
        smaller.plot(best.t, np.minimum(best.F1, best.F2) / force, **optimum)
        smaller.axhline(experiment.controller.limits.tension_min / force, color=INK, linewidth=0.7, linestyle=":")
        labels = (
            f"sum of tensions ({name_of_force})",
            f"smaller tension ({name_of_force})",
            f"error $e$ ({name_of_unit})",
        )
        for axes, label in zip(panels, labels, strict=True):
            axes.set_ylabel(label)
        page.time_axes(panels, experiment, shaded=False)
        page.legend()
    return page.figure


def preloads(
    experiment: Experiment,
    minimise: PreloadObjective = "load",
    *,
    error: float = 0.0,
    torque_rate: float | None = None,
    configured: Experiment | None = None,
    progress: Progress = no_progress,
) -> Preloads:
    """Compare an experiment with scheduled preload with constant preloads and with the lower bound.

    Args:
        experiment: with a schedule as coordination. Runs with constant preload have differential tension instead, and
            differ in nothing else, winch gains included.
        minimise: objective, ``load``, ``peak`` or ``energy``.
        error: largest distance of the optimum from the reference in m.
        torque_rate: largest rate of each motor torque of the optimum in N m/s; default: any.
        configured: the experiment before its coordination became the schedule, to be run as well, as it is.
        progress: called from time to time with the completed fraction.

    Raises:
        ConfigurationError: the preload is not scheduled, or a value is out of its range.
        DualwinchError: no tensions within the limits produce the motion, or there is no compiler.
    """
    schedule = experiment.controller.coordination
    if not isinstance(schedule, ScheduledPreload):
        raise ConfigurationError(
            f'controller.coordination.kind = "{schedule.kind}": must be "{ScheduledPreload.kind}" here'
        )
    bound = optimal_preload(experiment, minimise, error=error, torque_rate=torque_rate)
    progress(0.3)
    scheduled = simulate(experiment)
    coordination = DifferentialTension(schedule.winch_1, schedule.winch_2)
    constant = replace(experiment, controller=replace(experiment.controller, coordination=coordination))
    as_it_is = simulate(constant)
    progress(0.5)
    best = _best_constant(as_it_is, scheduled, MEASURE[minimise], lambda share: progress(0.5 + 0.4 * share))
    configured_run = None
    if configured is not None and configured not in (constant, experiment):
        configured_run = simulate(configured)
    progress(1.0)
    return Preloads(MEASURE[minimise], as_it_is, best, scheduled, bound, configured_run)


def _best_constant(constant: Result, scheduled: Result, measure: str, progress: Progress) -> Result | None:
    """The run with the constant preload of smallest measure that is as good as the schedule; ``None``: there is none.

    1. Run a grid of preloads within the limits.
    2. Run a finer grid between both neighbours of the best; repeat.
    3. Compare the best with the experiment's own preload: where the schedule never rises above that, it is the best
       exactly, and any grid lies beside it.
    """
    experiment, limits = constant.experiment, constant.experiment.controller.limits
    low, high, preload = 2 * limits.tension_min, 2 * limits.command_max, None
    for grid in range(REFINEMENTS + 1):
        preload_values = np.linspace(low, high, CONSTANTS + 2)
        batch = rollout(
            ["controller.coordination.preload"],
            preload_values[1:-1, None],
            [experiment],
            progress=lambda share, before=grid: progress((before + share) / (REFINEMENTS + 1)),
        )
        merits = {name: values[:, 0] for name, values in batch.metrics.items()}
        good = _as_good(merits["mse"], merits["min_tension"], scheduled)
        if not good.any():
            break
        at = int(np.where(good, merits[measure], np.inf).argmin()) + 1
        low, preload, high = (float(each) for each in preload_values[at - 1 : at + 2])
    candidates = [constant] if _as_good(constant.metrics.mse, constant.metrics.min_tension, scheduled) else []
    if preload is not None:
        limits = replace(limits, preload=preload)
        candidates.append(simulate(replace(experiment, controller=replace(experiment.controller, limits=limits))))
    return min(candidates, key=lambda run: run.metrics[measure], default=None)


def _as_good(mse: Any, min_tension: Any, scheduled: Result) -> Any:
    """Whether runs are as precise as the schedule's, and keep both ropes as taut.

    Two structures are two compiled loops, whose last bits differ: tensions are equal to the root of machine epsilon.
    """
    tautness = scheduled.metrics.min_tension * (1 - np.sqrt(np.finfo(float).eps))
    return (mse <= AS_GOOD * scheduled.metrics.mse) & (min_tension >= tautness)
