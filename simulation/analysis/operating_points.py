"""Operating points of the sampled closed loop: steady motion, in which the state repeats from sample to sample.

Everything repeats but what the motion itself carries on: positions by ``v Ts``, drums by what keeps the tensions; at
v = 0 that is rest. Sensors are taken as perfect and disturbances as absent. Many points are solved for side by side by
Newton's method; a single one is a batch of one. Beside the states the unknowns are what leaves the loop's openings, so
that the derivatives at a point are those of the loop opened at all of `LOOP_OPENINGS` at once: closing all but one
gives the loop cut at that one, closing all the closed loop.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen import native
from dualwinch.codegen.source.expressions import built_once
from dualwinch.model.disturbance import Disturbance
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.operating_point import OperatingPoint, operating_point_law, resistance
from dualwinch.model.linear.operating_point import operating_point as of_plant
from dualwinch.model.plant import DisturbanceInputs, Plant, PlantState, tensions
from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.model.ropes import Creep
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import LOOP_OPENINGS, ClosedLoop, closed_loop, start_function
from dualwinch.simulation.loop.structure import Structure, parameters_of, structure_of, template_of
from dualwinch.simulation.prepare import prepare

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

RESIDUAL, STEP = 3e-6, 3e-5
"""Largest change of a state over a sample beyond the steady motion's own, and largest step that Newton's method would
still take, both over the state's size.

