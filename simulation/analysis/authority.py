"""The actuators' authority: the force that a run asks of its motors, and the error that their limit leaves at least.

Where the reference asks for more force than the motors can give, no gains help. The best that could be done is an
optimal control problem: torques within their limits, chosen with full knowledge of the plant and of all that the sea
will do, on ropes that do not stretch. A real controller knows less, and has elastic ropes and noisy sensors in between.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root_scalar

from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.drivers.signals.signals import Signals, compile_fill
from dualwinch.codegen.native import compile as compile_function
from dualwinch.codegen.source.expressions import GRAPHS, built_once
from dualwinch.model.disturbance import Disturbance, vortex_force, vortex_frequency
from dualwinch.model.plant import DisturbanceInputs, Plant, rigid_plant, vehicle_acceleration
from dualwinch.model.quantities.tree import numbers, symbols, with_leaves
from dualwinch.model.reference import setpoint
from dualwinch.model.scalar import Scalar
from dualwinch.model.vehicle import inertia
from dualwinch.model.winch import Winch, drum_acceleration, total_inertia
from dualwinch.simulation.batch.scenarios import Scenarios, scenario_groups
from dualwinch.simulation.batch.workers import map_all
from dualwinch.simulation.exogenous.signals import Sea, exogenous_sources, sea_signals
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.progress import Progress, no_progress
from dualwinch.simulation.scenario import Scenario

Floats = NDArray[np.float64]


def required_force(experiment: Experiment, every: int = 50) -> Floats:
    """Net force in N, at the ropes, that the motors have to give at every so many samples (instants,).

    It follows from the equations of vehicle and drums (paper Sections 2.3, 2.4) with ropes that do not stretch: masses
    times the reference's acceleration, and friction, drag and vortices at its speed. The motors can give
    ``tension_max - tension_min`` either way (paper Section 3.1.1).

    Args:
        experiment: what is run.
        every: samples between two instants; what the sea does takes seconds.
    """
    return np.asarray(force_law()(outside_at(experiment, every), force_parameters(experiment)), float).ravel()


def outside_at(experiment: Experiment, every: int) -> Floats:
    """What `force_law` receives at every so many samples, (7, instants)."""
    sea = np.array([signal[::every] for signal in sea_signals(experiment)])
    return np.vstack([_reference_at(experiment, every), sea])


def _reference_at(experiment: Experiment, every: int) -> Floats:
    """Time, position, speed and acceleration of the reference at every so many samples, (4, instants)."""
    t = np.arange(0, experiment.samples, every) * experiment.simulation.sample_time
    wanted = setpoint(t, experiment.reference)
    return np.array([t, wanted.x, wanted.v, np.broadcast_to(wanted.a, len(t))], dtype=np.float64)


@dataclass(frozen=True)
class ForceDemand:
    """The force that a run asks of its motors.

    Attributes:
        share: the largest, as a share of what they can give.
        shortfall: how far in m the vehicle falls behind at most, with all the force there is until it has caught up;
            0: it need not. From the force alone: that a slower vehicle has less drag is left out.
    """

    share: float
    shortfall: float


LANES, PIECE = 16, 64
"""Runs whose seas are drawn side by side, and instants that are drawn at a time, so that they stay in the cache."""


def force_demands(scenarios: Scenarios, every: int = 50) -> list[ForceDemand]:
    """The force that each of many runs asks of its motors; seas are drawn in vector lanes.

    Args:
        scenarios: the runs.
        every: as of `required_force`.

    Raises:
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted.
    """
    law, fill, found = compile_function(force_law()), compile_fill(find_compiler()), dict[int, ForceDemand]()

    def demand(place: int, shared: Experiment, motion: Floats, sea: Floats) -> ForceDemand:
        scenario = scenarios[place]
        draws = scenario.draws if isinstance(scenario, Scenario) else {}
        plant = with_leaves(shared.plant, draws, "plant.")
        disturbance = with_leaves(shared.disturbance, draws, "disturbance.")
        force = np.asarray(law(np.hstack([motion, sea]), _numbers(plant, disturbance)))
        limit = shared.controller.limits.strength
        share = float(np.abs(force).max()) / limit
        step, mass = every * shared.simulation.sample_time, inertia(plant.vehicle)
        return ForceDemand(share, _largest_shortfall(force, limit, step, mass) if share > 1 else 0.0)

    def block(given: tuple[Experiment, Floats, list[int], list[Signals]]) -> None:
        shared, motion, places, runs = given
        sea = np.concatenate([piece[::every] for piece in fill.in_lanes(runs, PIECE * every, shared.samples)])
        for lane, place in enumerate(places):
            found[place] = demand(place, shared, motion, sea[:, :, lane])

    blocks = list[tuple[Experiment, Floats, list[int], list[Signals]]]()
    for group in scenario_groups(scenarios):
        shared, places = group.experiment, group.members.tolist()
        motion = _reference_at(shared, every).T
        runs = exogenous_sources(shared, group.columns, len(places), names=Sea._fields)
        firsts = range(0, len(places), LANES)
        blocks += [(shared, motion, places[first : first + LANES], runs[first : first + LANES]) for first in firsts]
    map_all(block, blocks)
    return [found[place] for place in range(len(scenarios))]


def within_authority(scenarios: Scenarios) -> NDArray[np.bool_]:
    """(n,) whether each run stays within the actuators' authority: it asks for no more force than the motors can give.

    Raises:
        DualwinchError, KeyboardInterrupt: as of `force_demands`.
    """
    return np.array([demand.share <= 1 for demand in force_demands(scenarios)], bool)


def _largest_shortfall(force: Floats, limit: float, step: float, mass: float) -> float:
    """How far in m a mass falls behind at most: it gets at most `limit` of the force in N, given every `step` s."""
    furthest = behind = rate = 0.0
    way = 1.0
    for value in force.tolist():
        if behind == 0:
            way = 1.0 if value > 0 else -1.0
        rate += step * (way * value - limit) / mass
        behind += step * rate
        if behind <= 0:
            behind = rate = 0.0
        furthest = max(furthest, behind)
    return furthest


def force_parameters(experiment: Experiment) -> Floats:
    """The parameters of `force_law`: the simulated plant's, and the vortices'."""
    return _numbers(experiment.plant, experiment.disturbance)


def _numbers(plant: Plant, disturbance: Disturbance) -> Floats:
    return np.array([*numbers(rigid_plant(plant)).values(), *numbers(disturbance).values()], float)


@built_once
def force_law() -> ca.Function:
    """``force(outside, parameters)`` of time, position, speed, acceleration and what acts on the vehicle (`Sea`)."""
    outside, parameters, disturbance, plant = outside_symbols()
    _, _, v, a, *_ = ca.vertsplit(outside)
    force = pull(outside, disturbance, plant)
    for winch, way in ((plant.winch_1, 1), (plant.winch_2, -1)):
        turn = way / winch.drum_radius
        force += turn * winch.gear_ratio * motor_torque(way * v, way * a, 0.0, winch)
    return ca.Function("force", [outside, parameters], [force])


def outside_symbols() -> tuple[ca.SX, ca.SX, Disturbance, Plant]:
    """What `force_law` receives, as symbols, and disturbance and plant that are made of its parameters."""
    plant, p = symbols(Plant(), "p")
    vortices, outside = numbers(Disturbance()), ca.SX.sym("outside", 7)
    switches = ca.SX.sym("switches", len(vortices))
    disturbance = with_leaves(Disturbance(), dict(zip(vortices, ca.vertsplit(switches), strict=True)))
    return outside, ca.vertcat(p, switches), disturbance, plant


def pull(outside: ca.SX, disturbance: Disturbance, plant: Plant) -> Scalar:
    """Net force F_1 − F_2 in N that the vehicle's motion asks of the ropes (paper Section 2.3)."""
    t, x, v, a, push, current, load = ca.vertsplit(outside)
    vehicle = plant.vehicle
    # the integral of the vortex frequency, which is proportional to the speed, over the way to x
    vortex = vortex_force(t, v, vortex_frequency(x, disturbance, vehicle), disturbance, vehicle)
    free = vehicle_acceleration(v, 0.0, DisturbanceInputs(push + vortex, current, load), vehicle)
    return inertia(vehicle) * (a - free)


