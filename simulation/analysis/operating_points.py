"""Operating points of the sampled closed loop: steady motion, in which the state repeats from sample to sample.

All states repeat except those that the motion advances: positions by ``v Ts``, drum angles such that the tensions
stay; at v = 0 that is rest. Sensors are perfect and disturbances absent. Newton's method solves for many points in
parallel; a single point is a batch of one. The unknowns are the states and the signals injected at the loop's openings,
so that the derivatives at a point are those of the loop opened at all of `LOOP_OPENINGS`: closing all but one gives
the loop opened there, closing all gives the closed loop.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen import native
from dualwinch.codegen.source.expressions import built_once
from dualwinch.model.arguments import instance, one_number
from dualwinch.model.disturbance import Disturbance
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.operating_point import OperatingPoint, operating_point_law, resistance
from dualwinch.model.linear.operating_point import operating_point as of_plant
from dualwinch.model.plant import DisturbanceInputs, Plant, blank_state, inner_forces
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.ropes import Creep
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import LOOP_OPENINGS, ClosedLoop, closed_loop, start_function
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.prepare import prepare

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

RESIDUAL, STEP = 1e-10, 1e-6
"""Tolerances of convergence relative to a state's size: residual, a state's change over a sample beyond steady motion
and rounding; and the next Newton step.

The residual alone says little about a slow state, such as an integral, which may be far from its steady value.
Rounding is one unit in the last place of each value in the residual (the componentwise backward error of Oettli and
Prager, Numer. Math. 6, 1964): with a stiff rope, rounding of the drum angle amounts to some 1e-7 N.
"""

ITERATIONS, DAMPED_ITERATIONS, UNLIMITED_ITERATIONS, LEAST_SQUARES_ITERATIONS = 16, 40, 6, 24
"""Maximum Newton steps: of the first search; of damped ones with learnt states held; of those without limits, for a new
start; of those by least squares."""

AMID = 0.2
"""Share of half the track: positions further from the middle are solved for by continuation if necessary."""

ROUNDS = 6
"""Maximum number of alternations between learnt states and all others."""

STANDSTILL = 1e-10
"""Relative change of a state over a sample that counts as none: at 1 ms, the state would take a hundred days.

Speeds known to 1e-14 m make a wheel's scale, which nothing determines at rest, depend on a position by up to 1e-11.
"""

NEIGHBOUR = 1e-9
"""Relative distance of the neighbours of a point at which its derivatives are checked for round-off."""

BOUNDLESS = 1e9
"""A limit that is never reached."""

LIMITS = "controller.coordination."
"""Prefix of the keys of tension limits."""

UNLIMITED = {f"{LIMITS}tension_min": -BOUNDLESS, f"{LIMITS}tension_max": BOUNDLESS}
"""Values of parameters that remove tension limits."""

UNGATED = {"controller.trust.gate": BOUNDLESS, "controller.trust.jump": BOUNDLESS}
"""Values that make an estimator with gated measurements accept all of them."""

PRESSED = 1.0
"""Initial value in N s of a winch integral where the tension command is at its limit: it holds the torque there."""

ROPE_UNIT, POSITION_UNIT = 1e-3, 1e3
"""Units of residuals: kN for changes of inner forces, mm for changes of position beyond ``v Ts``."""

PLANT = "motion.plant."
"""Prefix of the plant's states."""

QUICK_BUILD = ("-O1",)
"""Compiler flags: the function is long straight-line code, for which more optimisation only costs compile time."""


def position_in(experiment: Experiment, x: float | None) -> float:
    """A position in m; default: the middle of an experiment's track.

    Raises:
        ConfigurationError: `experiment` is no experiment.
    """
    instance("experiment", experiment, Experiment, hint=", which includes plant, limits and preload")
    return experiment.plant.track.length / 2 if x is None else x


def operating_point(
    experiment: Experiment,
    x: float | None = None,
    v: float = 0.0,
    *,
    preload: float | None = None,
    current: float = 0.0,
    force: float = 0.0,
    tension_min: float | None = None,
    tension_max: float | None = None,
) -> OperatingPoint:
    """State, torques and tensions with which the vehicle passes x at the constant speed v.

    See `model.linear.operating_point.operating_point` for the distribution of the tensions.

    Args:
        experiment: source of the plant, and of preload and limits unless given.
        x: position in m; default: mid-track.
        v: speed in m/s, -10 to 10; negative: towards winch 2.
        preload: sum of both tensions in N, between twice tension_min and twice tension_max.
        current: ambient current in m/s, constant.
        force: disturbance force in N along the track, constant.
        tension_min: lower limit of a tension in N; 0 lets a rope go slack.
        tension_max: upper limit of a tension in N.

    Raises:
        ConfigurationError: a point off the track, a rope at its shortest length, or a speed, preload or limit out of
            range.
    """
    x, limits = position_in(experiment, x), experiment.controller.limits
    return of_plant(
        x,
        v,
        limits.preload if preload is None else preload,
        experiment.plant,
        current=current,
        force=force,
        tension_min=limits.tension_min if tension_min is None else tension_min,
        tension_max=limits.tension_max if tension_max is None else tension_max,
    )