The change alone says nothing of a state that moves slowly, such as an integral: it may be metres from where it rests.
A drum angle of tens of rad in double precision leaves a tension uncertain by some 1e-8 N, which a winch's gains
amplify; what is no steady motion leaves a thousand times more.
"""

ITERATIONS, UNLIMITED_ITERATIONS, LEAST_SQUARES_ITERATIONS = 16, 6, 24
"""Newton steps at most: at first; without limits, to begin again from there; and then, by least squares."""

ROUNDS = 6
"""How many times at most what has been learnt of a machine, and all else, are solved for in turns."""

BOUNDLESS = 1e9
"""A limit that nothing reaches."""

LIMITS = "controller.coordination."
"""What the keys of the limits of a tension begin with."""

UNLIMITED = {f"{LIMITS}tension_min": -BOUNDLESS, f"{LIMITS}tension_max": BOUNDLESS}
"""Values of parameters with which no tension is limited."""

UNGATED = {"controller.trust.gate": BOUNDLESS, "controller.trust.jump": BOUNDLESS}
"""Values with which an estimator that gates its measurements accepts all of them."""

PRESSED = 1.0
"""Integral in N s that presses a torque against its limit, where a tension command is at its limit."""

ROPE_UNIT, POSITION_UNIT = 1e-3, 1e3
"""Changes of tension are counted in kN, those of position beyond ``v Ts`` in mm."""

PLANT = tuple(f"motion.plant.{name}" for name in PlantState.__annotations__)
"""States of the plant; a rope's tension has to repeat, and its drum's angle may go on."""

QUICK_BUILD = ("-O1",)
"""The function is long and straight: more takes a compiler thrice as long and brings nothing."""


def operating_point(
    x: float | None = None,
    v: float = 0.0,
    preload: float | None = None,
    plant: Plant | None = None,
    *,
    experiment: Experiment | None = None,
    current: float = 0.0,
    force: float = 0.0,
    tension_min: float | None = None,
    tension_max: float | None = None,
) -> OperatingPoint:
    """State, torques and tensions with which the vehicle passes x at the constant speed v.

    What is not given comes from the experiment, or is the paper's. See
    `model.linear.operating_point.operating_point` for how the tensions are shared.

    Args:
        x: position in m; default: amid the track.
        v: speed in m/s, -10 to 10; negative: towards winch 2.
        preload: sum of both tensions in N, between twice tension_min and twice tension_max.
        plant: in place of the experiment's.
        experiment: default: the paper's.
        current: ambient current in m/s, constant.
        force: disturbance force in N along the track, constant.
        tension_min: lower limit of a tension in N; 0 lets a rope go slack.
        tension_max: upper limit of a tension in N.

    Raises:
        ConfigurationError: a point off the track, a rope at its shortest length, a speed, preload or limit out of
            range.
    """
    experiment = experiment or Experiment()
    plant, limits = plant or experiment.plant, experiment.controller.limits
    return of_plant(
        plant.track.length / 2 if x is None else x,
        v,
        limits.preload if preload is None else preload,
        plant,
        current=current,
        force=force,
        tension_min=limits.tension_min if tension_min is None else tension_min,
        tension_max=limits.tension_max if tension_max is None else tension_max,
    )


@dataclass(frozen=True)
class LoopOperatingPoint:
    """An operating point of the closed loop, around which it is linear.

    Attributes:
        loop: the closed loop with ropes that never go slack: the same wherever they are taut.
        experiment: what it is of, with perfect sensors and no disturbance.
        state, exogenous, parameters: values of the closed loop's vectors.
        row: column → value of the result's row there.
        residual: largest change of a state over a sample beyond the motion's own, over the state's size.
        opened: the loop opened at all of `LOOP_OPENINGS`, linearised there.
    """

    loop: ClosedLoop
    experiment: Experiment
    state: Floats
    exogenous: Floats
    parameters: Floats
    row: dict[str, float]
    residual: float
    opened: "OpenedLoops"


def loop_operating_point(
    experiment: Experiment, x: float, v: float, nominal: Plant | None = None
) -> LoopOperatingPoint:
    """Solve for steady motion through a position; at v = 0 that is rest.

    Args:
        experiment: plant, gains and sample time.
        x: position in m, on the track.
        v: speed in m/s.
        nominal: the plant the controller was designed for, as a `Scenario` has it; default: the simulated one.

    Raises:
        ConfigurationError: a position off the track, a speed whose resistance the ropes cannot overcome, or gains
            with which nothing is steady.
    """
    calm = in_calm(experiment)
    prepare(calm)
    limits, needed = calm.controller.limits, resistance(v, DisturbanceInputs(), calm.plant)
    if not abs(needed) < limits.force:
        raise ConfigurationError(
            f"v = {v:g}: steady motion needs a force of {float(needed):.4g} N, must be within ±{limits.force:g} N "
            "(tension_max - reserve - tension_min)"
        )
    of_plant(x, v, limits.preload, calm.plant, tension_min=limits.tension_min, tension_max=limits.command_max)
    structure = with_taut_ropes(structure_of(calm))
    loop = closed_loop(structure)
    parameters = loop.vector(parameters_of(calm, nominal))
    found = loop_operating_points(structure, parameters[None], np.array([x]), np.array([v]), compiled=False)
    kind = calm.controller.law.kind
    if not found.repeats[0]:
        raise ConfigurationError(f"v = {v:g}: '{kind}' with these gains comes to no steady motion")
    if not found.steady[0]:
        command, _, *pulls = found.facts[0].tolist()
        raise ConfigurationError(
            f"v = {v:g}: steady motion of '{kind}' is beyond its limits: force command {command:.4g} N, "
            f"tensions {pulls[0]:.4g} and {pulls[1]:.4g} N"
        )
    state, outside = found.state[0], found.outside[0]
    row = dict(zip(loop.columns, np.array(loop.step(state, outside, parameters)[1]).ravel().tolist(), strict=True))
    row |= {"x": x, "v": v}  # as asked for, without round-off
    return LoopOperatingPoint(loop, calm, state, outside, parameters, row, float(found.residual[0]), found.opened)


def with_taut_ropes(structure: Structure) -> Structure:
    """A structure with ropes that never go slack."""
    return replace(structure, plant=replace(structure.plant, rope_slack=False))


def in_calm(experiment: Experiment) -> Experiment:
    """The experiment in calm water, with perfect sensors, and without what no motion is steady with.

    What goes round with drums and motors, eccentricity and ripple, and creeping ropes are disturbances of a loop, no
    part of it.
    """
    # a noise of 1 makes the noise inputs of the linear system readings in the sensor's unit
    sensors = replace(
        experiment.sensors,
        position_noise=1.0,
        position_resolution=0.0,
        position_drift=0.0,
        outage_length=0.0,
        speed_noise=1.0,
        tension_noise=1.0,
        encoder_counts=0,
    )
    simulation = replace(experiment.simulation, jitter=0.0)
    plant = experiment.plant
    still = {"eccentricity": 0.0, "torque_ripple": 0.0}
    winch_1, winch_2 = replace(plant.winch_1, **still), replace(plant.winch_2, **still)
    plant = replace(plant, winch_1=winch_1, winch_2=winch_2, creep_1=Creep(), creep_2=Creep())
    return replace(experiment, plant=plant, disturbance=Disturbance(), sensors=sensors, simulation=simulation)


@dataclass(frozen=True, eq=False)
class OpenedLoops:
    """Linear loops (s) opened at all of `LOOP_OPENINGS`: ``x+ = A x + B c``, ``returned = C x + D c``.

    Attributes:
        A, B, C, D: (s, n, n), (s, n, 3), (s, 3, n), (s, 3, 3).
        states: indices of the n states among those of the closed loop: those that are no bookkeeping.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    states: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class LoopOperatingPoints:
    """What was found at s points.

    Attributes:
        repeats: (s,) whether every state repeats there.
        steady: (s,) whether ropes are taut, too, and the force command is within its limits.
        state, outside: (s, states), (s, exogenous) of the closed loop there.
        facts: (s, 4) force command, what its limit leaves of it, and both tensions, in N.
        residual: (s,) largest change of a state that is left, over its size.
        opened: the loops there, opened at all of `LOOP_OPENINGS`.
    """

    repeats: Flags
    steady: Flags
    state: Floats
    outside: Floats
    facts: Floats
    residual: Floats
    opened: OpenedLoops


