"""Steady motion of the sampled closed loop, in which the state repeats from sample to sample, by Newton's method.

All states repeat except those that the motion advances: positions by ``v Ts``, drum angles such that the tensions
stay; at v = 0 that is rest. Sensors are perfect and disturbances absent. Newton's method solves for many points in
parallel; a single point is a batch of one. The unknowns are the states and the signals injected at the loop's openings,
so that the derivatives at a point are those of the loop opened at all of `LOOP_OPENINGS`: closing all but one gives
the loop opened there, closing all gives the closed loop.

Constants of the machine that an estimator learns (`Mark.LEARNT`) converge over thousands of samples. Here the estimator
knows their true values (`Estimator.informed`), and they are no states of the linearised loop: the separation of time
scales that is usual for slow adaptation (Sastry and Bodson, *Adaptive Control*, 1989, Chapter 4).
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis.differentiated_sample import DifferentiatedSample, vectorised
from dualwinch.codegen.source.expressions import GRAPHS, built_once
from dualwinch.controllers.parts import Context
from dualwinch.model.linear.operating_point import operating_point_law
from dualwinch.model.plant import blank_state, inner_forces, tensions
from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.simulation.loop.closed_loop import (
    LOOP_OPENINGS,
    ClosedLoop,
    closed_loop,
    initial_loop_state,
    start_function,
)
from dualwinch.simulation.loop.structure import LoopStructure, symbolic_parts
from dualwinch.simulation.sensors import Noise, measure

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

RESIDUAL, STEP = math.sqrt(np.finfo(float).eps), 1e-6
"""Tolerances of convergence relative to a state's size: residual, a state's change over a sample beyond steady motion
and rounding; and the next Newton step.

The residual alone says little about a slow state, such as an integral, which may be far from its steady value.