@dataclass(frozen=True)
class LoopOperatingPoint:
    """An operating point of the closed loop, for linearisation.

    Attributes:
        loop: the closed loop with ropes that never go slack, identical to the original one while they are taut.
        experiment: the experiment, with perfect sensors and no disturbance.
        state, exogenous, parameters: values of the closed loop's vectors.
        row: column → value of the result's row there.
        residual: largest relative change of a state over a sample beyond the steady motion.
        opened: A, B, C, D of the loop opened at all of `LOOP_OPENINGS`, as in `LoopOperatingPoints.opened`.
        kept: indices of its states among those of the closed loop.
    """

    loop: ClosedLoop
    experiment: Experiment
    state: Floats
    exogenous: Floats
    parameters: Floats
    row: dict[str, float]
    residual: float
    opened: tuple[Floats, Floats, Floats, Floats]
    kept: NDArray[np.intp]


def loop_operating_point(
    experiment: Experiment, x: float | None, v: float, nominal: Plant | None = None
) -> LoopOperatingPoint:
    """Solve for steady motion through a position; at v = 0 that is rest.

    Args:
        experiment: plant, gains and sample time.
        x: position in m, on the track; None: mid-track.
        v: speed in m/s.
        nominal: the plant the controller was designed for, as in a `Scenario`; default: the simulated one.

    Raises:
        ConfigurationError: a position off the track, a speed whose resistance the ropes cannot overcome, or gains
            without steady motion.
    """
    x, v = one_number("x", position_in(experiment, x)), one_number("v", v)
    instance("nominal", nominal, Plant, optional=True)
    calm = in_calm(experiment)
    prepare(calm)
    limits, needed = calm.controller.limits, resistance(v, DisturbanceInputs(), calm.plant, x)
    if not abs(needed) < limits.force:
        raise ConfigurationError(
            f"v = {v:g}: steady motion needs a force of {float(needed):.4g} N, must be within ±{limits.force:g} N "
            "(tension_max - reserve - tension_min)"
        )
    of_plant(x, v, limits.preload, calm.plant, tension_min=limits.tension_min, tension_max=limits.command_max)
    structure = with_taut_ropes(structure_of(calm))
    loop = closed_loop(structure)
    parameters = loop.vector(parameters_of(calm, nominal and still_plant(nominal)))
    found = loop_operating_points(structure, parameters[None], np.array([x]), np.array([v]), compiled=False)
    kind = calm.controller.law.kind
    if not found.repeats[0]:
        raise ConfigurationError(f"v = {v:g}: '{kind}' with these gains reaches no steady motion")
    if not _force_stays(_open_sample(structure, compiled=False), found):
        raise ConfigurationError(
            f"v = {v:g}: '{kind}' with these gains reaches no steady motion: its force command changes within "
            f"{LASTING} samples; does a state of law or estimator that moves with the vehicle lack Mark.POSITION?"
        )
    if not found.steady[0]:
        command, _, *pulls = found.facts[0].tolist()
        raise ConfigurationError(
            f"v = {v:g}: steady motion of '{kind}' is beyond its limits: force command {command:.4g} N, "
            f"tensions {pulls[0]:.4g} and {pulls[1]:.4g} N"
        )
    state, outside = found.state[0], found.outside[0]
    row = dict(zip(loop.columns, np.array(loop.step(state, outside, parameters)[1]).ravel().tolist(), strict=True))
    row |= {"x": x, "v": v}  # as given, without round-off
    residual = float(found.residual[0])
    return LoopOperatingPoint(loop, calm, state, outside, parameters, row, residual, found.opened, found.kept)


def with_taut_ropes(structure: Experiment) -> Experiment:
    """A structure with ropes that never go slack."""
    return replace(structure, plant=replace(structure.plant, rope_slack=False))


def in_calm(experiment: Experiment) -> Experiment:
    """The experiment without disturbances, sensor errors and anything else that prevents steady motion.

    Torque commands are not quantised, and slow parts of a controller are updated at every sample; for the plant see
    `still_plant`.
    """
    # unit noise gives the noise inputs of the linear system the units of the sensors
    sensors = replace(
        experiment.sensors,
        position_noise=1.0,
        position_resolution=0.0,
        position_drift=0.0,
        outage_length=0.0,
        speed_noise=1.0,
        tension_noise=1.0,
        encoder_counts=0,
        drum_speed_resolution=0.0,
    )
    simulation = replace(experiment.simulation, jitter=0.0, torque_step=0.0)
    slow = {key: 1 for key, leaf in describe_parts(experiment.controller).items() if Mark.INTERVAL in leaf.marks}
    return replace(
        experiment,
        controller=with_leaves(experiment.controller, slow),
        plant=still_plant(experiment.plant),
        disturbance=Disturbance(),
        sensors=sensors,
        simulation=simulation,
    )