def loop_operating_points(
    structure: Structure,
    parameters: Floats,
    x: Floats,
    v: Floats,
    near: Floats | None = None,
    *,
    compiled: bool = True,
) -> LoopOperatingPoints:
    """Solve for steady motion at many points.

    1. Newton's method from a perfect controller's state: no errors, tensions as commanded.
    2. Where that does not converge: steps by least squares, in turns with what an estimator learns of the machine.
    3. Where that does not either: the same from where law and estimator come to without limits.

    Args:
        structure: of the closed loop, with ropes that never go slack.
        parameters: (s, parameters), as the closed loop takes them, of perfect sensors and a calm sea.
        x: (s,) positions in m.
        v: (s,) speeds in m/s.
        near: (s, states) of the points with other gains, NaN where none is known: where law and estimator begin.
        compiled: whether the sample is evaluated as compiled code; for a few points a compiler is not worth its time.

    Raises:
        DualwinchError: no compiler, or no usable cache folder.
    """
    sample = _open_sample(structure, compiled)
    start = _first_guesses(structure, sample, parameters, x, v, near)
    found = _newton(sample, start, ITERATIONS)
    for limited in (True, False):
        again = np.flatnonzero(~found.repeats)
        if not len(again):
            break
        begun = start[again] if limited else _without_limits(sample, start[again])
        found[again] = _in_turns(sample, begun, LEAST_SQUARES_ITERATIONS, least_squares=True)
    command, left, *pulls = found.facts.T
    steady = found.repeats & (command == left) & (np.min(pulls, axis=0) > 0)
    n, cuts = len(sample.kept), len(LOOP_OPENINGS)
    of_state, of_cut = found.slopes[:, : n + cuts, :n], found.slopes[:, : n + cuts, n + 1 :]
    opened = OpenedLoops(of_state[:, :n], of_cut[:, :n], of_state[:, n:], of_cut[:, n:], sample.kept)
    return LoopOperatingPoints(found.repeats, steady, found.state, found.outside, found.facts, found.residual, opened)