def motor_torque(v: Scalar, a: Scalar, tension: Scalar, winch: Winch) -> Scalar:
    """Motor torque in N m that winds rope at v m/s and a m/s² against a tension in N (paper Section 2.4)."""
    idle = drum_acceleration(v / winch.drum_radius, tension, 0.0, winch)
    return total_inertia(winch) / winch.gear_ratio * (a / winch.drum_radius - idle)


def moved_by(outside: ca.SX, deviation: ca.SX, step: float) -> ca.SX:
    """What `force_law` receives of a motion that deviates in m (1, instants) from its reference.

    It is known between the first and the last instant; speed and acceleration are by central differences.
    """
    t, x, v, a, *sea = ca.vertsplit(outside[:, 1:-1])
    rate, bend = central_differences(deviation, step)
    return ca.vertcat(t, x + deviation[:, 1:-1], v + rate, a + bend, *sea)


def central_differences(values: ca.SX, step: float) -> tuple[ca.SX, ca.SX]:
    """First and second derivative between the first and the last of values that are `step` s apart."""
    before, now, after = values[:, :-2], values[:, 1:-1], values[:, 2:]
    return (after - before) / (2 * step), (after - 2 * now + before) / step**2


CENTIMETRES = 1e2
"""Scale of the deviation in the solver."""