def still_plant(plant: Plant) -> Plant:
    """The plant without effects that prevent steady motion.

    Effects periodic in drum, gear and motor angles (eccentricity, transmission error, ripple), rail waviness and rope
    creep are disturbances of a loop, not part of it. Friction has no memory, as its stored force at rest would be
    arbitrary.
    """
    still = {"eccentricity": 0.0, "torque_ripple": 0.0, "transmission_error": 0.0}
    return replace(
        plant,
        vehicle=replace(plant.vehicle, bristle_stiffness=0.0),
        track=replace(plant.track, waviness=0.0),
        rope_1=replace(plant.rope_1, hysteresis=0.0),
        rope_2=replace(plant.rope_2, hysteresis=0.0),
        winch_1=replace(plant.winch_1, **still),
        winch_2=replace(plant.winch_2, **still),
        creep_1=Creep(),
        creep_2=Creep(),
    )


@dataclass(eq=False)
class LoopOperatingPoints:
    """Iterates of Newton's method at s points, or its solutions.

    Attributes:
        parameters, state, outside: (s, parameters), (s, states), (s, exogenous) vectors of the closed loop.
        leaving: (s, 3) signals injected at the openings.
        carried: (s,) the vehicle's motion in m per sample.
        kept: (n,) indices of the states without bookkeeping ones.
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
    kept: NDArray[np.intp]
    repeats: Flags
    facts: Floats
    residual: Floats
    slopes: Floats

    @property
    def steady(self) -> Flags:
        """(s,) whether all states repeat, ropes are taut and the force command is within its limits."""
        command, left, *pulls = self.facts.T
        return self.repeats & (command == left) & (np.min(pulls, axis=0) > 0)

    @property
    def opened(self) -> tuple[Floats, Floats, Floats, Floats]:
        """A, B, C, D of the loops opened at all of `LOOP_OPENINGS`: ``x+ = A x + B c``, ``returned = C x + D c``.

        Shapes (s, n, n), (s, n, 3), (s, 3, n) and (s, 3, 3).
        """
        n = len(self.kept)
        by_state, by_leaving = self.slopes[:, : n + 3, :n], self.slopes[:, : n + 3, n + 1 :]
        return by_state[:, :n], by_leaving[:, :n], by_state[:, n:], by_leaving[:, n:]

    def __getitem__(self, points: NDArray[np.intp]) -> "LoopOperatingPoints":
        return replace(self, **{name: values[points] for name, values in self._of_points().items()})

    def __setitem__(self, points: NDArray[np.intp], other: "LoopOperatingPoints") -> None:
        for name, values in self._of_points().items():
            values[points] = getattr(other, name)

    def _of_points(self) -> dict[str, NDArray[Any]]:
        return {name: values for name, values in vars(self).items() if name != "kept"}

    def having(self, loop: ClosedLoop, values: Mapping[str, float]) -> "LoopOperatingPoints":
        """The points with other values of some parameters; names unknown to the loop are ignored."""
        parameters = self.parameters.copy()
        for name in values.keys() & set(loop.parameters):
            parameters[:, loop.parameters.index(name)] = values[name]
        return replace(self, parameters=parameters)


def loop_operating_points(
    structure: Experiment,
    parameters: Floats,
    x: Floats,
    v: Floats,
    near: Floats | None = None,
    *,
    compiled: bool = True,
    begun: LoopOperatingPoints | None = None,
) -> LoopOperatingPoints:
    """Solve for steady motion at many points.

    1. Newton's method from the state of a perfect controller: no errors, tensions as commanded.
    2. Where that does not converge and measurements are gated: the same from the solution with all of them accepted.
    3. Where that fails: numerical continuation in the position, from mid-track, where both ropes are long and soft
       (Allgower and Georg, *Introduction to Numerical Continuation Methods*).
    4. Where that fails too, and at mid-track: damped least-squares steps, alternating with learnt states of the
       estimator; first from the solution of law and estimator without limits, then from the perfect controller's state.
    5. Derivatives that are round-off are set to zero (`without_round_off`).

    Args:
        structure: of the closed loop, with ropes that never go slack.
        parameters: (s, parameters) of the closed loop, with perfect sensors and without disturbances.
        x: (s,) positions in m.
        v: (s,) speeds in m/s.
        near: (s, states) at these points with other gains, the initial guess for law and estimator; NaN: unknown.
        compiled: whether the sample is compiled; for a few points interpretation is quicker.
        begun: the same points with slightly different parameters: initial guesses where these repeat.

    Raises:
        DualwinchError: no compiler or no usable cache folder.
    """
    sample = _open_sample(structure, compiled)
    if begun is None:
        start = _first_guesses(structure, sample, parameters, x, v, near)
    else:
        start, cold = replace(begun, parameters=parameters), np.flatnonzero(~begun.repeats)
        if len(cold):
            known = None if near is None else near[cold]
            start[cold] = _first_guesses(structure, sample, parameters[cold], x[cold], v[cold], known)
    found = _newton(sample, start, ITERATIONS)
    again = np.flatnonzero(~found.steady)
    if len(again) and _is_gated(sample):
        accepting = _accepting_all(sample, start[again])
        found[again[accepting.steady]] = accepting[np.flatnonzero(accepting.steady)]
    away = np.flatnonzero(~found.steady & (np.abs(2 * x / _lengths(sample, parameters) - 1) > AMID))
    if len(away):
        known, mid_track = None if near is None else near[away], _lengths(sample, parameters[away]) / 2
        middle = _first_guesses(structure, sample, parameters[away], mid_track, v[away], known)
        middle = _completed_by_least_squares(sample, middle, _newton(sample, middle, ITERATIONS))
        away, middle = away[middle.steady], middle[np.flatnonzero(middle.steady)]
        there = _newton(sample, _shifted(sample, middle, start[away]), ITERATIONS)
        found[away[there.steady]] = there[np.flatnonzero(there.steady)]
    found = _completed_by_least_squares(sample, start, found)
    nearby = (
        sample.evaluate(state, found.outside, found.parameters, found.leaving)[2] for state in neighbours(found.state)
    )
    found.slopes = without_round_off(found.slopes, *nearby)
    return found


def _lengths(sample: "_OpenSample", parameters: Floats) -> Floats:
    """Track lengths in m, (s,), for parameters (s, parameters)."""
    return parameters[:, sample.loop.parameters.index("plant.track.length")]


def _shifted(sample: "_OpenSample", found: LoopOperatingPoints, start: LoopOperatingPoints) -> LoopOperatingPoints:
    """Initial guesses at other positions: the controller states found, with positions shifted by the distance."""
    x = sample.loop.states.index(f"{PLANT}x")
    way = start.state[:, [x]] - found.state[:, [x]]
    state = np.where(sample.controller, found.state + way * sample.loop.marked(Mark.POSITION), start.state)
    outside = start.outside.copy()
    outside[:, sample.reference] = found.outside[:, sample.reference] + way[:, 0]
    return replace(start, state=state, outside=outside, leaving=found.leaving.copy())


def _completed_by_least_squares(
    sample: "_OpenSample", start: LoopOperatingPoints, found: LoopOperatingPoints
) -> LoopOperatingPoints:
    """The solutions, completed by damped least-squares steps from both kinds of initial guess where none was found."""
    for limited in (False, True):
        again = np.flatnonzero(~found.repeats)
        if not len(again):
            break
        begun = start[again] if limited else _without_limits(sample, start[again])
        found[again] = _alternating(sample, begun, LEAST_SQUARES_ITERATIONS, least_squares=True)
    return found


def _force_stays(sample: "_OpenSample", found: LoopOperatingPoints) -> bool:
    """Whether the force command stays constant in a simulation: it does not if a position lacks its mark."""
    state, outside = found.state[0], found.outside[0].copy()
    u, force = sample.loop.columns.index("u"), found.facts[0, 0]
    for _ in range(LASTING):
        state, row, *_ = (np.array(vector).ravel() for vector in sample.loop.step(state, outside, found.parameters[0]))
        outside[sample.reference] += found.carried[0]
        if not abs(row[u] - force) <= LASTING_SHARE * abs(force) + LASTING_FORCE:
            return False
    return True


LASTING, LASTING_SHARE, LASTING_FORCE = 20, 0.05, 20.0
"""Samples over which the force command of steady motion must stay constant; tolerances: relative, and in N."""


def neighbours(state: Floats) -> tuple[Floats, Floats]:
    """States at the relative distance `NEIGHBOUR` on both sides of given ones (..., states)."""
    way = NEIGHBOUR * np.cos(np.arange(state.shape[-1])) * np.maximum(np.abs(state), 1.0)
    return state + way, state - way


def without_round_off(slopes: Floats, above: Floats, below: Floats) -> Floats:
    """Derivatives in which elements that are zero up to round-off are set to zero, independent of units.

    At an operating point errors and innovations are zero, and so are derivatives with respect to their factors, such as
    the information matrix of an adaptive estimator. In double precision they may be 1e-26 or 0. An element is taken as
    zero if its sign differs between the two neighbours of the point, or if it differs from both by at least half.
    """
    with np.errstate(invalid="ignore"):  # diverged points
        change = np.minimum(np.abs(above - slopes), np.abs(below - slopes))
    return np.where((np.sign(above) * np.sign(below) < 0) | (2 * change >= np.abs(slopes)), 0.0, slopes)


class _OpenSample:
    """A sample of the loop opened at all of `LOOP_OPENINGS`, with its exact derivatives.

    Attributes:
        loop: the closed loop.
        kept: (n,) indices of its states without bookkeeping ones.
        plant: indices of the plant's states.
        x: index of the vehicle's position among the kept states.
        strained: (f,) indices among the kept states of positions that advance such that a force stays constant:
            drums, rope nodes and rotors (`model.plant.inner_forces`).
        moving: (n,) which other kept states advance with the vehicle.
        learnt: (n,) which kept states are learnt parameters of the machine.
        remembers: (n,) which kept states depend on the last sample.
        adapting: (states,) which states belong to law and estimator.
        controller: (states,) which states belong to the controller.
        reference: index of the reference position among the exogenous signals.
        evaluate: ``(state, exogenous, parameters, leaving) -> (values, facts, slopes)`` for many points. Values are the
            kept states a sample later, the signals returned to the openings, and the changes of the inner forces over
            the sample, (n + 3 + f,); facts as in `LoopOperatingPoints`; slopes are derivatives of the values with
            respect to kept states, reference position and injected signals, (n + 3 + f, n + 4).
    """

    evaluate: Callable[..., tuple[Floats, ...]]

    def __init__(self, structure: Experiment, *, compiled: bool) -> None:
        self.loop = closed_loop(structure)
        self.kept = np.flatnonzero(~self.loop.marked(Mark.BOOKKEEPING))
        names = [self.loop.states[index] for index in self.kept]
        blank = blank_state(structure.plant)
        self.plant = [self.loop.states.index(PLANT + key) for key in leaves(blank)]
        self.x = names.index(f"{PLANT}x")
        self.strained = [names.index(PLANT + key) for key in inner_forces(blank, structure.plant)]
        self.moving = self.loop.marked(Mark.POSITION)[self.kept]
        self.moving[self.strained] = False
        self.learnt = self.loop.marked(Mark.LEARNT)[self.kept]
        self.remembers = np.array([name.startswith(("controller.", "actuator_")) for name in names])
        self.remembers &= ~self.loop.marked(Mark.POSITION, Mark.SPEED)[self.kept]
        adapting = ("controller.law.", "controller.estimator.")
        self.adapting = np.array([name.startswith(adapting) for name in self.loop.states])
        self.controller = np.array([name.startswith("controller.") for name in self.loop.states])
        self.reference = self.loop.exogenous.index("reference.x")
        self._function = _open_function(structure, compiled)
        self.evaluate = native.compile(self._function, flags=QUICK_BUILD) if compiled else self._interpreted  # pyright: ignore[reportAttributeAccessIssue]

    def _interpreted(self, *vectors: Floats) -> tuple[Floats, ...]:
        outputs = [output.full() for output in self._function.call([ca.DM(vector.T) for vector in vectors])]
        values, facts, slopes = (np.array(np.split(output, len(vectors[0]), axis=1)) for output in outputs)
        return values[:, :, 0], facts[:, :, 0], slopes


@built_once
def _open_sample(structure: Experiment, compiled: bool) -> _OpenSample:
    return _OpenSample(structure, compiled=compiled)


@built_once
def _open_function(structure: Experiment, compiled: bool) -> ca.Function:
    """The sample and its derivatives; merging common subexpressions pays off only for compiled code."""
    loop, opened = closed_loop(structure), closed_loop(structure, openings=tuple(LOOP_OPENINGS))
    arguments = [ca.SX.sym(name, opened.sample.size1_in(name)) for name in opened.sample.name_in()]
    state, exogenous, parameters, leaving = arguments
    following, row, _ = opened.step(*arguments)
    returned = opened.sample(*arguments)[opened.sample.name_out().index("returned")]
    kept = np.flatnonzero(~loop.marked(Mark.BOOKKEEPING)).tolist()
    plant = with_leaves(structure.plant, dict(zip(loop.parameters, ca.vertsplit(parameters), strict=True)), "plant.")
    blank = blank_state(structure.plant)

    def forces(vector: ca.SX) -> ca.SX:
        named = dict(zip(loop.states, ca.vertsplit(vector), strict=True))
        return ca.vertcat(*inner_forces(with_leaves(blank, named, PLANT), plant).values())

    values = ca.vertcat(following[kept], returned, forces(following) - forces(state))
    facts = row[[loop.columns.index(name) for name in ("u", "u_sat", "F1", "F2")]]
    by_state, by_outside, by_leaving = (ca.jacobian(values, vector) for vector in (state, exogenous, leaving))
    slopes = ca.horzcat(by_state[:, kept], by_outside[:, loop.exogenous.index("reference.x")], by_leaving)
    return ca.Function(
        "open_sample",
        arguments,
        [ca.densify(value) for value in (values, facts, slopes)],
        ["state", "exogenous", "parameters", "leaving"],
        ["values", "facts", "slopes"],
        {"cse": compiled},
    )


def _first_guesses(
    structure: Experiment, sample: _OpenSample, parameters: Floats, x: Floats, v: Floats, near: Floats | None
) -> LoopOperatingPoints:
    """Initial guess, the perfect controller: no errors, tensions as commanded."""
    loop, count, n = sample.loop, len(x), len(sample.kept)
    given = dict(zip(loop.parameters, parameters.T, strict=True))
    preload, lower = given[f"{LIMITS}preload"], given[f"{LIMITS}tension_min"]
    upper, calm = given[f"{LIMITS}tension_max"] - given[f"{LIMITS}reserve"], np.zeros_like(x)
    of_plant = np.array([values for name, values in given.items() if name.startswith("plant.")])
    point = operating_point_law(structure.plant)(np.array([x, v, preload, calm, calm, lower, upper]), of_plant).full()
    state = start_function(structure)(parameters.T, calm[np.newaxis]).full().T
    state[:, sample.plant] = point[:-4].T
    state[:, loop.marked(Mark.POSITION)], state[:, loop.marked(Mark.SPEED)] = x[:, None], v[:, None]
    if near is not None:
        state = np.where(sample.adapting & np.isfinite(near), near, state)
    outside = np.zeros((count, len(loop.exogenous)))
    outside[:, sample.reference], outside[:, loop.exogenous.index("reference.v")] = x, v
    *_, tau_1, tau_2, F1, F2 = point
    force = F1 - F2
    leaving = np.array([force, tau_1, tau_2]).T
    for _ in range(2):  # states that remember the last sample, or whether there was one, are consistent after two
        following = sample.evaluate(state, outside, parameters, leaving)[0][:, :n]
        state[:, sample.kept[sample.remembers]] = following[:, sample.remembers]
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
        carried=v * given["simulation.sample_time"],
        kept=sample.kept,
        repeats=np.zeros(count, bool),
        facts=np.full((count, 4), np.nan),
        residual=np.full(count, np.inf),
        slopes=np.full((count, n + 3 + len(sample.strained), n + 4), np.nan),
    )


def _is_gated(sample: _OpenSample) -> bool:
    """Whether the estimator refuses measurements that differ too much from what it expects."""
    return not UNGATED.keys().isdisjoint(sample.loop.parameters)


def _accepting_all(sample: _OpenSample, start: LoopOperatingPoints) -> LoopOperatingPoints:
    """Newton's method from the solution with all measurements accepted.

    With other gains than those of the initial guess the estimate begins off, so that a gate would refuse measurements
    and the estimate would never move. In steady motion most gates are open, so that both solutions are the same. The
    alternation is needed only where one turn of it is not close enough.
    """
    loose, gates = start.having(sample.loop, UNGATED), start.parameters
    close = _newton(sample, loose, DAMPED_ITERATIONS, damped=True, held=sample.learnt)
    close = _newton(sample, close, ITERATIONS, held=~sample.learnt)
    found = _newton(sample, replace(close, parameters=gates), ITERATIONS)
    again = np.flatnonzero(~found.steady)
    if len(again):
        alternated = _alternating(sample, loose[again], ITERATIONS)
        begun, known = start[again], np.flatnonzero(alternated.repeats)
        begun[known] = alternated[known]
        found[again] = _newton(sample, replace(begun, parameters=gates[again]), ITERATIONS)
    return found


def _without_limits(sample: _OpenSample, start: LoopOperatingPoints) -> LoopOperatingPoints:
    """Initial guess with law and estimator at their solution without tension limits.

    A law whose integrals are far off would start at its limits, where its slope is zero. An estimator with gated
    measurements accepts all of them; the initial guess is then the solution with limits but without gates.
    """
    loose = _alternating(sample, start.having(sample.loop, UNLIMITED | UNGATED), UNLIMITED_ITERATIONS).state
    begun = replace(start, state=np.where(sample.adapting & np.isfinite(loose), loose, start.state))
    if not _is_gated(sample):
        return begun
    found = _alternating(sample, begun.having(sample.loop, UNGATED), LEAST_SQUARES_ITERATIONS, least_squares=True)
    return replace(found, parameters=start.parameters)


def _alternating(
    sample: _OpenSample, start: LoopOperatingPoints, iterations: int, *, least_squares: bool = False
) -> LoopOperatingPoints:
    """Newton's method, alternating between learnt states and all others.

    An estimate is strongly nonlinear in its information matrix, which grows over thousands of samples. Alternation ends
    for points whose other states do not converge.
    """
    learnt = sample.learnt
    if not learnt.any():
        return _newton(sample, start, iterations, damped=True, least_squares=least_squares)
    found = start[np.arange(len(start.state))]
    # first with the initial parameter estimates, if that converges: without motion there is nothing to learn
    first = _newton(sample, start, DAMPED_ITERATIONS, damped=True, least_squares=least_squares, held=learnt)
    sound = np.flatnonzero(first.repeats)
    found[sound] = first[sound]
    found.repeats = np.zeros_like(start.repeats)
    going, repeating = np.arange(len(start.state)), np.zeros(len(start.state), bool)
    for turn in range(ROUNDS + 1):
        if not len(going):
            break
        begun = found[going]
        learning = _newton(sample, begun, iterations, held=~learnt)
        step = np.abs(learning.state - begun.state) / np.maximum(np.abs(begun.state), 1.0)
        settled = repeating & learning.repeats & (step[:, sample.kept].max(axis=1) < STEP)
        found.repeats[going[settled]] = True
        going, learning = going[~settled], learning[~settled]
        if turn == ROUNDS or not len(going):
            break
        others = _newton(sample, learning, DAMPED_ITERATIONS, damped=True, least_squares=least_squares, held=learnt)
        found[going] = replace(others, repeats=np.zeros_like(others.repeats))
        going, repeating = going[others.repeats], np.ones(int(others.repeats.sum()), bool)
    return found


def _newton(
    sample: _OpenSample,
    start: LoopOperatingPoints,
    iterations: int,
    *,
    damped: bool = False,
    least_squares: bool = False,
    held: Flags | None = None,
) -> LoopOperatingPoints:
    """Newton's method at all points; points that have converged or diverged are no longer iterated.

    `damped` shortens steps such that the next one is smaller (`_damping`). `least_squares` takes the shortest possible
    step where it is not unique, as at rest with a law that leaves a state undetermined. `held` states are constant.
    """
    points = start[np.arange(len(start.state))]
    n, count = len(sample.kept), len(points.state)
    excess, left = np.full(count, np.inf), np.full(count, np.inf)
    active = np.arange(count)
    for _ in range(iterations):
        at = points[active]
        found, at.facts, at.slopes = sample.evaluate(at.state, at.outside, at.parameters, at.leaving)
        values = np.hstack([at.state[:, sample.kept], at.leaving])
        rest, matrix, counted, unknown = _equations(sample, found, values, at)
        sizes, last = np.maximum(np.abs(values), 1.0), excess[active]
        if held is not None:
            counted[:, :n] &= ~held
            unknown[:, :n] &= ~held
        with np.errstate(over="ignore", invalid="ignore"):  # diverging points
            unknown &= _coupled(matrix * (sizes[:, None] / sizes[..., None]), unknown)
        rounding = np.finfo(float).eps * np.einsum("aij,aj->ai", np.abs(matrix), np.abs(values))
        at.residual = np.where(counted, np.abs(rest) / sizes, 0.0).max(axis=1)
        with np.errstate(invalid="ignore"):  # both are infinite for diverging points, and so is `excess`
            beyond = np.where(counted, (np.abs(rest) - rounding) / sizes, 0.0).max(axis=1)
        excess[active] = np.where(np.isfinite(matrix).all(axis=(1, 2)), beyond, np.inf)
        points[active] = at
        going = np.isfinite(excess[active])
        going &= ~((last < RESIDUAL) & (excess[active] >= last / 2) & (left[active] < STEP))
        active = active[going]
        if not len(active):
            break
        at, matrix, unknown, sizes = points[active], matrix[going], unknown[going], sizes[going]
        sizes[:, sample.x] = np.maximum(np.abs(at.outside[:, sample.reference]), 1.0)

        def solved(rest: Floats, matrix: Floats = matrix, unknown: Flags = unknown) -> Floats:
            return _step(matrix, rest, unknown, least_squares=least_squares)

        step = solved(rest[going])
        left[active] = (np.abs(step) / sizes).max(axis=1)
        points[active] = _moved(sample, at, _damping(sample, at, step, sizes, solved) * step if damped else step)
    points.repeats = (excess < RESIDUAL) & (left < STEP)
    return points


def _moved(sample: _OpenSample, points: LoopOperatingPoints, step: Floats) -> LoopOperatingPoints:
    """Points after a step of the unknowns, in which the reference replaces the vehicle's position."""
    n, state, outside = len(sample.kept), points.state.copy(), points.outside.copy()
    outside[:, sample.reference] += step[:, sample.x]
    state[:, sample.kept] += np.where(np.arange(n) == sample.x, 0.0, step[:, :n])
    return replace(points, state=state, outside=outside, leaving=points.leaving + step[:, n:])


