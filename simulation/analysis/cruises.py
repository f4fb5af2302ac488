"""Many steady cruises of the sampled closed loop side by side: what `loop_cruise` solves for, for tuning.

The same conditions in the same units. What leaves the cuts of the open sample is solved for beside the states, and the
derivatives that are left at the end are those of the loop cut open there.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.linear.operating_point import cruise_law
from dualwinch.model.quantities.quantity import Mark
from dualwinch.simulation.analysis.loop_cruise import BELIEVING, LIMITS, PRESSED, RESIDUAL, ROUNDS, STEP, UNLIMITED
from dualwinch.simulation.analysis.open_sample import OpenSample, open_sample
from dualwinch.simulation.loop.closed_loop import start_function
from dualwinch.simulation.loop.structure import Structure

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

ITERATIONS, LOOSE_ITERATIONS, PATIENT_ITERATIONS = 16, 6, 24
"""Newton steps at most: at first; without limits, to begin again from there; and then."""

REPEATS, SETTLED = 30 * RESIDUAL, 30 * STEP
"""Largest change and step that are left, as `loop_cruise` counts them, where a winch's gains amplify round-off: what
is no cruise leaves a thousand times more."""

ROPE_UNIT, POSITION_UNIT = 1e-3, 1e3
"""Changes of tension are counted in kN, those of position beyond ``v Ts`` in mm."""

PLANT = tuple(f"motion.plant.{name}" for name in ("x", "v", "theta_1", "omega_1", "theta_2", "omega_2"))
"""States of the plant; a rope's tension has to repeat, and its drum's angle may go on."""


@dataclass(frozen=True, eq=False)
class Cruises:
    """What was found at s points.

    Attributes:
        steady: (s,) whether every state repeats there, with taut ropes and the force command within its limits.
        state: (s, states) of the closed loop there; NaN where there is no such cruise.
        slopes: (s, n + 5, n + 4) derivatives of the open sample there (`OpenSample.evaluate`).
    """

    steady: Flags
    state: Floats
    slopes: Floats


def cruises(structure: Structure, parameters: Floats, x: Floats, v: Floats, near: Floats | None = None) -> Cruises:
    """Solve for steady cruise at many points.

    Args:
        structure: of the closed loop, with ropes that never go slack.
        parameters: (s, parameters), as the closed loop takes them, of perfect sensors and a calm sea.
        x: (s,) positions in m.
        v: (s,) speeds in m/s.
        near: (s, states) cruises there with other gains, NaN where none is known: where law and estimator begin.

    Raises:
        DualwinchError: no compiler, or no usable cache folder.
    """
    sample = open_sample(structure)
    start = _first_guesses(structure, sample, parameters, x, v, near)
    found = _solved(sample, start, ITERATIONS)
    for limited in (True, False):
        again = np.flatnonzero(~found.repeats)
        if not len(again):
            break
        begun = start[again] if limited else _without_limits(sample, start[again])
        found[again] = _in_turns(sample, begun, PATIENT_ITERATIONS, patient=True)
    force, left, *pulls = found.facts.T
    steady = found.repeats & (force == left) & (np.min(pulls, axis=0) > 0)
    return Cruises(steady, np.where(steady[:, None], found.state, np.nan), found.slopes)


def _learnt(sample: OpenSample) -> Flags:
    """(states,) which are those of law and estimator."""
    return np.array([name.startswith(("controller.law.", "controller.estimator.")) for name in sample.loop.states])


def _without_limits(sample: OpenSample, start: "_Start") -> "_Start":
    """A start whose law and estimator are where they come to without limits of the tensions.

    A law whose integrals are far off starts at its limits, where it has no slope. An estimator that judges what it
    reads believes everything there; with such a one, the start is where all comes to with limits then.
    """
    names = sample.loop.parameters
    loose = _in_turns(sample, _with(sample, start, UNLIMITED | BELIEVING), LOOSE_ITERATIONS).state
    begun = replace(start, state=np.where(_learnt(sample) & np.isfinite(loose), loose, start.state))
    if BELIEVING.keys().isdisjoint(names):
        return begun
    found = _in_turns(sample, _with(sample, begun, BELIEVING), PATIENT_ITERATIONS, patient=True)
    return replace(begun, state=found.state, outside=found.outside, cut=found.cut)


def _with(sample: OpenSample, start: "_Start", values: Mapping[str, float]) -> "_Start":
    """A start with other values of those parameters that there are."""
    names, parameters = sample.loop.parameters, start.parameters.copy()
    for name in values.keys() & set(names):
        parameters[:, names.index(name)] = values[name]
    return replace(start, parameters=parameters)


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

    @property
    def given(self) -> tuple[Floats, ...]:
        """What the sample takes."""
        return self.state, self.outside, self.parameters, self.cut

    def carried(self, sample: OpenSample) -> Floats:
        """(s,) how far in m the vehicle moves in a sample."""
        return self.v * self.parameters[:, sample.loop.parameters.index("simulation.sample_time")]


@dataclass(frozen=True, eq=False)
class _Solution:
    """Where Newton's method ended: whether everything repeats there, where that is, facts and slopes."""

    repeats: Flags
    state: Floats
    outside: Floats
    cut: Floats
    facts: Floats
    slopes: Floats

    def __setitem__(self, points: NDArray[np.intp], other: "_Solution") -> None:
        for name, values in vars(self).items():
            values[points] = getattr(other, name)