Rounding is one unit in the last place of each value in the residual (the componentwise backward error of Oettli and
Prager, Numer. Math. 6, 1964): with a stiff rope, rounding of the drum angle amounts to some 1e-7 N. Within the sample
it may be more, such as that of a speed estimate that is multiplied by the damping of drums: below the tolerance
Newton's method goes on as long as every step halves the residual.
"""

ITERATIONS, UNLIMITED_ITERATIONS, LEAST_SQUARES_ITERATIONS = 16, 6, 24
"""Maximum Newton steps: of the first search; of those without limits, for a new start; of those by least squares."""

SINGULAR = 1e-13
"""Singular values of scaled equations below this share of the largest count as zero."""

AMID = 0.2
"""Share of half the track: positions further from the middle are solved for by continuation if necessary."""

NEIGHBOUR = 1e-9
"""Relative distance of the neighbours of a point at which its derivatives are checked for round-off."""

BOUNDLESS = 1e9
"""A limit that is never reached."""

LIMITS = "controller.coordination."
"""Prefix of the keys of tension limits."""

UNLIMITED = {f"{LIMITS}tension_min": -BOUNDLESS, f"{LIMITS}tension_max": BOUNDLESS}
"""Values of parameters that remove tension limits."""

UNGATED = {"controller.trust.gate": BOUNDLESS, "controller.trust.jump": BOUNDLESS}
"""Values that make an estimator with gated measurements accept all of them, and all with full weight."""

PRESSED = 1.0
"""Initial value in N s of a winch integral where the tension command is at its limit: it holds the torque there."""

ROPE_UNIT, POSITION_UNIT = 1e-3, 1e3
"""Units of residuals: kN for changes of inner forces, mm for changes of position beyond ``v Ts``."""

PLANT, LOAD_CELLS, ESTIMATOR = "motion.plant.", "readings.load_cells.", "controller.estimator."
"""Prefixes of the states of plant, load cells and estimator."""


@dataclass(eq=False)
class LoopOperatingPoints:
    """Iterates of Newton's method at s points, or its solutions.

    Attributes:
        parameters, state, outside: (s, parameters), (s, states), (s, exogenous) vectors of the closed loop.
        leaving: (s, 3) signals injected at the openings.
        carried: (s,) the vehicle's motion in m per sample.
        kept_states: (n,) indices of the states of the linearised loop, without learnt and bookkeeping ones.
        repeats: (s,) whether every state repeats there, i.e. convergence.
        facts: (s, 4) force command before and after its limit, and both tensions, in N.
        residual: (s,) largest remaining relative change of a state.
        slopes: (s, n + 3 + f, n + 4) derivatives (`_OpenSample.evaluate`).
    """

    parameters: Floats
    state: Floats
    outside: Floats
    leaving: Floats
    carried: Floats
    kept_states: NDArray[np.intp]
    repeats: Flags
    facts: Floats
    residual: Floats
    slopes: Floats

    @property
    def steady(self) -> Flags:
        """(s,) whether all states repeat, ropes are taut and the force command is within its limits."""
        command, limited, *pulls = self.facts.T
        return self.repeats & (command == limited) & (np.min(pulls, axis=0) > 0)

    @property
    def opened(self) -> tuple[Floats, Floats, Floats, Floats]:
        """A, B, C, D of the loops opened at all of `LOOP_OPENINGS`: ``x+ = A x + B c``, ``returned = C x + D c``.

        Shapes (s, n, n), (s, n, 3), (s, 3, n) and (s, 3, 3).
        """
        n = len(self.kept_states)
        by_state, by_leaving = self.slopes[:, : n + 3, :n], self.slopes[:, : n + 3, n + 1 :]
        return by_state[:, :n], by_leaving[:, :n], by_state[:, n:], by_leaving[:, n:]

    def __getitem__(self, points: NDArray[np.intp]) -> "LoopOperatingPoints":
        return replace(self, **{name: values[points] for name, values in self._of_points().items()})

    def __setitem__(self, points: NDArray[np.intp], other: "LoopOperatingPoints") -> None:
        for name, values in self._of_points().items():
            values[points] = getattr(other, name)

    def _of_points(self) -> dict[str, NDArray[Any]]:
        return {name: values for name, values in vars(self).items() if name != "kept_states"}


def loop_operating_points(
    structure: LoopStructure,
    parameters: Floats,
    x: Floats,
    v: Floats,
    *,
    compiled: bool = True,
    begun: LoopOperatingPoints | None = None,
) -> LoopOperatingPoints:
    """Solve for steady motion at many points.

    1. Newton's method from the state of a perfect controller: no errors, tensions as commanded.
    2. Where that fails: numerical continuation in the position, from mid-track, where both ropes are long and soft
       (Allgower and Georg, *Introduction to Numerical Continuation Methods*).
    3. Where that fails too, and at mid-track: damped least-squares steps, first from the solution of law and estimator
       without limits, then from the perfect controller's state.
    4. So far an estimator that gates measurements accepts all of them. Newton's method from there, with its gates.
    5. Derivatives that are round-off are set to zero (`without_round_off`).

    Args:
        structure: of the closed loop, with ropes that never go slack.
        parameters: (s, parameters) of the closed loop, with perfect sensors and without disturbances.
        x: (s,) positions in m.
        v: (s,) speeds in m/s.
        compiled: whether the sample is compiled; for a few points interpretation is quicker.
        begun: the same points with slightly different parameters: initial guesses where these repeat.

    Raises:
        DualwinchError: no compiler or no usable cache folder.
    """
    sample = open_sample(structure, compiled)
    accepting = _with_values(sample, parameters, UNGATED)
    if begun is None:
        start = _first_guesses(structure, sample, accepting, x, v)
    else:
        start, cold = replace(begun, parameters=accepting), np.flatnonzero(~begun.repeats)
        if len(cold):
            start[cold] = _first_guesses(structure, sample, accepting[cold], x[cold], v[cold])
    solution = _newton(sample, start, ITERATIONS)
    away = np.flatnonzero(~solution.steady & (np.abs(2 * x / _lengths(sample, parameters) - 1) > AMID))
    if len(away):
        mid_track = _lengths(sample, parameters[away]) / 2
        middle = _first_guesses(structure, sample, accepting[away], mid_track, v[away])
        middle = _completed_by_least_squares(sample, middle, _newton(sample, middle, ITERATIONS))
        away, middle = away[middle.steady], middle[np.flatnonzero(middle.steady)]
        if len(away):
            shifted = _newton(sample, _shifted(sample, middle, start[away]), ITERATIONS)
            solution[away[shifted.steady]] = shifted[np.flatnonzero(shifted.steady)]
    solution = _completed_by_least_squares(sample, start, solution)
    if sample.learnt.size:
        solution = _newton(sample, replace(solution, parameters=parameters), ITERATIONS)
    nearby = (
        sample.evaluate(state, solution.outside, solution.parameters, solution.leaving)[2]
        for state in neighbours(solution.state)
    )
    solution.slopes = without_round_off(solution.slopes, *nearby)
    return solution


def _with_values(sample: "_OpenSample", parameters: Floats, values: Mapping[str, float]) -> Floats:
    """(s, parameters) with other values of some; names unknown to the loop are ignored."""
    changed = parameters.copy()
    for name in values.keys() & set(sample.loop.parameters):
        changed[:, sample.loop.parameters.index(name)] = values[name]
    return changed


def _lengths(sample: "_OpenSample", parameters: Floats) -> Floats:
    """Track lengths in m, (s,), for parameters (s, parameters)."""
    return parameters[:, sample.loop.parameters.index("plant.track.length")]


def _shifted(sample: "_OpenSample", solution: LoopOperatingPoints, start: LoopOperatingPoints) -> LoopOperatingPoints:
    """Initial guesses at other positions: the controller states of a solution, positions shifted by the distance."""
    x = sample.loop.states.index(f"{PLANT}x")
    way = start.state[:, [x]] - solution.state[:, [x]]
    state = np.where(sample.controller, solution.state + way * sample.loop.marked(Mark.POSITION), start.state)
    outside = start.outside.copy()
    outside[:, sample.reference] = solution.outside[:, sample.reference] + way[:, 0]
    state = _informed(sample, state, start.parameters)
    return replace(start, state=state, outside=outside, leaving=solution.leaving.copy())


def _completed_by_least_squares(
    sample: "_OpenSample", start: LoopOperatingPoints, solution: LoopOperatingPoints
) -> LoopOperatingPoints:
    """The solutions, completed by damped least-squares steps from both kinds of initial guess where none was found."""
    for limited in (False, True):
        unsolved = np.flatnonzero(~solution.repeats)
        if not len(unsolved):
            break
        begun = start[unsolved] if limited else _without_limits(sample, start[unsolved])
        solution[unsolved] = _newton(sample, begun, LEAST_SQUARES_ITERATIONS, damped=True, least_squares=True)
    return solution


def force_stays(structure: LoopStructure, points: LoopOperatingPoints) -> bool:
    """Whether the force command of the first point stays constant in a simulation.

    It does not if a state that moves with the vehicle lacks `Mark.POSITION`.
    """
    loop, state, outside, parameters = (
        closed_loop(structure),
        points.state[0],
        points.outside[0].copy(),
        points.parameters[0],
    )
    reference, u, force = loop.exogenous.index("reference.x"), loop.columns.index("u"), points.facts[0, 0]
    for _ in range(LASTING):
        command = float(loop.observe(state, outside, parameters)[u])
        if not abs(command - force) <= LASTING_SHARE * abs(force) + LASTING_FORCE:
            return False
        state = _following(loop, state, outside, parameters)
        outside[reference] += points.carried[0]
    return True


def _following(loop: ClosedLoop, state: Floats, outside: Floats, parameters: Floats) -> Floats:
    """The state a sample later, interpreted part by part: with many parts, `ClosedLoop.step` is long."""
    discrete, hold = (vector.full().ravel() for vector in loop.sample(state, outside, parameters))
    motion = state[: loop.move.numel_in("motion")]
    if loop.one_step:
        next_motion, _, valid = loop.one_step(motion, hold, parameters)
        if float(valid) > 0:
            return np.append(next_motion.full().ravel(), discrete)
    for part in range(loop.parts):
        motion = loop.move(motion, hold, part, parameters)[0].full().ravel()
    return np.append(motion, discrete)


LASTING, LASTING_SHARE, LASTING_FORCE = 20, 0.05, 20.0
"""Samples over which the force command of steady motion must stay constant; tolerances: relative, and in N."""


def neighbours(state: Floats) -> tuple[Floats, Floats]:
    """States at the relative distance `NEIGHBOUR` on both sides of given ones (..., states)."""
    way = NEIGHBOUR * np.cos(np.arange(state.shape[-1])) * np.maximum(np.abs(state), 1.0)
    return state + way, state - way


def without_round_off(slopes: Floats, above: Floats, below: Floats) -> Floats:
    """Derivatives in which elements that are zero up to round-off are set to zero, independent of units.

    At an operating point errors and innovations are zero, and so are derivatives with respect to their factors, such as
    adaptive gains. In double precision they may be 1e-26 or 0. An element is taken as
    zero if its sign differs between the two neighbours of the point, or if it differs from both by at least half.
    """
    with np.errstate(invalid="ignore"):  # diverged points
        change = np.minimum(np.abs(above - slopes), np.abs(below - slopes))
    return np.where((np.sign(above) * np.sign(below) < 0) | (2 * change >= np.abs(slopes)), 0.0, slopes)


class _OpenSample:
    """A sample of the loop opened at all of `LOOP_OPENINGS`, with its exact derivatives.

    Attributes:
        loop: the closed loop.
        kept_states: (n,) indices of its states without learnt and bookkeeping ones.
        learnt: (l,) indices of its states that are learnt parameters of the machine.
        plant: indices of the plant's states.
        x: index of the vehicle's position among the kept states.
        strained: (f,) indices among the kept states of positions that advance such that a force stays constant:
            drums, rope nodes and rotors (`model.plant.inner_forces`).
        moving: (n,) which other kept states advance with the vehicle.
        remembers: (n,) which kept states depend on the last sample.
        adapting: (states,) which states belong to law and estimator.
        controller: (states,) which states belong to the controller.
        reference: index of the reference position among the exogenous signals.
        inform: ``(state, parameters) -> learnt`` for many points in columns: the learnt states if the estimator knew
            the machine (`Estimator.informed`).
    """

    def __init__(self, structure: LoopStructure, *, compiled: bool) -> None:
        self.loop = closed_loop(structure)
        self.kept_states = np.flatnonzero(_is_kept(self.loop))
        self.learnt = np.flatnonzero(self.loop.marked(Mark.LEARNT))
        names = [self.loop.states[index] for index in self.kept_states]
        blank = blank_state(structure.plant)
        self.plant = [self.loop.states.index(PLANT + key) for key in leaves(blank)]
        self.x = names.index(f"{PLANT}x")
        self.strained = [names.index(PLANT + key) for key in inner_forces(blank, structure.plant)]
        self.moving = self.loop.marked(Mark.POSITION)[self.kept_states]
        self.moving[self.strained] = False
        self.remembers = np.array([name.startswith(("controller.", "actuator_")) for name in names])
        self.remembers &= ~self.loop.marked(Mark.POSITION, Mark.SPEED)[self.kept_states]
        adapting = ("controller.law.", "controller.estimator.")
        self.adapting = np.array([name.startswith(adapting) for name in self.loop.states])
        self.controller = np.array([name.startswith("controller.") for name in self.loop.states])
        self.reference = self.loop.exogenous.index("reference.x")
        self._forces = vectorised(_inner_forces(structure), compiled)
        opened = closed_loop(structure, openings=tuple(LOOP_OPENINGS))
        self._sample = DifferentiatedSample(
            opened,
            _open_results(structure),
            [
                *(("state", index) for index in self.kept_states.tolist()),
                ("exogenous", self.reference),
                *(("injected", index) for index in range(len(LOOP_OPENINGS))),
            ],
            compiled=compiled,
        )
        self._moving = opened.move.numel_in("motion")
        self._motion_states = self.kept_states[self.kept_states < self._moving]
        self.inform = _informing_function(structure)

    def evaluate(
        self, state: Floats, exogenous: Floats, parameters: Floats, leaving: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Evaluate the sample at s points.

        Returns:
            Values, (s, n + 3 + f): the kept states a sample later, the signals returned to the openings, and the
            changes of the inner forces over the sample. Facts as in `LoopOperatingPoints`. Slopes, (s, n + 3 + f,
            n + 4): the derivatives of the values with respect to kept states, reference position and injected signals.
        """
        motion, at_sample, facts = self._sample(state, exogenous, parameters, leaving)
        before, slopes_before = self._forces(state[:, : self._moving], parameters)
        after, slopes_after = self._forces(motion.values, parameters)
        with np.errstate(over="ignore", invalid="ignore"):  # diverging points
            slopes = slopes_after @ motion.slopes
            slopes[:, :, : len(self._motion_states)] -= slopes_before[:, :, self._motion_states]
            values = motion.values[:, self._motion_states], at_sample.values, after - before
        slopes = motion.slopes[:, self._motion_states], at_sample.slopes, slopes
        return np.concatenate(values, axis=1), facts, np.concatenate(slopes, axis=1)