def _damping(
    sample: _OpenSample, at: LoopOperatingPoints, step: Floats, sizes: Floats, solved: Callable[[Floats], Floats]
) -> Floats:
    """Damping factors (a, 1) of Newton steps, such that the next simplified Newton step is smaller.

    This is the natural monotonicity test, which does not depend on the equations' units (Deuflhard, *Newton Methods
    for Nonlinear Problems*, 3.3): a smooth sign function has almost no slope outside its boundary layer, so that full
    steps would oscillate across it.
    """
    share, whole = np.ones((len(step), 1)), (np.abs(step) / sizes).max(axis=1, keepdims=True)
    for _ in range(DAMPINGS):
        moved = _moved(sample, at, share * step)
        found, _, moved.slopes = sample.evaluate(moved.state, moved.outside, moved.parameters, moved.leaving)
        rest, *_ = _equations(sample, found, np.hstack([moved.state[:, sample.kept], moved.leaving]), moved)
        following = solved(rest)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            size = (np.abs(following) / sizes).max(axis=1, keepdims=True)
            bent = (np.abs(following - (1 - share) * step) / sizes).max(axis=1, keepdims=True)
            too_far = ~(size <= (1 - share / 4) * whole) & (whole > STEP) & np.isfinite(whole)
            next_share = np.clip(share**2 * whole / (2 * bent), share / 10, share / 2)
        if not too_far.any():
            break
        share = np.where(too_far, np.where(np.isfinite(next_share), next_share, share / 10), share)
    return share


