"""The least stability margins of machines, wherever they are on the track, cut wherever the loop can be cut."""

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from dualwinch.model.linear.operating_point import resistance
from dualwinch.model.plant import DisturbanceInputs
from dualwinch.model.reference import setpoint
from dualwinch.simulation.analysis.describing_function import describing_gain
from dualwinch.simulation.analysis.margins import BOTH, KINDS, complementary, least_margins
from dualwinch.simulation.analysis.operating_points import in_calm, loop_operating_points, still_plant, with_taut_ropes
from dualwinch.simulation.analysis.resonance import RESONANCE, resonance_terms
from dualwinch.simulation.batch.workers import Item, Outcome, map_all
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import LOOP_OPENINGS, closed_loop
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.scenario import Scenario

Floats = NDArray[np.float64]

SHARES = (0.05, 0.5, 0.95)
"""Positions as shares of the track: ropes are stiff where they are short, and alike in the middle."""

INSTANTS = 1000
"""Instants of a run at which its reference's speed is looked at."""

TOGETHER = 16
"""Pairs of gains and machine that are worked out at once: so many that what is in hand stays in a processor's cache."""

ODD_POWERS = "controller.nftsm.p", "controller.nftsm.q", "controller.nftsm.smoothing"
"""Keys of the sliding-mode law's odd powers of the speed error."""

VALUE = attrgetter("value")

UNSTABLE, UNSTEADY = "unstable", "no steady motion"
"""Why a machine has no margin at a point."""


@dataclass(frozen=True)
class WorstMargin:
    """The least margin of some machines, and where it is attained.

    Attributes:
        value: as in `simulation.analysis.margins.Margins`; 0 where a loop is unstable or has no steady motion, infinite
            where nothing makes any of the loops unstable.
        machine: index of the machine.
        x, v: position in m and speed in m/s of the operating point.
        cut: where the loop is cut, one of `LOOP_OPENINGS`, or `margins.BOTH`; empty where the value is 0 or infinite.
        frequency: angular frequency in rad/s at which the loop would oscillate; NaN likewise.
        reason: why the value is 0 (`UNSTABLE`, `UNSTEADY`); else empty.
        amplitude: of the speed error in m/s; 0: motions are infinitely small.
    """

    value: float
    machine: int
    x: float
    v: float
    cut: str = ""
    frequency: float = math.nan
    reason: str = ""
    amplitude: float = 0.0


def survey_points(experiment: Experiment) -> list[tuple[float, float]]:
    """Positions in m and speeds in m/s that are looked at: `SHARES` of the track, at rest and at speed either way.

    The speed is the largest of the reference. Where it takes more force than the machine has, rest is all there is.
    """
    t = np.linspace(0, experiment.duration, INSTANTS)
    fastest = float(np.abs(setpoint(t, experiment.reference).v).max())
    needed = float(resistance(fastest, DisturbanceInputs(), experiment.plant, experiment.plant.track.length / 2))
    steady = fastest > 0 and abs(needed) < experiment.controller.limits.force
    speeds = (-fastest, 0.0, fastest) if steady else (0.0,)
    return [(share * experiment.plant.track.length, v) for share in SHARES for v in speeds]


