"""Actuator authority: the force that a run requires of its motors, and the least error that their limits allow.

Where the reference requires more force than the motors can deliver, no gains help. The least error is the solution of
an optimal control problem: torques within their limits, chosen with full knowledge of the plant and of future
disturbances, on inextensible ropes. A real controller knows less, and has elastic ropes and noisy sensors.
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


def outside_at(experiment: Experiment, every: int) -> Floats:
    """Inputs of `force_law` at every `every`-th sample, (7, instants)."""
    sea = np.array([signal[::every] for signal in sea_signals(experiment)])
    return np.vstack([_reference_at(experiment, every), sea])


def _reference_at(experiment: Experiment, every: int) -> Floats:
    """Time, position, speed and acceleration of the reference at every `every`-th sample, (4, instants)."""
    t = np.arange(0, experiment.samples, every) * experiment.simulation.sample_time
    reference = setpoint(t, experiment.reference)
    return np.array([t, reference.x, reference.v, np.broadcast_to(reference.a, len(t))], dtype=np.float64)


@dataclass(frozen=True)
class ForceDemand:
    """The force that a run requires of its motors.

    Attributes:
        share: largest required force over the available force.
        shortfall: largest distance in m by which the vehicle falls behind when it uses the available force until it
            has caught up; 0: it never does. Less drag at lower speed is neglected.
    """

    share: float
    shortfall: float


LANES, PIECE = 16, 64
"""Runs whose disturbances are drawn in parallel, and instants drawn at a time, so that they fit into the cache."""


def force_demands(scenarios: Scenarios, every: int = 50) -> list[ForceDemand]:
    """The force that each of many runs requires of its motors; disturbances are drawn in vector lanes.

    The required net rope force follows from the equations of vehicle and drums (paper Sections 2.3, 2.4) with
    inextensible ropes: masses times the reference's acceleration, plus friction, drag and vortex forces at its speed.
    The motors can deliver ``tension_max - tension_min`` in either direction (paper Section 3.1.1). Disturbances vary
    over seconds, so that every `every`-th sample is evaluated.

    Raises:
        DualwinchError: no compiler or no usable cache folder.
        KeyboardInterrupt: interrupted.
    """
    law, fill, demands = compile_function(force_law()), compile_fill(find_compiler()), dict[int, ForceDemand]()

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
            demands[place] = demand(place, shared, motion, sea[:, :, lane])

    blocks = list[tuple[Experiment, Floats, list[int], list[Signals]]]()
    for group in scenario_groups(scenarios):
        shared, places = group.experiment, group.members.tolist()
        motion = _reference_at(shared, every).T
        runs = exogenous_sources(shared, group.columns, len(places), names=Sea._fields)
        firsts = range(0, len(places), LANES)
        blocks += [(shared, motion, places[start : start + LANES], runs[start : start + LANES]) for start in firsts]
    map_all(block, blocks)
    return [demands[place] for place in range(len(scenarios))]


def _largest_shortfall(force: Floats, limit: float, step: float, mass: float) -> float:
    """Largest lag in m of a mass that gets at most `limit` of a force in N, sampled every `step` s."""
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
    """Parameters of `force_law`: those of the simulated plant and of the vortices."""
    return _numbers(experiment.plant, experiment.disturbance)


def _numbers(plant: Plant, disturbance: Disturbance) -> Floats:
    return np.array([*numbers(rigid_plant(plant)).values(), *numbers(disturbance).values()], float)


@built_once
def force_law() -> ca.Function:
    """``force(outside, parameters)``; `outside` is time, position, speed, acceleration and disturbances (`Sea`)."""
    outside, parameters, disturbance, plant = outside_symbols()
    _, _, v, a, *_ = ca.vertsplit(outside)
    force = pull(outside, disturbance, plant)
    for winch, way in ((plant.winch_1, 1), (plant.winch_2, -1)):
        turn = way / winch.drum_radius
        force += turn * winch.gear_ratio * motor_torque(way * v, way * a, 0.0, winch)
    return ca.Function("force", [outside, parameters], [force])


def outside_symbols() -> tuple[ca.SX, ca.SX, Disturbance, Plant]:
    """Symbols for the inputs and parameters of `force_law`, and the disturbance and plant made of its parameters."""
    plant, p = symbols(Plant(), "p")
    vortices, outside = numbers(Disturbance()), ca.SX.sym("outside", 7)
    switches = ca.SX.sym("switches", len(vortices))
    disturbance = with_leaves(Disturbance(), dict(zip(vortices, ca.vertsplit(switches), strict=True)))
    return outside, ca.vertcat(p, switches), disturbance, plant


def pull(outside: ca.SX, disturbance: Disturbance, plant: Plant) -> Scalar:
    """Net rope force F_1 − F_2 in N that the vehicle's motion requires (paper Section 2.3)."""
    t, x, v, a, push, current, load = ca.vertsplit(outside)
    vehicle = plant.vehicle
    # the vortex phase: the frequency is proportional to the speed, so that its time integral depends on x alone
    vortex = vortex_force(t, v, vortex_frequency(x, disturbance, vehicle), disturbance, vehicle)
    free = vehicle_acceleration(v, 0.0, DisturbanceInputs(push + vortex, current, load), vehicle)
    return inertia(vehicle) * (a - free)