def _is_kept(loop: ClosedLoop) -> Flags:
    """(states,) which states of the closed loop are those of the linearised one."""
    return ~loop.marked(Mark.BOOKKEEPING, Mark.LEARNT)


@GRAPHS.cached
def open_sample(structure: LoopStructure, compiled: bool) -> _OpenSample:
    """The sample of a structure with its derivatives; compiled, or to be interpreted."""
    return _OpenSample(structure, compiled=compiled)


@built_once
def _open_results(structure: LoopStructure) -> ca.Function:
    """The loop's sample opened at all openings: ``(values, hold, facts)`` for `DifferentiatedSample`.

    Values are the kept states of the controller and its surroundings a sample later, and the returned signals.
    """
    opened = closed_loop(structure, openings=tuple(LOOP_OPENINGS))
    arguments = [ca.SX.sym(name, opened.sample.size1_in(name)) for name in opened.sample.name_in()]
    discrete, hold, returned = opened.sample(*arguments)
    moving = opened.move.numel_in("motion")
    discrete_states = [index - moving for index in np.flatnonzero(_is_kept(opened)).tolist() if index >= moving]
    facts = opened.observe(*arguments)[[opened.columns.index(name) for name in ("u", "u_sat", "F1", "F2")]]
    outputs = {"values": ca.vertcat(discrete[discrete_states], returned), "hold": hold, "facts": facts}
    return ca.Function("open_sample", arguments, [*outputs.values()], opened.sample.name_in(), [*outputs])