@dataclass(frozen=True, eq=False)
class _OpenSample:
    """A sample of the loop opened at all of `LOOP_OPENINGS`, with its exact derivatives.

    Attributes:
        loop: the closed loop.
        kept: (n,) indices of its states that are no bookkeeping.
        x, ropes: indices of the vehicle's position and of both drums' angles among those.
        moving: (n,) which of them go on with the vehicle, beside the drums.
        learnt: (n,) which of them are what has been learnt of a machine.
        adapting: (states,) which states are those of law and estimator.
        reference: index of the reference position among what comes from outside.
        evaluate: ``(state, exogenous, parameters, cut) -> (following, returned, facts, change, slopes)``, of many
            points: the kept states a sample later (n,), what comes back to the openings (3,), facts (4,) as in
            `LoopOperatingPoints`, both tensions' changes over the sample (2,); and the derivatives of following,
            returned and change by kept states, reference position and what leaves the openings (n + 5, n + 4).
    """

    loop: ClosedLoop
    kept: NDArray[np.intp]
    x: int
    ropes: list[int]
    moving: Flags
    learnt: Flags
    adapting: Flags
    reference: int
    evaluate: Callable[..., tuple[Floats, ...]]


@built_once
def _open_sample(structure: Structure, compiled: bool) -> _OpenSample:
    loop, function = closed_loop(structure), _open_function(structure)
    kept = np.flatnonzero(~loop.marked(Mark.BOOKKEEPING))
    names = [loop.states[index] for index in kept]
    ropes, moving = [names.index(name) for name in PLANT if "theta" in name], loop.marked(Mark.POSITION)[kept]
    moving[ropes] = False

    def interpreted(*vectors: Floats) -> tuple[Floats, ...]:
        outputs = [output.full() for output in function.call([ca.DM(vector.T) for vector in vectors])]
        split = [np.array(np.split(output, len(vectors[0]), axis=1)) for output in outputs]
        return *(column[:, :, 0] for column in split[:-1]), split[-1]

    return _OpenSample(
        loop=loop,
        kept=kept,
        x=names.index(PLANT[0]),
        ropes=ropes,
        moving=moving,
        learnt=loop.marked(Mark.LEARNT)[kept],
        adapting=np.array([name.startswith(("controller.law.", "controller.estimator.")) for name in loop.states]),
        reference=loop.exogenous.index("reference.x"),
        evaluate=native.compile(function, flags=QUICK_BUILD) if compiled else interpreted,  # pyright: ignore[reportArgumentType]
    )


@built_once
def _open_function(structure: Structure) -> ca.Function:
    loop, cut = closed_loop(structure), closed_loop(structure, cuts=tuple(LOOP_OPENINGS))
    arguments = [ca.SX.sym(name, cut.sample.size1_in(name)) for name in cut.sample.name_in()]
    state, exogenous, parameters, leaving = arguments
    following, row, _ = cut.step(*arguments)
    returned = cut.sample(*arguments)[cut.sample.name_out().index("returned")]
    kept = np.flatnonzero(~loop.marked(Mark.BOOKKEEPING)).tolist()
    values = dict(zip(loop.parameters, ca.vertsplit(parameters), strict=True))
    plant = with_leaves(template_of(structure).plant, values, "plant.")

    def forces(vector: ca.SX) -> ca.SX:
        named = dict(zip(loop.states, ca.vertsplit(vector), strict=True))
        return ca.vertcat(*tensions(PlantState(*(named[key] for key in PLANT)), plant))

    change = forces(following) - forces(state)
    facts = row[[loop.columns.index(name) for name in ("u", "u_sat", "F1", "F2")]]
    wanted = ca.vertcat(following[kept], returned, change)
    by_state, by_outside, by_cut = (ca.jacobian(wanted, vector) for vector in (state, exogenous, leaving))
    slopes = ca.horzcat(by_state[:, kept], by_outside[:, loop.exogenous.index("reference.x")], by_cut)
    return ca.Function(
        "open_sample",
        arguments,
        [ca.densify(value) for value in (following[kept], returned, facts, change, slopes)],
        ["state", "exogenous", "parameters", "cut"],
        ["following", "returned", "facts", "change", "slopes"],
        {"cse": True},
    )