def motor_torque(v: Scalar, a: Scalar, tension: Scalar, winch: Winch) -> Scalar:
    """Motor torque in N m for winding rope at v in m/s and a in m/s² against a tension in N (paper Section 2.4)."""
    idle = drum_acceleration(v / winch.drum_radius, tension, 0.0, winch)
    return total_inertia(winch) / winch.gear_ratio * (a / winch.drum_radius - idle)


def moved_by(outside: ca.SX, deviation: ca.SX, step: float) -> ca.SX:
    """Inputs of `force_law` for a motion with a deviation in m (1, instants) from the reference.

    Without the first and last instant, as speed and acceleration are central differences.
    """
    t, x, v, a, *sea = ca.vertsplit(outside[:, 1:-1])
    rate, bend = central_differences(deviation, step)
    return ca.vertcat(t, x + deviation[:, 1:-1], v + rate, a + bend, *sea)


def central_differences(values: ca.SX, step: float) -> tuple[ca.SX, ca.SX]:
    """First and second time derivatives of values `step` s apart by central differences, without both ends."""
    before, now, after = values[:, :-2], values[:, 1:-1], values[:, 2:]
    return (after - before) / (2 * step), (after - 2 * now + before) / step**2


CENTIMETRES = 1e2
"""Scale of the deviation in the solver."""

INTERIOR_POINT = {
    "mu_init": 1e-3,
    "max_iter": 500,
    **dict.fromkeys(("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac"), 1e-4),
}
"""IPOPT options for a feasible initial guess: the solver starts close to it instead of pushing it off its bounds."""


def least_mse(experiment: Experiment, *, anticipating: bool = False, every: int = 40) -> float:
    """Lower bound of the mean square error in m² of a run under any controller; 0 within the actuators' authority.

    Minimises the mean of e² over the vehicle's motion, subject to a required force (`force_demands`) of at most
    ``tension_max - tension_min`` in either direction (paper Section 3.1.1), with speed and acceleration by central
    differences. Drag and friction make the problem non-convex. IPOPT starts from a feasible motion
    (`saturated_motion`), without which it often finds none.

    Args:
        experiment: the experiment.
        anticipating: whether the vehicle may leave its reference in advance of a shortage of force. A controller
            without preview stays on it as long as it can.
        every: samples per step of the optimal control problem.

    Returns:
        The bound; NaN if the authority is exceeded and the solver finds no optimum.
    """
    limit = experiment.controller.limits.strength
    outside, parameters = outside_at(experiment, every), force_parameters(experiment)
    infeasible = np.abs(np.asarray(force_law()(outside, parameters), float).ravel()) > limit
    if not infeasible.any():
        return 0.0
    instants, step = outside.shape[1], every * experiment.simulation.sample_time
    solver = _solver(instants, step)
    numbers = ca.vertcat(ca.vec(ca.DM(outside)), parameters, limit)
    until = 2 if anticipating else max(2, int(infeasible.argmax()) + 1)  # position and speed at the start
    bounds = [*[0.0] * until, *[np.inf] * (instants - until)]
    start = CENTIMETRES * saturated_motion(outside, parameters, limit, step)
    solution = solver(x0=start, p=numbers, lbx=[-bound for bound in bounds], ubx=bounds, lbg=-1.0, ubg=1.0)
    return float(solution["f"]) / CENTIMETRES**2 if solver.stats()["success"] else np.nan