@built_once
def _inner_forces(structure: LoopStructure) -> ca.Function:
    """``(state, parameters) -> (forces, slopes)``: the inner forces, with their Jacobian by the plant's state."""
    loop, blank = closed_loop(structure), blank_state(structure.plant)
    state, parameters = ca.SX.sym("state", loop.move.numel_in("motion")), ca.SX.sym("parameters", len(loop.parameters))
    plant = with_leaves(structure.plant, dict(zip(loop.parameters, ca.vertsplit(parameters), strict=True)), "plant.")
    named = dict(zip(loop.states, ca.vertsplit(state), strict=False))
    forces = ca.vertcat(*inner_forces(with_leaves(blank, named, PLANT), plant).values())
    outputs = [ca.densify(forces), ca.densify(ca.jacobian(forces, state))]
    return ca.Function("inner_forces", [state, parameters], outputs, ["state", "parameters"], ["forces", "slopes"])


@built_once
def _informing_function(structure: LoopStructure) -> ca.Function:
    """``informing(state, parameters) -> learnt``: the learnt states if the estimator knew the machine."""
    loop, start = closed_loop(structure), initial_loop_state(structure)
    state, parameters = ca.SX.sym("state", len(loop.states)), ca.SX.sym("parameters", len(loop.parameters))
    values = dict(zip(loop.parameters, ca.vertsplit(parameters), strict=True))
    parts = symbolic_parts(structure, values)
    now = with_leaves(start, dict(zip(loop.states, ca.vertsplit(state), strict=True)))
    nominal = with_leaves(structure.nominal, values, "nominal.")
    sample_time, plant = values["simulation.sample_time"], parts.plant
    pulls = tensions(now.motion.plant, plant, 0.0)
    _, measurement = measure(now.motion.plant, pulls, Noise(), now.readings, plant, parts.sensors, sample_time)
    context = Context(nominal, parts.controller.limits, sample_time)
    estimator, error = parts.controller.estimator, parts.sensors.speed_error
    estimate = leaves(estimator.informed(now.controller.estimator, measurement, plant, error, context), ESTIMATOR)
    learnt = [
        estimate[name] for name, is_learnt in zip(loop.states, loop.marked(Mark.LEARNT), strict=True) if is_learnt
    ]
    return ca.Function("informing", [state, parameters], [ca.vertcat(*learnt)], ["state", "parameters"], ["learnt"])