@dataclass(frozen=True, eq=False)
class _Start:
    """Where Newton's method begins at s points, and what is given there: (s, ...) each."""

    parameters: Floats
    state: Floats
    outside: Floats
    cut: Floats
    v: Floats

    def __getitem__(self, points: NDArray[np.intp]) -> "_Start":
        return _Start(*(values[points] for values in vars(self).values()))

    def __setitem__(self, points: NDArray[np.intp], other: "_Start") -> None:
        for name, values in vars(self).items():
            values[points] = getattr(other, name)

    def having(self, sample: _OpenSample, values: Mapping[str, float]) -> "_Start":
        """A start with other values of those parameters that there are."""
        names, parameters = sample.loop.parameters, self.parameters.copy()
        for name in values.keys() & set(names):
            parameters[:, names.index(name)] = values[name]
        return replace(self, parameters=parameters)

    def carried(self, sample: _OpenSample) -> Floats:
        """(s,) how far in m the vehicle moves in a sample."""
        return self.v * self.parameters[:, sample.loop.parameters.index("simulation.sample_time")]


@dataclass(frozen=True, eq=False)
class _Solution:
    """Where Newton's method ended: whether everything repeats there, where that is, facts, residual and slopes."""

    repeats: Flags
    state: Floats
    outside: Floats
    cut: Floats
    facts: Floats
    residual: Floats
    slopes: Floats

    def __setitem__(self, points: NDArray[np.intp], other: "_Solution") -> None:
        for name, values in vars(self).items():
            values[points] = getattr(other, name)


def _first_guesses(
    structure: Structure, sample: _OpenSample, parameters: Floats, x: Floats, v: Floats, near: Floats | None
) -> _Start:
    """States, signals and what leaves the openings for a perfect controller: no errors, tensions as commanded."""
    loop = sample.loop
    limits = {
        name: parameters[:, loop.parameters.index(LIMITS + name)]
        for name in ("preload", "tension_min", "tension_max", "reserve")
    }
    lower, upper = limits["tension_min"], limits["tension_max"] - limits["reserve"]
    calm = np.zeros_like(x)
    asked = np.array([x, v, limits["preload"], calm, calm, lower, upper])
    plant = [index for index, name in enumerate(loop.parameters) if name.startswith("plant.")]
    point = operating_point_law(structure.plant)(asked, parameters[:, plant].T).full()
    state = start_function(structure)(parameters.T).full().T
    state[:, [loop.states.index(name) for name in PLANT]] = point[:6].T
    state[:, loop.marked(Mark.POSITION)], state[:, loop.marked(Mark.SPEED)] = x[:, None], v[:, None]
    if near is not None:
        state = np.where(sample.adapting & np.isfinite(near), near, state)
    outside = np.zeros((len(x), len(loop.exogenous)))
    outside[:, sample.reference], outside[:, loop.exogenous.index("reference.v")] = x, v
    force = point[8] - point[9]
    cut = np.array([force, point[6], point[7]]).T
    # what remembers the last sample, or whether there was one, knows it after two
    names = [loop.states[index] for index in sample.kept]
    remembers = np.array([name.startswith(("controller.", "actuator_")) for name in names])
    remembers &= ~loop.marked(Mark.POSITION, Mark.SPEED)[sample.kept]
    taken = sample.kept[remembers]
    for _ in range(2):
        state[:, taken] = sample.evaluate(state, outside, parameters, cut)[0][:, remembers]
    # the torque limit is that of the command too: a winch whose command is at its limit rests on the very edge of it,
    # and any ripple leaves its integral on the far side, where it holds its torque, as in a run
    for winch, command in (("winch_1", limits["preload"] + force), ("winch_2", limits["preload"] - force)):
        key = f"controller.coordination.{winch}.integral"
        if key in loop.states:
            at_limit = np.where(command / 2 <= lower, -PRESSED, np.where(command / 2 >= upper, PRESSED, 0.0))
            index = loop.states.index(key)
            state[:, index] = np.where(at_limit, at_limit, state[:, index])
    return _Start(parameters, state, outside, cut, v)