DAMPINGS = 8
"""Maximum number of reductions of a Newton step."""


def _equations(
    sample: _OpenSample, found: Floats, values: Floats, at: LoopOperatingPoints
) -> tuple[Floats, Floats, Flags, Flags]:
    """Equations for the n kept states and the signals injected at the openings.

    The vehicle's position is given; the reference position is unknown in its place.

    Returns:
        Residuals (a, n + 3), Jacobians (a, n + 3, n + 3), which values any equation depends on, and which are unknown.
    """
    n, strained, moving = len(sample.kept), sample.strained, np.append(sample.moving, [False] * 3)
    units = np.where(moving, POSITION_UNIT, 1.0)
    rest = (found[:, : n + 3] - values - np.where(moving, at.carried[:, None], 0.0)) * units
    rest[:, strained] = found[:, n + 3 :] * ROPE_UNIT
    every = at.slopes[:, : n + 3].copy()
    every[:, :n, :n] -= np.eye(n)
    every[:, n:, n + 1 :] -= np.eye(3)
    every *= units[:, None]
    every[:, strained] = at.slopes[:, n + 3 :] * ROPE_UNIT
    matrix = np.delete(every, n, axis=2)
    # a state that nothing depends on may grow without limit; one that nothing moves, such as an integral without a
    # gain, keeps its initial value
    counted, moved = (matrix != 0).any(axis=1), (matrix != 0).any(axis=2)
    counted[:, n:] = True
    unknown = counted & moved
    matrix[:, :, sample.x], unknown[:, sample.x] = every[:, :, n], True
    return rest, matrix, counted, unknown