def _first_guesses(
    structure: LoopStructure, sample: _OpenSample, parameters: Floats, x: Floats, v: Floats
) -> LoopOperatingPoints:
    """Initial guess, the perfect controller: no errors, tensions as commanded."""
    loop, count, n = sample.loop, len(x), len(sample.kept_states)
    values = dict(zip(loop.parameters, parameters.T, strict=True))
    preload, lower = values[f"{LIMITS}preload"], values[f"{LIMITS}tension_min"]
    upper, calm = values[f"{LIMITS}tension_max"] - values[f"{LIMITS}reserve"], np.zeros_like(x)
    of_plant = np.array([column for name, column in values.items() if name.startswith("plant.")])
    point = operating_point_law(structure.plant)(np.array([x, v, preload, calm, calm, lower, upper]), of_plant).full()
    state = start_function(structure)(parameters.T, calm[np.newaxis]).full().T
    state[:, sample.plant] = point[:-4].T
    state[:, loop.marked(Mark.POSITION)], state[:, loop.marked(Mark.SPEED)] = x[:, None], v[:, None]
    outside = np.zeros((count, len(loop.exogenous)))
    outside[:, sample.reference], outside[:, loop.exogenous.index("reference.v")] = x, v
    *_, tau_1, tau_2, F1, F2 = point
    force = F1 - F2
    leaving = np.array([force, tau_1, tau_2]).T
    for name, tension in ((f"{LOAD_CELLS}F1", F1), (f"{LOAD_CELLS}F2", F2)):
        if name in loop.states:
            state[:, loop.states.index(name)] = tension
    for _ in range(2):  # states that remember the last sample, or whether there was one, are consistent after two
        state = _informed(sample, state, parameters)
        following = sample.evaluate(state, outside, parameters, leaving)[0][:, :n]
        state[:, sample.kept_states[sample.remembers]] = following[:, sample.remembers]
    # torque and tension command have the same limit: with the command at its limit, the torque is exactly at its own,
    # and any ripple leaves the integral beyond it, where it holds the torque, as in a run
    if (slow := f"{LIMITS}slow") in loop.states:
        state[:, loop.states.index(slow)] = force
    for winch, command in (("winch_1", preload + force), ("winch_2", preload - force)):
        at_limit = np.where(command / 2 <= lower, -PRESSED, np.where(command / 2 >= upper, PRESSED, 0.0))
        for index, name in enumerate(loop.states):
            if name.startswith(LIMITS) and name.endswith(f"{winch}.integral"):
                state[:, index] = np.where(at_limit, at_limit, state[:, index])
    return LoopOperatingPoints(
        parameters,
        state,
        outside,
        leaving,
        carried=v * values["simulation.sample_time"],
        kept_states=sample.kept_states,
        repeats=np.zeros(count, bool),
        facts=np.full((count, 4), np.nan),
        residual=np.full(count, np.inf),
        slopes=np.full((count, n + 3 + len(sample.strained), n + 4), np.nan),
    )