def _without_limits(sample: _OpenSample, start: _Start) -> _Start:
    """A start whose law and estimator are where they come to without limits of the tensions.

    A law whose integrals are far off starts at its limits, where it has no slope. An estimator that gates its
    measurements accepts all of them there; with such a one, the start is where all comes to with limits then.
    """
    loose = _in_turns(sample, start.having(sample, UNLIMITED | UNGATED), UNLIMITED_ITERATIONS).state
    begun = replace(start, state=np.where(sample.adapting & np.isfinite(loose), loose, start.state))
    if UNGATED.keys().isdisjoint(sample.loop.parameters):
        return begun
    found = _in_turns(sample, begun.having(sample, UNGATED), LEAST_SQUARES_ITERATIONS, least_squares=True)
    return replace(begun, state=found.state, outside=found.outside, cut=found.cut)


def _in_turns(sample: _OpenSample, start: _Start, iterations: int, *, least_squares: bool = False) -> _Solution:
    """Newton's method, first for all but what has been learnt of the machine, which follows from it.

    An estimate is far from linear in the information that it rests on, and that grows for thousands of samples. Where
    nothing else repeats, taking turns goes nowhere.
    """
    learnt = sample.learnt
    if not learnt.any():
        return _newton(sample, start, iterations, least_squares=least_squares)

    def turn(start: _Start) -> tuple[_Solution, _Start, Flags]:
        found = _newton(sample, start, iterations, least_squares=least_squares, held=learnt)
        there = replace(start, state=found.state, outside=found.outside, cut=found.cut)
        following, change, step = _learning(sample, there)
        settled = found.repeats & (change < RESIDUAL) & (step < STEP)
        return replace(found, repeats=settled), following, found.repeats & ~settled

    found, start, worth = turn(_learning(sample, start)[0])
    going = np.flatnonzero(worth)
    for _ in range(ROUNDS - 1):
        if not len(going):
            break
        found[going], start[going], worth = turn(start[going])
        going = going[worth]
    return found


def _learning(sample: _OpenSample, start: _Start) -> tuple[_Start, Floats, Floats]:
    """A start with what is learnt of the machine there; (s,) how that changed before, and the step to it (`_newton`).

    First comes what depends on nothing else that is learnt, then what does.
    """
    learnt, sizes = sample.learnt, np.maximum(np.abs(start.state[:, sample.kept]), 1.0)
    n, moved, changed = len(learnt), np.zeros_like(sizes), np.zeros(len(sizes))
    for alone in (True, False):
        given = start.state, start.outside, start.parameters, start.cut
        following, returned, _, change, slopes = sample.evaluate(*given)
        rest = np.hstack([following, returned]) - np.hstack([start.state[:, sample.kept], start.cut])
        matrix, _, unknown = _equations(sample, rest, change, slopes, start.carried(sample))
        changed = np.maximum(changed, (np.abs(rest[:, :n]) / sizes)[:, learnt].max(axis=1))
        others = ((matrix[:, :n, :n] != 0) & learnt & ~np.eye(n, dtype=bool)).any(axis=2)
        unknown[:, :n] &= learnt & ~(others & alone)
        unknown[:, n:] = False
        step = _step(matrix, rest, unknown, least_squares=False)[:, :n]
        state = start.state.copy()
        state[:, sample.kept] += np.where(np.isfinite(step), step, 0.0)
        moved, start = moved + step, replace(start, state=state)
    return start, changed, (np.abs(moved) / sizes).max(axis=1)