INTERIOR_POINT = {
    "mu_init": 1e-3,
    "max_iter": 500,
    **dict.fromkeys(("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac"), 1e-4),
}
"""Options of IPOPT for a start that is feasible: little is done to lead it away from there."""


def least_mse(experiment: Experiment, *, anticipating: bool = False, every: int = 40) -> float:
    """Lower bound of the mean square error in m² of a run, whatever controls it; 0 where the motors can hold it.

    Minimises the mean of e² over the vehicle's motion, where the net force that it takes (`required_force`) is at most
    ``tension_max - tension_min`` either way (paper Section 3.1.1); speed and acceleration by central differences. The
    problem is not convex, drag and friction being what they are; the search begins at a motion that is feasible
    (`saturated_motion`), without which it often ends at none.

    Args:
        experiment: what is run.
        anticipating: whether the vehicle may leave its reference beforehand, for the sake of what is to come. A
            controller without a preview stays on it as long as it can.
        every: samples in a step of the optimal control problem.

    Returns:
        The bound; NaN where the motors cannot hold the run and the solver finds no optimum.
    """
    limit = experiment.controller.limits.strength
    outside, parameters = outside_at(experiment, every), force_parameters(experiment)
    beyond = np.abs(np.asarray(force_law()(outside, parameters), float).ravel()) > limit
    if not beyond.any():
        return 0.0
    instants, step = outside.shape[1], every * experiment.simulation.sample_time
    solver = _solver(instants, step)
    numbers = ca.vertcat(ca.vec(ca.DM(outside)), parameters, limit)
    until = 2 if anticipating else max(2, int(beyond.argmax()) + 1)  # position and speed at the start
    bounds = [*[0.0] * until, *[np.inf] * (instants - until)]
    start = CENTIMETRES * saturated_motion(outside, parameters, limit, step)
    found = solver(x0=start, p=numbers, lbx=[-bound for bound in bounds], ubx=bounds, lbg=-1.0, ubg=1.0)
    return float(found["f"]) / CENTIMETRES**2 if solver.stats()["success"] else np.nan