def _coupled(matrix: Floats, unknown: Flags) -> Flags:
    """Unknowns (a, n) that depend on any unknown; the others keep their value, such as a speed wheel's scale at rest.

    Args:
        matrix: (a, n, n) relative change of each state per relative change of each unknown.
        unknown: (a, n) unknowns that are not held.
    """
    for _ in range(matrix.shape[1]):
        inside = (np.abs(matrix) > STANDSTILL) & unknown[:, None, :]
        coupled = unknown & inside.any(axis=2)
        if (coupled == unknown).all():
            break
        unknown = coupled
    return unknown


@np.errstate(over="ignore")  # diverging points
def _step(matrix: Floats, rest: Floats, unknown: Flags, *, least_squares: bool) -> Floats:
    """Newton steps, solved with scaled rows and columns: zero for known values, NaN for singular matrices."""
    step, some = np.zeros(rest.shape), np.flatnonzero(unknown.any(axis=0))
    if not len(some):
        return step
    matrix, rest, unknown = matrix[:, some][:, :, some], rest[:, some], unknown[:, some]
    matrix = np.where(unknown[:, :, None] & unknown[:, None, :], matrix, 0.0)
    columns = np.abs(matrix).max(axis=1)
    columns = np.where(columns > 0, columns, 1.0)
    matrix /= columns[:, None, :]
    rows = np.abs(matrix).max(axis=2)
    rows = np.where(rows > 0, rows, 1.0)
    matrix /= rows[:, :, None]
    index = np.arange(matrix.shape[1])
    matrix[:, index, index] += ~unknown
    right = np.where(unknown, -rest / rows, 0.0)
    if least_squares:
        pairs = zip(matrix, right, strict=True)
        step[:, some] = np.array([np.linalg.lstsq(*pair, rcond=1e-13)[0] for pair in pairs]) / columns
        return step
    try:
        solved = np.linalg.solve(matrix, right[..., None])[..., 0]
    except np.linalg.LinAlgError:  # a law at its limits has no slope
        singular = np.linalg.slogdet(matrix)[0] == 0
        matrix[singular] = np.eye(matrix.shape[1])
        solved = np.linalg.solve(matrix, right[..., None])[..., 0]
        solved[singular] = np.nan
    step[:, some] = solved / columns
    return step