def _without_limits(sample: _OpenSample, start: LoopOperatingPoints) -> LoopOperatingPoints:
    """Initial guess with law and estimator at their solution without tension limits.

    A law whose integrals are far off would start at its limits, where its slope is zero.
    """
    unlimited = replace(start, parameters=_with_values(sample, start.parameters, UNLIMITED))
    loose = _newton(sample, unlimited, UNLIMITED_ITERATIONS, damped=True).state
    return replace(start, state=np.where(sample.adapting & np.isfinite(loose), loose, start.state))


def _informed(sample: _OpenSample, state: Floats, parameters: Floats) -> Floats:
    """States (s, states) with what the estimator learns of the machine known."""
    state = state.copy()
    if sample.learnt.size:
        state[:, sample.learnt] = sample.inform(state.T, parameters.T).full().T
    return state


def _newton(
    sample: _OpenSample,
    start: LoopOperatingPoints,
    iterations: int,
    *,
    damped: bool = False,
    least_squares: bool = False,
) -> LoopOperatingPoints:
    """Newton's method at all points; points that have converged or diverged are no longer iterated.

    `damped` shortens steps such that the next one is smaller (`_damping`). `least_squares` takes the shortest possible
    step where it is not unique, as at rest with a law that leaves a state undetermined.

    """
    points = start[np.arange(len(start.state))]
    count = len(points.state)
    excess, step_size = np.full(count, np.inf), np.full(count, np.inf)
    active = np.arange(count)
    for _ in range(iterations):
        at = points[active]
        next_values, at.facts, at.slopes = sample.evaluate(at.state, at.outside, at.parameters, at.leaving)
        values = np.hstack([at.state[:, sample.kept_states], at.leaving])
        residual, matrix, counted, unknown = _equations(sample, next_values, values, at)
        sizes, last = np.maximum(np.abs(values), 1.0), excess[active]
        rounding = np.finfo(float).eps * np.einsum("aij,aj->ai", np.abs(matrix), np.abs(values))
        at.residual = np.where(counted, np.abs(residual) / sizes, 0.0).max(axis=1)
        with np.errstate(invalid="ignore"):  # both are infinite for diverging points, and so is `excess`
            significant = np.where(counted, (np.abs(residual) - rounding) / sizes, 0.0).max(axis=1)
        excess[active] = np.where(np.isfinite(matrix).all(axis=(1, 2)), significant, np.inf)
        points[active] = at
        going = np.isfinite(excess[active])
        going &= ~((last < RESIDUAL) & (excess[active] >= last / 2) & (step_size[active] < STEP))
        active = active[going]
        if not len(active):
            break
        at, matrix, unknown, sizes = points[active], matrix[going], unknown[going], sizes[going]
        sizes[:, sample.x] = np.maximum(np.abs(at.outside[:, sample.reference]), 1.0)

        def solved(residual: Floats, matrix: Floats = matrix, unknown: Flags = unknown) -> Floats:
            return _step(matrix, residual, unknown, least_squares=least_squares)

        step = solved(residual[going])
        step_size[active] = (np.abs(step) / sizes).max(axis=1)
        points[active] = _moved(sample, at, _damping(sample, at, step, sizes, solved) * step if damped else step)
    points.repeats = (excess < RESIDUAL) & (step_size < STEP)
    return points


