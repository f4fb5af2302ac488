"""Smallest stability margins of machines over positions on the track and over all loop openings."""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from dualwinch.analysis.describing_function import DescribingGains
from dualwinch.analysis.margins import BOTH, MARGIN_KINDS, comparable, complementary, least_margins
from dualwinch.analysis.operating_points import in_calm, still_plant, with_taut_ropes
from dualwinch.analysis.resonance import LARGE_SIGNAL, MARGIN_AMPLITUDES, resonance_terms
from dualwinch.analysis.steady_motion import loop_operating_points, open_sample
from dualwinch.model.linear.operating_point import resistance
from dualwinch.model.plant import DisturbanceInputs
from dualwinch.model.reference import largest_speed
from dualwinch.simulation.batch.workers import Item, Returned, cores, map_all
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import LOOP_OPENINGS, closed_loop
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.scenario import Scenario

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

SHARES = (0.05, 0.5, 0.95)
"""Positions as shares of the track: near its ends, where one rope is short and stiff, and in the middle."""

TOGETHER = 48
"""Places (gains, machine and point) computed at once, few enough for the processor's cache."""

ODD_POWERS = tuple(f"controller.nftsm.{name}" for name in ("p", "smoothing", "beta", "q", "linear_speed"))
"""Keys of the sliding-mode law on which the slopes of its odd powers of the speed error depend; the last may lack."""


UNSTABLE, UNSTEADY = "unstable", "no steady motion"
"""Reasons for a margin of 0."""


@dataclass(frozen=True)
class WorstMargin:
    """The smallest margin of some machines, and where it occurs.

    Attributes:
        value: as in `analysis.margins.Margins`; 0 if a loop is unstable or has no steady motion, infinite
            if no such change makes any loop unstable.
        machine: index of the machine.
        x, v: position in m and speed in m/s of the operating point.
        opening: one of `LOOP_OPENINGS` or `margins.BOTH`; empty where the value is 0 or infinite.
        frequency: angular frequency in rad/s at which the loop would oscillate; NaN likewise.
        reason: for a value of 0, `UNSTABLE` or `UNSTEADY`; else empty.
        amplitude: of the speed error in m/s; 0: infinitesimal motions.
    """

    value: float
    machine: int
    x: float
    v: float
    opening: str = ""
    frequency: float = math.nan
    reason: str = ""
    amplitude: float = 0.0


def comparable_value(margin: WorstMargin) -> float:
    """The value by which margins are compared (`margins.comparable`)."""
    return float(comparable(margin.value))


def survey_points(experiment: Experiment) -> list[tuple[float, float]]:
    """Positions in m and speeds in m/s of a survey: `SHARES` of the track, at rest and at speed in either direction.

    The speed is the largest of the reference; it is left out where it requires more force than the machine has.
    """
    fastest = largest_speed(experiment.reference, experiment.duration)
    needed = float(resistance(fastest, DisturbanceInputs(), experiment.plant, experiment.plant.track.length / 2))
    steady = fastest > 0 and abs(needed) < experiment.controller.limits.force
    speeds = (-fastest, 0.0, fastest) if steady else (0.0,)
    return [(share * experiment.plant.track.length, v) for share in SHARES for v in speeds]