def saturated_motion(outside: Floats, parameters: Floats, limit: float, step: float, rate: float = 1.0) -> Floats:
    """A motion within the motors' force: deviations in m from the reference at every instant.

    Instant by instant the deviation decays, unless that takes more force than there is; then it takes what there is.

    Args:
        outside: the reference and what acts on the vehicle, (7, instants).
        parameters: of `force_law`.
        limit: the force in N that the motors can give.
        step: time in s between two instants.
        rate: of the decay in 1/s.
    """
    law, given = force_law(), 0.999 * limit
    deviation = np.zeros(outside.shape[1])
    for k in range(1, len(deviation) - 1):
        before, now = deviation[k - 1 : k + 1]

        def force(after: float, k: int = k, before: float = before, now: float = now) -> float:
            moved = outside[:, k].copy()
            moved[1:4] += now, (after - before) / (2 * step), (after - 2 * now + before) / step**2
            return float(law(moved, parameters))

        after = now * (1 - rate * step)
        asked = force(after)
        if abs(asked) > given:
            way, reach = np.sign(asked), step**2
            while way * force(after - way * reach) > given:
                reach *= 2
            bracket = (after - way * reach, after)
            after = root_scalar(lambda value, way=way, force=force: way * force(value) - given, bracket=bracket).root
        deviation[k + 1] = after
    return deviation


@dataclass(frozen=True)
class LeastErrors:
    """Lower bounds of the mean square errors of many runs, whatever controls them.

    Attributes:
        blind: (runs,) in m², of controllers that do not foresee what is to come; 0 within the actuators' authority,
            NaN where that is exceeded and no bound could be found.
        foreseeing: likewise, of controllers that do.
    """

    blind: Floats
    foreseeing: Floats

    @property
    def infeasible(self) -> int:
        """Number of runs that ask for more force than the motors can give."""
        return int((self.blind != 0).sum())

    @property
    def unknown(self) -> int:
        """Number of runs among them whose bounds could not be found."""
        return int((~self._known).sum())

    @property
    def means(self) -> tuple[float, float]:
        """Mean of both bounds in m² over the runs whose bounds are known; NaN without any."""
        if not self._known.any():
            return np.nan, np.nan
        return float(self.blind[self._known].mean()), float(self.foreseeing[self._known].mean())

    @property
    def unknown_words(self) -> str:
        """In how many runs no bound could be found, in a sentence; empty where all are known."""
        if not self.unknown:
            return ""
        many = "scenario" if self.unknown == 1 else "scenarios"
        return f"In {self.unknown} infeasible {many} the bound could not be found; the mean is over the others."

    @property
    def _known(self) -> NDArray[np.bool_]:
        return np.isfinite(self.blind) & np.isfinite(self.foreseeing)


def infeasible_words(count: int) -> str:
    """That so many of some scenarios are infeasible, and what that means: a sentence without its full stop."""
    are, need = ("is", "it needs") if count == 1 else ("are", "they need")
    return f"{count} of the scenarios {are} infeasible: {need} more force than the motors can deliver"


def least_errors(experiments: Sequence[Experiment], progress: Progress = no_progress) -> LeastErrors:
    """Lower bounds of the errors of many runs (`least_mse`).

    Args:
        experiments: the runs.
        progress: called now and then with the share that is done.
    """
    found = []
    for done, experiment in enumerate(experiments, 1):
        blind = least_mse(experiment)
        found.append((blind, least_mse(experiment, anticipating=True) if blind != 0 else 0.0))
        progress(done / len(experiments))
    blind, foreseeing = np.array(found, float).reshape(-1, 2).T
    return LeastErrors(blind, foreseeing)


@GRAPHS.cached
def _solver(instants: int, step: float) -> ca.Function:
    """The optimal control problem: deviations from the reference in cm at so many instants, `step` s apart."""
    law = force_law()
    deviation, limit = ca.SX.sym("deviation", 1, instants), ca.SX.sym("limit")
    outside, parameters = ca.SX.sym("outside", 7, instants), ca.SX.sym("parameters", law.numel_in(1))
    moved = moved_by(outside, deviation / CENTIMETRES, step)
    problem = {
        "x": ca.vec(deviation),
        "p": ca.vertcat(ca.vec(outside), parameters, limit),
        "f": ca.sumsqr(deviation) / instants,
        "g": ca.vec(law(moved, parameters)) / limit,
    }
    quiet = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", **INTERIOR_POINT}}
    return ca.nlpsol("least_mse", "ipopt", problem, quiet)