def _moved(sample: _OpenSample, points: LoopOperatingPoints, step: Floats) -> LoopOperatingPoints:
    """Points after a step of the unknowns, in which the reference replaces the vehicle's position."""
    n, state, outside = len(sample.kept_states), points.state.copy(), points.outside.copy()
    outside[:, sample.reference] += step[:, sample.x]
    state[:, sample.kept_states] += np.where(np.arange(n) == sample.x, 0.0, step[:, :n])
    return replace(points, state=state, outside=outside, leaving=points.leaving + step[:, n:])


def _damping(
    sample: _OpenSample, at: LoopOperatingPoints, step: Floats, sizes: Floats, solved: Callable[[Floats], Floats]
) -> Floats:
    """Damping factors (a, 1) of Newton steps, such that the next simplified Newton step is smaller.

    This is the natural monotonicity test, which does not depend on the equations' units (Deuflhard, *Newton Methods
    for Nonlinear Problems*, 3.3): a smooth sign function has almost no slope outside its boundary layer, so that full
    steps would oscillate across it.
    """
    share, full_size = np.ones((len(step), 1)), (np.abs(step) / sizes).max(axis=1, keepdims=True)
    for _ in range(DAMPINGS):
        trial = _moved(sample, at, share * step)
        values, _, trial.slopes = sample.evaluate(trial.state, trial.outside, trial.parameters, trial.leaving)
        residual, *_ = _equations(sample, values, np.hstack([trial.state[:, sample.kept_states], trial.leaving]), trial)
        following = solved(residual)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            size = (np.abs(following) / sizes).max(axis=1, keepdims=True)
            bent = (np.abs(following - (1 - share) * step) / sizes).max(axis=1, keepdims=True)
            too_far = ~(size <= (1 - share / 4) * full_size) & (full_size > STEP) & np.isfinite(full_size)
            next_share = np.clip(share**2 * full_size / (2 * bent), share / 10, share / 2)
        if not too_far.any():
            break
        share = np.where(too_far, np.where(np.isfinite(next_share), next_share, share / 10), share)
    return share