def _first_guesses(
    structure: Structure, sample: OpenSample, parameters: Floats, x: Floats, v: Floats, near: Floats | None
) -> _Start:
    """States, signals and what leaves the cuts for a perfect controller: no errors, tensions as commanded."""
    loop = sample.loop
    limits = {
        name: parameters[:, loop.parameters.index(LIMITS + name)]
        for name in ("preload", "tension_min", "tension_max", "reserve")
    }
    lower, upper = limits["tension_min"], limits["tension_max"] - limits["reserve"]
    calm = np.zeros_like(x)
    asked = np.array([x, v, limits["preload"], calm, calm, lower, upper])
    plant = [index for index, name in enumerate(loop.parameters) if name.startswith("plant.")]
    point = cruise_law(structure.plant)(asked, parameters[:, plant].T).full()
    state = start_function(structure)(parameters.T).full().T
    state[:, [loop.states.index(name) for name in PLANT]] = point[:6].T
    state[:, loop.marked(Mark.POSITION)], state[:, loop.marked(Mark.SPEED)] = x[:, None], v[:, None]
    if near is not None:
        state = np.where(_learnt(sample) & np.isfinite(near), near, state)
    outside = np.zeros((len(x), len(loop.exogenous)))
    outside[:, loop.exogenous.index("reference.x")], outside[:, loop.exogenous.index("reference.v")] = x, v
    force = point[8] - point[9]
    cut = np.array([force, point[6], point[7]]).T
    # what remembers the last sample, or whether there was one, knows it after two
    names = [loop.states[index] for index in sample.kept]
    remembers = np.array([name.startswith(("controller.", "actuator_")) for name in names])
    remembers &= ~loop.marked(Mark.POSITION, Mark.SPEED)[sample.kept]
    taken = sample.kept[remembers]
    for _ in range(2):
        state[:, taken] = sample.evaluate(state, outside, parameters, cut)[0][:, remembers]
    for winch, command in (("winch_1", limits["preload"] + force), ("winch_2", limits["preload"] - force)):
        key = f"controller.coordination.{winch}.integral"
        if key in loop.states:
            at_limit = np.where(command / 2 <= lower, -PRESSED, np.where(command / 2 >= upper, PRESSED, 0.0))
            index = loop.states.index(key)
            state[:, index] = np.where(at_limit, at_limit, state[:, index])
    return _Start(parameters, state, outside, cut, v)