class MarginSurvey:
    """The margins of some machines at all their points and cuts, for many sets of gains.

    A machine is an experiment, or a scenario whose controller believes in another plant than the one drawn. Sensors are
    taken as perfect and disturbances as absent, as in `linear_loop`.

    Margins are those of infinitely small motions, or the least at some amplitudes of the speed error: the sliding-mode
    law feeds back odd powers of it, whose slope at zero says little of a loop with noisy sensors. There the law is as
    steep as its describing function (Khalil, Nonlinear Systems, 2002, Section 7.2): the smoothing is made such that the
    slope of ``|e2|^(2 - p/q)`` is that one, and that of ``|e2|^(p/q)`` is then within 4 % of its own.

    Attributes:
        machines: what was given.
    """

    def __init__(
        self,
        machines: Sequence[Experiment | Scenario],
        names: Sequence[str] = (),
        threads: int | None = None,
        cuts: Collection[str] = (*LOOP_OPENINGS, BOTH),
        amplitudes: Collection[float] = (0.0,),
    ) -> None:
        """A survey.

        Args:
            machines: of one structure.
            names: keys of the numbers that vary, as in `rollout`.
            threads: default: one a core.
            cuts: where the loops are cut, one at a time; `margins.BOTH` torques change alike.
            amplitudes: of the speed error in m/s; 0: motions are infinitely small. Laws without odd powers of it have
                the same margins at all.
        """
        self.machines, self._threads, self._cuts = tuple(machines), threads, cuts
        calm = [in_calm(given.experiment if isinstance(given, Scenario) else given) for given in machines]
        nominal = [given.nominal if isinstance(given, Scenario) else None for given in machines]
        believed = [plant and still_plant(plant) for plant in nominal]
        self._structure = with_taut_ropes(structure_of(calm[0]))
        self._dt = calm[0].simulation.sample_time
        loop = closed_loop(self._structure)
        pairs = zip(calm, believed, strict=True)
        self._parameters = np.array([loop.vector(parameters_of(experiment, nominal)) for experiment, nominal in pairs])
        self._columns = [loop.parameters.index(name) for name in names]
        self._length = loop.parameters.index("plant.track.length")
        self._powers = [loop.parameters.index(key) for key in ODD_POWERS if key in loop.parameters]
        self._amplitudes = tuple(amplitudes) if self._powers else (0.0,)
        self._points = [np.array(survey_points(experiment)) for experiment in calm]
        self._near: list[Floats] = []

    def worst(self, values: ArrayLike, kinds: Iterable[str] = KINDS) -> list[dict[str, WorstMargin]]:
        """The least margins over all machines, for every set of numbers.

        Args:
            values: (n, names).
            kinds: which margins, of `margins.KINDS` and `resonance.RESONANCE`; the latter alone needs no compiler.

        Returns:
            Kind → its least, for each of the n.

        Raises:
            KeyboardInterrupt: interrupted.
            DualwinchError: no compiler, or no usable cache folder.
        """
        kinds = tuple(kinds)
        return [{kind: min((of[kind] for of in row), key=VALUE) for kind in kinds} for row in self.each(values, kinds)]

    def each(
        self, values: ArrayLike, kinds: Collection[str] = KINDS, machines: Sequence[int] | None = None
    ) -> list[list[dict[str, WorstMargin]]]:
        """`worst` machine by machine.

        Args:
            values: (n, names).
            kinds: which margins.
            machines: indices of the machines to be evaluated; default: all.

        Returns:
            Kind → its least for each of the machines, for each of the n.
        """
        given, of_loops = np.atleast_2d(np.asarray(values, float)), [kind for kind in kinds if kind != RESONANCE]
        chosen = range(len(self.machines)) if machines is None else machines
        pairs = [(row, machine) for row in range(len(given)) for machine in chosen]
        each = [dict[str, WorstMargin]() for _ in pairs]
        if of_loops:
            self._look_near()
            each = _in_chunks(lambda chunk: self._of_pairs(given, chunk, of_loops), pairs, self._threads)
        if len(of_loops) < len(kinds):
            each = [
                found | {RESONANCE: worst} for found, worst in zip(each, self._resonances(given, pairs), strict=True)
            ]
        return [each[first : first + len(chosen)] for first in range(0, len(each), len(chosen))]

    def _resonances(self, values: Floats, pairs: Sequence[tuple[int, int]]) -> list[WorstMargin]:
        """The margins of the drums' resonances, at the worst amplitude, of pairs of a row of values and a machine."""
        rows, machines = np.array(pairs).T
        parameters = self._with(values[rows], machines)
        middle = parameters[:, self._length] / 2
        terms = resonance_terms(self._structure, parameters, middle)
        terms = terms.reshape(len(pairs), -1, terms.shape[-1])
        worst, found = terms[..., -1].argmax(axis=1), []
        for number, (index, x) in enumerate(zip(worst.tolist(), middle.tolist(), strict=True)):
            frequency, *_, gain = terms[number, index].tolist()
            cut, omega = f"tau_{1 + index % 2}", 2 * math.pi * frequency
            found.append(WorstMargin(1 / gain if gain else math.inf, int(machines[number]), x, 0.0, cut, omega))
        return found

    def _with(self, values: Floats, machines: NDArray[np.intp]) -> Floats:
        """Parameters (n, parameters) of machines with values (n, names) of the numbers that vary."""
        parameters = self._parameters[machines]
        parameters[:, self._columns] = values
        return parameters

    def _as_steep_as_at(self, amplitude: float, parameters: Floats) -> Floats:
        """Parameters (n, parameters) of laws that are as steep at zero as they are at an amplitude."""
        if not amplitude:
            return parameters
        p, q, smoothing = parameters[:, self._powers].T
        slope = describing_gain(amplitude, 2 - p / q, smoothing)
        changed = parameters.copy()
        changed[:, self._powers[-1]] = slope ** (1 / (1 - p / q))
        return changed

    def _look_near(self) -> None:
        """Find the operating points with the machines' own gains, near which those with others are looked for."""
        if not self._near:
            first, *others = range(len(self.machines))
            near = self._own_states([first])  # compiles, once, what threads call then
            self._near = near + _in_chunks(self._own_states, others, self._threads)

    def _own_states(self, machines: Sequence[int]) -> list[Floats]:
        """The states of machines with their own gains at all their points."""
        counts = [len(self._points[machine]) for machine in machines]
        x, v = np.concatenate([self._points[machine] for machine in machines]).T
        parameters = np.repeat(self._parameters[list(machines)], counts, axis=0)
        found = loop_operating_points(self._structure, parameters, x, v)
        return np.split(np.where(found.steady[:, None], found.state, np.nan), np.cumsum(counts)[:-1])

    def _of_pairs(
        self, values: Floats, pairs: Sequence[tuple[int, int]], kinds: Sequence[str]
    ) -> list[dict[str, WorstMargin]]:
        """The least margins of pairs of a row of values and a machine, at all amplitudes."""
        points = [self._points[machine] for _, machine in pairs]
        family = np.repeat(np.arange(len(pairs)), [len(each) for each in points])
        rows, machines = np.array(pairs)[family].T
        parameters, found = self._with(values[rows], machines), []
        near = np.concatenate([self._near[machine] for _, machine in pairs])
        for amplitude in self._amplitudes:
            steep = self._as_steep_as_at(amplitude, parameters)
            worst, states = self._at_amplitude(amplitude, steep, near, points, family, pairs, kinds)
            near = np.where(np.isfinite(states), states, near)  # the steady motion is hardly another one
            found.append(worst)
        return [
            {kind: min((of[kind] for of in each), key=VALUE) for kind in kinds} for each in zip(*found, strict=True)
        ]

    def _at_amplitude(
        self,
        amplitude: float,
        parameters: Floats,
        near: Floats,
        points: Sequence[Floats],
        family: NDArray[np.intp],
        pairs: Sequence[tuple[int, int]],
        kinds: Sequence[str],
    ) -> tuple[list[dict[str, WorstMargin]], Floats]:
        """The least margins of pairs at an amplitude, and the states at their points; NaN without a steady motion."""
        x, v = np.concatenate(points).T
        found = loop_operating_points(self._structure, parameters, x, v, near)
        steady, stable = np.flatnonzero(found.steady), found.steady.copy()
        A, B, C, D = (matrix[steady] for matrix in found.opened)
        loops = complementary(A, B, C, D, self._dt)
        stable[steady] = loops.stable
        least = least_margins(loops, family[steady], kinds, len(pairs), self._cuts)
        worst_of = []
        for number, (_, machine) in enumerate(pairs):
            failed = np.flatnonzero((family == number) & ~stable)
            if len(failed):
                index = int(failed[0])
                reason = UNSTABLE if found.steady[index] else UNSTEADY
                none = WorstMargin(0.0, machine, float(x[index]), float(v[index]), reason=reason, amplitude=amplitude)
                worst_of.append(dict.fromkeys(kinds, none))
                continue
            words = {}
            for kind, worst in least[number].items():
                index = int(steady[worst.loop]) if worst.loop >= 0 else int(np.flatnonzero(family == number)[0])
                point = float(x[index]), float(v[index])
                words[kind] = WorstMargin(worst.value, machine, *point, worst.cut, worst.frequency, "", amplitude)
            worst_of.append(words)
        return worst_of, np.where(found.steady[:, None], found.state, np.nan)


def _in_chunks(
    work: Callable[[Sequence[Item]], list[Outcome]], items: Sequence[Item], threads: int | None
) -> list[Outcome]:
    """What some work makes of items, `TOGETHER` of them at a time, on threads; linear algebra has none of its own then.

    Raises:
        KeyboardInterrupt: interrupted.
    """
    chunks = [items[first : first + TOGETHER] for first in range(0, len(items), TOGETHER)]
    with threadpool_limits(1, user_api="blas"):
        return [each for chunk in map_all(work, chunks, threads) for each in chunk]