DAMPINGS = 8
"""Maximum number of reductions of a Newton step."""


def _equations(
    sample: _OpenSample, next_values: Floats, values: Floats, at: LoopOperatingPoints
) -> tuple[Floats, Floats, Flags, Flags]:
    """Equations for the n kept states and the signals injected at the openings.

    The vehicle's position is given; the reference position is unknown in its place.

    Returns:
        Residuals (a, n + 3), Jacobians (a, n + 3, n + 3), which values any equation depends on, and which are unknown.
    """
    n, strained, moving = len(sample.kept_states), sample.strained, np.append(sample.moving, [False] * 3)
    units = np.where(moving, POSITION_UNIT, 1.0)
    residual = (next_values[:, : n + 3] - values - np.where(moving, at.carried[:, None], 0.0)) * units
    residual[:, strained] = next_values[:, n + 3 :] * ROPE_UNIT
    every = at.slopes[:, : n + 3].copy()
    every[:, :n, :n] -= np.eye(n)
    every[:, n:, n + 1 :] -= np.eye(3)
    every *= units[:, None]
    every[:, strained] = at.slopes[:, n + 3 :] * ROPE_UNIT
    matrix = np.delete(every, n, axis=2)
    # a state that nothing depends on may grow without limit; one that nothing moves, such as an integral without a
    # gain, keeps its initial value
    counted, is_driven = (matrix != 0).any(axis=1), (matrix != 0).any(axis=2)
    counted[:, n:] = True
    unknown = counted & is_driven
    matrix[:, :, sample.x], unknown[:, sample.x] = every[:, :, n], True
    return residual, matrix, counted, unknown


@np.errstate(over="ignore", invalid="ignore")  # diverging points
def _step(matrix: Floats, residual: Floats, unknown: Flags, *, least_squares: bool) -> Floats:
    """Newton steps, solved with scaled rows and columns: zero for known values, NaN for singular matrices."""
    step, some = np.zeros(residual.shape), np.flatnonzero(unknown.any(axis=0))
    if not len(some):
        return step
    matrix, residual, unknown = matrix[:, some][:, :, some], residual[:, some], unknown[:, some]
    matrix = np.where(unknown[:, :, None] & unknown[:, None, :], matrix, 0.0)
    columns = np.abs(matrix).max(axis=1)
    columns = np.where(columns > 0, columns, 1.0)
    matrix /= columns[:, None, :]
    rows = np.abs(matrix).max(axis=2)
    rows = np.where(rows > 0, rows, 1.0)
    matrix /= rows[:, :, None]
    index = np.arange(matrix.shape[1])
    matrix[:, index, index] += ~unknown
    right = np.where(unknown, -residual / rows, 0.0)
    if least_squares:
        pairs = zip(matrix, right, strict=True)
        step[:, some] = np.array([np.linalg.lstsq(*pair, rcond=SINGULAR)[0] for pair in pairs]) / columns
        return step
    try:
        solved = np.linalg.solve(matrix, right[..., None])[..., 0]
    except np.linalg.LinAlgError:  # a law at its limits has no slope
        singular = np.linalg.slogdet(matrix)[0] == 0
        matrix[singular] = np.eye(matrix.shape[1])
        solved = np.linalg.solve(matrix, right[..., None])[..., 0]
        solved[singular] = np.nan
    # where rounding alone keeps a matrix from being singular, its solution is as large as that is small
    solved[np.abs(solved).max(axis=1) * SINGULAR > np.abs(right).max(axis=1)] = np.nan
    step[:, some] = solved / columns
    return step