def _in_turns(sample: OpenSample, start: _Start, iterations: int, *, patient: bool = False) -> _Solution:
    """Newton's method, first for all but what has been learnt of the machine, which follows from it.

    An estimate is far from linear in the information that it rests on, and that grows for thousands of samples. Where
    nothing else repeats, taking turns goes nowhere.
    """
    learnt = sample.loop.marked(Mark.LEARNT)[sample.kept]
    if not learnt.any():
        return _solved(sample, start, iterations, patient=patient)

    def turn(start: _Start) -> tuple[_Solution, _Start, Flags]:
        found = _solved(sample, start, iterations, patient=patient, held=learnt)
        there = replace(start, state=found.state, outside=found.outside, cut=found.cut)
        following, change, step = _learning(sample, there, learnt)
        settled = found.repeats & (change < REPEATS) & (step < SETTLED)
        return replace(found, repeats=settled), following, found.repeats & ~settled

    found, start, worth = turn(_learning(sample, start, learnt)[0])
    going = np.flatnonzero(worth)
    for _ in range(ROUNDS - 1):
        if not len(going):
            break
        found[going], start[going], worth = turn(start[going])
        going = going[worth]
    return found


def _learning(sample: OpenSample, start: _Start, learnt: Flags) -> tuple[_Start, Floats, Floats]:
    """A start with what is learnt of the machine there; (s,) how that changed before, and the step to it (`_solved`).

    First comes what depends on nothing else that is learnt, then what does.
    """
    n, sizes = len(learnt), np.maximum(np.abs(start.state[:, sample.kept]), 1.0)
    moved, changed = np.zeros_like(sizes), np.zeros(len(sizes))
    for alone in (True, False):
        following, returned, _, change, slopes = sample.evaluate(*start.given)
        rest = np.hstack([following, returned]) - np.hstack([start.state[:, sample.kept], start.cut])
        matrix, _, unknown = _equations(sample, rest, change, slopes, start.carried(sample))
        changed = np.maximum(changed, (np.abs(rest[:, :n]) / sizes)[:, learnt].max(axis=1))
        others = ((matrix[:, :n, :n] != 0) & learnt & ~np.eye(n, dtype=bool)).any(axis=2)
        unknown[:, :n] &= learnt & ~(others & alone)
        unknown[:, n:] = False
        step = _step(matrix, rest, unknown, patient=False)[:, :n]
        state = start.state.copy()
        state[:, sample.kept] += np.where(np.isfinite(step), step, 0.0)
        moved, start = moved + step, replace(start, state=state)
    return start, changed, (np.abs(moved) / sizes).max(axis=1)


def _solved(
    sample: OpenSample, start: _Start, iterations: int, *, patient: bool = False, held: Flags | None = None
) -> _Solution:
    """Newton's method at all points; one that has come to its end is left alone.

    Patient, it takes the shortest step where there are many, as at rest with a law that leaves something free. Held
    states stay as they are.
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
        going &= ~((last < REPEATS) & (residual[active] >= last / 2) & (left[active] < SETTLED))
        active = active[going]
        if not len(active):
            break
        step = _step(matrix[going], rest[going], unknown[going], patient=patient)
        sizes, step_x = sizes[going], step[:, sample.x].copy()
        sizes[:, sample.x] = np.maximum(np.abs(outside[active, sample.reference]), 1.0)
        left[active] = (np.abs(step) / sizes).max(axis=1)
        outside[active, sample.reference] += step_x
        step[:, sample.x] = 0.0
        state[np.ix_(active, sample.kept)] += step[:, :n]
        cut[active] += step[:, n:]
    return _Solution((residual < REPEATS) & (left < SETTLED), state, outside, cut, facts, slopes)


def _equations(
    sample: OpenSample, rest: Floats, change: Floats, slopes: Floats, carried: Floats
) -> tuple[Floats, Flags, Flags]:
    """What Newton's method solves for: the kept states, n of them, and what leaves the cuts.

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
    counted, moved = (matrix != 0).any(axis=1), (matrix != 0).any(axis=2)
    counted[:, n:] = True
    unknown = counted & moved
    matrix[:, :, sample.x], unknown[:, sample.x] = every[:, :, n], True
    return matrix, counted, unknown


def _step(matrix: Floats, rest: Floats, unknown: Flags, *, patient: bool) -> Floats:
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
    if patient:
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