def saturated_motion(outside: Floats, parameters: Floats, limit: float, step: float, rate: float = 1.0) -> Floats:
    """A motion within the motors' force limit in N: deviations in m from the reference at every instant.

    From instant to instant the deviation decays exponentially at a rate in 1/s, unless that requires more than the
    available force; then all the available force is used. `outside` are reference and disturbances, (7, instants), with
    the parameters of `force_law`; instants are `step` s apart.
    """
    law, force_limit = force_law(), 0.999 * limit
    deviation = np.zeros(outside.shape[1])
    for k in range(1, len(deviation) - 1):
        before, now = deviation[k - 1 : k + 1]

        def force(after: float, k: int = k, before: float = before, now: float = now) -> float:
            column = outside[:, k].copy()
            column[1:4] += now, (after - before) / (2 * step), (after - 2 * now + before) / step**2
            return float(law(column, parameters))

        after = now * (1 - rate * step)
        demand = force(after)
        if abs(demand) > force_limit:
            way, reach = np.sign(demand), step**2
            while way * force(after - way * reach) > force_limit:
                reach *= 2
            bracket = (after - way * reach, after)
            after = root_scalar(
                lambda value, way=way, force=force: way * force(value) - force_limit, bracket=bracket
            ).root
        deviation[k + 1] = after
    return deviation


@dataclass(frozen=True)
class LeastErrors:
    """Lower bounds of the mean square errors of many runs under any controller.

    Attributes:
        without_foresight: (runs,) in m², for controllers without preview; 0 within the actuators' authority, NaN where
            that is exceeded and no bound was found.
        with_foresight: likewise, for controllers with full preview.
    """

    without_foresight: Floats
    with_foresight: Floats

    @property
    def infeasible(self) -> int:
        """Number of runs that require more force than the motors can deliver."""
        return int((self.without_foresight != 0).sum())

    @property
    def unknown(self) -> int:
        """Number of infeasible runs without a bound."""
        return int((~self._known).sum())

    @property
    def means(self) -> tuple[float, float]:
        """Mean of both bounds in m² over the runs with known bounds; NaN without any."""
        if not self._known.any():
            return np.nan, np.nan
        return float(self.without_foresight[self._known].mean()), float(self.with_foresight[self._known].mean())

    @property
    def unknown_words(self) -> str:
        """A sentence on the runs without a bound; empty if there are none."""
        if not self.unknown:
            return ""
        many = "scenario" if self.unknown == 1 else "scenarios"
        return f"In {self.unknown} infeasible {many} the bound could not be found; the mean is over the others."

    @property
    def _known(self) -> NDArray[np.bool_]:
        return np.isfinite(self.without_foresight) & np.isfinite(self.with_foresight)


def infeasible_words(count: int) -> str:
    """A sentence, without full stop, on the number of infeasible scenarios and what that means."""
    are, need = ("is", "it needs") if count == 1 else ("are", "they need")
    return f"{count} of the scenarios {are} infeasible: {need} more force than the motors can deliver"


def least_errors(experiments: Sequence[Experiment], progress: Progress = no_progress) -> LeastErrors:
    """Lower bounds of the errors of many runs (`least_mse`)."""
    errors = []
    for count, experiment in enumerate(experiments, 1):
        blind = least_mse(experiment)
        errors.append((blind, least_mse(experiment, anticipating=True) if blind != 0 else 0.0))
        progress(count / len(experiments))
    blind_errors, with_foresight = np.array(errors, float).reshape(-1, 2).T
    return LeastErrors(blind_errors, with_foresight)


@GRAPHS.cached
def _solver(instants: int, step: float) -> ca.Function:
    """Solver of the optimal control problem: deviations from the reference in cm at instants `step` s apart."""
    law = force_law()
    deviation, limit = ca.SX.sym("deviation", 1, instants), ca.SX.sym("limit")
    outside, parameters = ca.SX.sym("outside", 7, instants), ca.SX.sym("parameters", law.numel_in(1))
    motion = moved_by(outside, deviation / CENTIMETRES, step)
    problem = {
        "x": ca.vec(deviation),
        "p": ca.vertcat(ca.vec(outside), parameters, limit),
        "f": ca.sumsqr(deviation) / instants,
        "g": ca.vec(law(motion, parameters)) / limit,
    }
    quiet = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", **INTERIOR_POINT}}
    return ca.nlpsol("least_mse", "ipopt", problem, quiet)