class MarginSurvey:
    """The margins of some machines at all their points and openings, for many sets of gains.

    A machine is an experiment, or a scenario whose controller has another nominal plant than the drawn one. Sensors are
    perfect and disturbances absent, as in `linear_loop`.

    Margins are those of infinitesimal motions, or the smallest at some amplitudes of the speed error: the sliding-mode
    law feeds back odd powers of it, whose slopes at zero say little about a loop with noisy sensors. For an amplitude,
    the slopes are replaced by describing functions (`describing_function`), N of ``|e2|^(2 - p/q)`` and M of
    ``|e2|^(p/q)``. With a smoothing of 1 m/s the slopes of the powers are 1; the law then has these gains with
    ``beta/M`` in place of beta and ``p/(N M)`` in place of p.

    Attributes:
        machines: the given machines.
        loops: (l, 3) indices of machine, point and amplitude of every loop.
    """

    def __init__(
        self,
        machines: Sequence[Experiment | Scenario],
        names: Sequence[str] = (),
        threads: int | None = None,
        openings: Collection[str] = (*LOOP_OPENINGS, BOTH),
        amplitudes: Collection[float] = (0.0,),
        *,
        compiled: bool = True,
    ) -> None:
        """Set up a survey.

        Args:
            machines: of one structure.
            names: keys of the varied numbers, as in `rollout`.
            threads: number of threads; default: one per core.
            openings: one at a time; `margins.BOTH`: both torques change alike.
            amplitudes: of the speed error in m/s; 0: infinitesimal motions. Ignored for laws without odd powers of
                it, whose margins do not depend on the amplitude.
            compiled: whether the loop's sample is compiled; for a single set of gains interpretation is quicker.
        """
        self._compiled = compiled
        self.machines, self._threads, self._openings = tuple(machines), threads, openings
        calm = [in_calm(machine.experiment if isinstance(machine, Scenario) else machine) for machine in machines]
        nominal = [machine.nominal if isinstance(machine, Scenario) else None for machine in machines]
        calm_nominal = [plant and still_plant(plant) for plant in nominal]
        self._structure = with_taut_ropes(structure_of(calm[0]))
        self._dt = calm[0].simulation.sample_time
        loop = closed_loop(self._structure)
        pairs = zip(calm, calm_nominal, strict=True)
        self._parameters = np.array([loop.vector(parameters_of(experiment, nominal)) for experiment, nominal in pairs])
        self._columns = [loop.parameters.index(name) for name in names]
        self._length = loop.parameters.index("plant.track.length")
        self._powers = [loop.parameters.index(key) for key in ODD_POWERS if key in loop.parameters]
        self._amplitudes = tuple(amplitudes) if self._powers else (0.0,)
        self._points = [np.array(survey_points(experiment)) for experiment in calm]
        self.loops = np.array(
            [
                (machine, point, amplitude)
                for machine, points in enumerate(self._points)
                for point in range(len(points))
                for amplitude in range(len(self._amplitudes))
            ]
        )

    def compile(self) -> None:
        """Compile what a survey calls, so that the first takes no longer.

        Raises:
            DualwinchError: no compiler or no usable cache folder.
        """
        open_sample(self._structure, compiled=self._compiled)

    def loops_at(self, places: Collection[tuple[int, int]]) -> Indices:
        """Indices into `loops` of those at some places, each the number of an operating point and an amplitude."""
        return np.flatnonzero([(point, amplitude) in places for _, point, amplitude in self.loops.tolist()])

    def worst(
        self, values: ArrayLike, kinds: Collection[str] = MARGIN_KINDS, loops: Indices | None = None
    ) -> list[dict[str, WorstMargin]]:
        """The smallest margins over all machines, for every set of numbers.

        Args:
            values: (n, names).
            kinds: of `margins.MARGIN_KINDS` and `resonance.MARGIN_AMPLITUDES`; the latter need no compiler.
            loops: indices into `self.loops`; default: all.

        Returns:
            Kind → smallest margin, for each of the n sets.

        Raises:
            KeyboardInterrupt: interrupted.
            DualwinchError: no compiler or no usable cache folder.
        """
        indices = np.arange(len(self.loops)) if loops is None else loops
        of_rows = [of_row[0] for of_row in self._least(values, kinds, indices, np.zeros(len(indices), np.intp))]
        for kind in MARGIN_AMPLITUDES.keys() & set(kinds):
            for of_row, resonances in zip(of_rows, self._resonances(values, kind), strict=True):
                of_row[kind] = min(resonances, key=comparable_value)
        return of_rows

    def each(
        self, values: ArrayLike, kinds: Collection[str] = MARGIN_KINDS, loops: Indices | None = None
    ) -> list[list[dict[str, WorstMargin]]]:
        """`worst` for each machine that has some of the loops: kind → smallest margin, for each of the n sets."""
        indices = np.arange(len(self.loops)) if loops is None else loops
        machines, group = np.unique(self.loops[indices, 0], return_inverse=True)
        of_rows = self._least(values, kinds, indices, group)
        for kind in MARGIN_AMPLITUDES.keys() & set(kinds):
            for of_row, resonances in zip(of_rows, self._resonances(values, kind), strict=True):
                for of_machine, machine in zip(of_row, machines, strict=True):
                    of_machine[kind] = resonances[machine]
        return of_rows

    def of_loops(
        self, values: ArrayLike, kinds: Collection[str], loops: Indices | None = None
    ) -> list[list[dict[str, WorstMargin]]]:
        """The margins of single loops, for each of the n sets; arguments as in `worst`, but of `MARGIN_KINDS` only.

        Margins far above the smallest are only read off a frequency grid.
        """
        indices = np.arange(len(self.loops)) if loops is None else loops
        return self._least(values, kinds, indices, np.arange(len(indices)), roughly=True)

    def _least(
        self, values: ArrayLike, kinds: Collection[str], loops: Indices, group: Indices, *, roughly: bool = False
    ) -> list[list[dict[str, WorstMargin]]]:
        """Kind of `MARGIN_KINDS` → smallest margin of each group of loops, for each of the n sets.

        `group` is the index of the group of each loop, from 0. Roughly: margins far above the smallest of all groups
        are only read off a frequency grid.
        """
        rows = np.atleast_2d(np.asarray(values, float))
        of_loops = [kind for kind in kinds if kind not in MARGIN_AMPLITUDES]
        of_rows = [[dict[str, WorstMargin]() for _ in range(int(group.max()) + 1)] for _ in rows]
        if not of_loops:
            return of_rows
        loops_of_place: dict[tuple[int, int], list[tuple[int, int]]] = {}
        for (machine, point, amplitude), number in zip(self.loops[loops].tolist(), group.tolist(), strict=True):
            loops_of_place.setdefault((machine, point), []).append((amplitude, number))
        open_sample(self._structure, compiled=self._compiled)  # compiled once, before the threads start
        places = [(row, *place) for row in range(len(rows)) for place in loops_of_place]
        work = partial(self._of_places, rows, loops_of=loops_of_place, kinds=of_loops, roughly=roughly)
        parts = _in_chunks(work, places, self._threads)
        for row, number, worst in parts:
            for kind, one in worst.items():
                of_rows[row][number][kind] = min(of_rows[row][number].get(kind, one), one, key=comparable_value)
        return of_rows

    def _resonances(self, values: ArrayLike, kind: str) -> list[list[WorstMargin]]:
        """Margins of the drum resonances of all machines, at the worst amplitude of a kind, for each of the n sets."""
        rows, count = np.atleast_2d(np.asarray(values, float)), len(self.machines)
        machines = np.tile(np.arange(count), len(rows))
        parameters = self._parameters_with(np.repeat(rows, count, axis=0), machines)
        middle = parameters[:, self._length] / 2
        amplitudes = MARGIN_AMPLITUDES[kind]
        terms = resonance_terms(self._structure, parameters, middle, amplitudes)
        terms = terms.reshape(len(machines), -1, terms.shape[-1])
        worst, margins = comparable(terms[..., -1]).argmax(axis=1), []
        for number, (index, x) in enumerate(zip(worst.tolist(), middle.tolist(), strict=True)):
            frequency, *_, gain = terms[number, index].tolist()
            opening, omega = f"tau_{1 + index % 2}", 2 * math.pi * frequency
            margin, machine = 1 / gain if gain else math.inf, int(machines[number])
            amplitude = amplitudes[index // 2] if kind == LARGE_SIGNAL else 0.0
            margins.append(WorstMargin(margin, machine, x, 0.0, opening, omega, amplitude=amplitude))
        return [margins[begin : begin + count] for begin in range(0, len(margins), count)]

    def _parameters_with(self, values: Floats, machines: NDArray[np.intp]) -> Floats:
        """Parameters (n, parameters) of machines with values (n, names) of the varied numbers."""
        parameters = self._parameters[machines]
        parameters[:, self._columns] = values
        return parameters

    def _with_describing_slopes(self, amplitude: float, parameters: Floats) -> Floats:
        """Parameters (n, parameters) of laws whose slopes at zero equal their describing functions at an amplitude."""
        if not amplitude:
            return parameters
        p, smoothing, beta, q, *linear_speed = parameters[:, self._powers].T
        gains = DescribingGains.of(amplitude, p / q, smoothing, *linear_speed)
        equivalent = p / (gains.terminal * gains.surface), np.ones_like(p), beta / gains.surface
        changed = parameters.copy()
        changed[:, self._powers[: len(equivalent)]] = np.column_stack(equivalent)
        return changed

    def _of_places(
        self,
        values: Floats,
        places: Sequence[tuple[int, int, int]],
        loops_of: Mapping[tuple[int, int], Sequence[tuple[int, int]]],
        kinds: Sequence[str],
        *,
        roughly: bool,
    ) -> list[tuple[int, int, dict[str, WorstMargin]]]:
        """The smallest margins of groups of loops at some places: row, group and margins.

        A place is a row of the values (n, names), a machine and a point; `loops_of`: amplitude and group of each loop
        there. The steady motion hardly depends on the amplitude: that of the first one is the initial guess for the
        others.
        """
        rows, machines, _ = np.array(places).T
        parameters = self._parameters_with(values[rows], machines)
        x, v = np.array([self._points[machine][point] for _, machine, point in places]).T
        loops = [(place, *each) for place, (_, *of) in enumerate(places) for each in loops_of[of[0], of[1]]]
        place, amplitude, number = np.array(loops).T
        group, member = np.unique(np.column_stack([rows[place], number]), axis=0, return_inverse=True)
        member = member.ravel()
        guess, opened, order, steady = None, [], [], np.zeros(len(loops), bool)
        for index, size in enumerate(self._amplitudes):
            mine = np.flatnonzero(amplitude == index) if index else np.arange(len(places))
            at = place[mine] if index else mine
            steep = self._with_describing_slopes(size, parameters[at])
            begun = None if guess is None else guess[at]
            points = loop_operating_points(self._structure, steep, x[at], v[at], begun=begun, compiled=self._compiled)
            if guess is None:
                guess, mine = points, np.flatnonzero(amplitude == index)
                points = points[place[mine]]
            steady[mine] = points.steady
            order.append(mine[points.steady])
            opened.append([matrix[points.steady] for matrix in points.opened])
        which, stable = np.concatenate(order), steady.copy()
        A, B, C, D = (np.concatenate(parts) for parts in zip(*opened, strict=True))
        closed = complementary(A, B, C, D, self._dt)
        stable[which] = closed.stable
        among = rows[place[which]] if roughly else None
        smallest = least_margins(closed, member[which], kinds, len(group), self._openings, among=among)
        margins_of_groups = []
        for index, (row, of) in enumerate(group.tolist()):
            mine = np.flatnonzero(member == index)
            failed = mine[~stable[mine]]
            words = {}
            for kind in kinds:
                one = smallest[index][kind]
                at_loop = int(failed[0]) if len(failed) else int(which[one.loop]) if one.loop >= 0 else int(mine[0])
                spot = int(machines[place[at_loop]]), float(x[place[at_loop]]), float(v[place[at_loop]])
                size = self._amplitudes[amplitude[at_loop]]
                if len(failed):
                    reason = UNSTABLE if steady[at_loop] else UNSTEADY
                    words[kind] = WorstMargin(0.0, *spot, reason=reason, amplitude=size)
                else:
                    words[kind] = WorstMargin(one.value, *spot, one.opening, one.frequency, "", size)
            margins_of_groups.append((row, of, words))
        return margins_of_groups


def _in_chunks(
    work: Callable[[Sequence[Item]], list[Returned]], items: Sequence[Item], threads: int | None
) -> list[Returned]:
    """Apply `work` to items, up to `TOGETHER` at a time, on threads; BLAS then uses a single thread.

    Raises:
        KeyboardInterrupt: interrupted.
    """
    size = max(1, min(TOGETHER, math.ceil(len(items) / (threads or cores()))))
    chunks = [items[begin : begin + size] for begin in range(0, len(items), size)]
    with threadpool_limits(1, user_api="blas"):
        return [each for chunk in map_all(work, chunks, threads) for each in chunk]