def _newton(
    sample: _OpenSample, start: _Start, iterations: int, *, least_squares: bool = False, held: Flags | None = None
) -> _Solution:
    """Newton's method at all points; one that has come to its end is left alone.

    By least squares it takes the shortest step where there are many, as at rest with a law that leaves something free.
    Held states stay as they are.
    """
    parameters, state, outside, cut = start.parameters, start.state.copy(), start.outside.copy(), start.cut.copy()
    count, n = len(state), len(sample.kept)
    facts, slopes = np.full((count, 4), np.nan), np.full((count, n + 5, n + 4), np.nan)
    residual, left = np.full(count, np.inf), np.full(count, np.inf)
    carried = start.carried(sample)
    active = np.arange(count)
    for _ in range(iterations):
        given = state[active], outside[active], parameters[active], cut[active]
        following, returned, facts[active], change, slopes[active] = sample.evaluate(*given)
        values = np.hstack([state[np.ix_(active, sample.kept)], cut[active]])
        rest = np.hstack([following, returned]) - values
        matrix, counted, unknown = _equations(sample, rest, change, slopes[active], carried[active])
        if held is not None:
            counted[:, :n] &= ~held
            unknown[:, :n] &= ~held
        last, sizes = residual[active], np.maximum(np.abs(values), 1.0)
        residual[active] = np.where(counted, np.abs(rest) / sizes, 0.0).max(axis=1)
        residual[active[~np.isfinite(matrix).all(axis=(1, 2))]] = np.inf
        going = np.isfinite(residual[active])
        going &= ~((last < RESIDUAL) & (residual[active] >= last / 2) & (left[active] < STEP))
        active = active[going]
        if not len(active):
            break
        step = _step(matrix[going], rest[going], unknown[going], least_squares=least_squares)
        sizes, step_x = sizes[going], step[:, sample.x].copy()
        sizes[:, sample.x] = np.maximum(np.abs(outside[active, sample.reference]), 1.0)
        left[active] = (np.abs(step) / sizes).max(axis=1)
        outside[active, sample.reference] += step_x
        step[:, sample.x] = 0.0
        state[np.ix_(active, sample.kept)] += step[:, :n]
        cut[active] += step[:, n:]
    repeats = (residual < RESIDUAL) & (left < STEP)
    return _Solution(repeats, state, outside, cut, facts, residual, slopes)


def _equations(
    sample: _OpenSample, rest: Floats, change: Floats, slopes: Floats, carried: Floats
) -> tuple[Floats, Flags, Flags]:
    """What Newton's method solves for: the kept states, n of them, and what leaves the openings.

    `rest` is brought into the units of the equations. In the place of the vehicle's position, which is given, the
    unknown is the reference's.

    Returns:
        Matrices (a, n + 3, n + 3), which values something depends on, and which are unknown.
    """
    n, ropes, moving = len(sample.kept), sample.ropes, sample.moving
    units = np.ones(n + 3)
    units[: len(moving)][moving] = POSITION_UNIT
    rest[:, : len(moving)][:, moving] -= carried[:, None]
    rest *= units
    rest[:, ropes] = change * ROPE_UNIT
    every = slopes[:, : n + 3].copy()
    every[:, :n, :n] -= np.eye(n)
    every[:, n:, n + 1 :] -= np.eye(3)
    every *= units[:, None]
    every[:, ropes] = slopes[:, n + 3 :] * ROPE_UNIT
    matrix = np.delete(every, n, axis=2)
    # a state that nothing depends on may grow for ever; one that nothing moves, such as an integral without a gain, is
    # where it began
    counted, moved = (matrix != 0).any(axis=1), (matrix != 0).any(axis=2)
    counted[:, n:] = True
    unknown = counted & moved
    matrix[:, :, sample.x], unknown[:, sample.x] = every[:, :, n], True
    return matrix, counted, unknown


def _step(matrix: Floats, rest: Floats, unknown: Flags, *, least_squares: bool) -> Floats:
    """Newton steps in units in which rows and columns are of one size: zero for what is no unknown, NaN for no step."""
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
        return np.array([np.linalg.lstsq(*pair, rcond=1e-13)[0] for pair in pairs]) / columns
    try:
        return np.linalg.solve(matrix, right[..., None])[..., 0] / columns
    except np.linalg.LinAlgError:  # a law at its limits answers to nothing
        singular = np.linalg.slogdet(matrix)[0] == 0
        matrix[singular] = np.eye(matrix.shape[1])
        step = np.linalg.solve(matrix, right[..., None])[..., 0] / columns
        step[singular] = np.nan
        return step
