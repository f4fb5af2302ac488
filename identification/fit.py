"""Numbers of a machine from its logs: least squares of what filters did not expect.

A prediction-error method (Ljung, System Identification, 2nd ed., Section 7; Kristensen, Madsen and Jørgensen,
Automatica 40 (2004) 225, for filters with unrecorded disturbances): an extended Kalman filter weighs the readings, and
with its gains as they are the surprises, whitened, are a least-squares problem with exact slopes. Solved, it is weighed
anew, until neither moves. Sensors' noise follows from what the filter leaves of each reading, and the scatter of what
nobody recorded from the likelihood of all.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize_scalar

from dualwinch.codegen.drivers.prediction import Weights, compile_predictor
from dualwinch.identification.noise import first_noise
from dualwinch.identification.predictor import machine_of, parameter_names, predicted
from dualwinch.identification.sections import Filters, Levels, Section, all_completed
from dualwinch.identification.unknowns import Prior, Unknown
from dualwinch.identification.unrecorded import described
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.structure import parameters_of, zeros_of

Floats = NDArray[np.float64]

ROUNDS = 12
"""Times that readings are weighed, at most."""

SOLVING = 5
"""Times that slopes are looked at with the same gains, at most."""

STILL = 0.02
"""A move, over the standard deviation, that counts as none."""

NEAR = 0.5
"""A move, over the standard deviation, from which on values are good enough to tell what else acts on a machine."""

OUTLIER = 4.0
"""Surprise, over its standard deviation, from which on a reading counts less."""

LOST = 1e12
"""Sum of squares of numbers with which a filter goes astray."""

SCATTERED = (("force",), ("torque_1", "torque_2"))
"""The unrecorded whose scatter nobody describes; each group has one."""

RANGE = 1e6
"""How far that scatter may lie above its start, as a factor."""

PART = 10.0
"""Time in s of each section that tells it."""


@dataclass(frozen=True)
class Fit:
    """What fits best.

    Attributes:
        values: (p,) of the unknowns.
        information: (p, p) of the logs alone, without what was known beforehand.
        levels: noise and scatter.
        weights: of the sections, with the gains of the last round.
        experiment: with these values.
        squares: of what is left, whitened, and of departures from what was known beforehand.
        passes: how many times the logs were gone through.
        settled: whether the last round moved nothing any more.
    """

    values: Floats
    information: Floats
    levels: Levels
    weights: tuple[Weights, ...]
    experiment: Experiment
    squares: float
    passes: int
    settled: bool


class Fitting:
    """A fit under way."""

    def __init__(
        self,
        sections: Sequence[Section],
        experiment: Experiment,
        unknowns: Sequence[Unknown],
        *,
        outlier: float = OUTLIER,
        threads: int | None = None,
    ) -> None:
        """A fit of sections; compiles what it takes."""
        self.unknowns, self._experiment, self._outlier = tuple(unknowns), experiment, outlier
        keys, structure = tuple(unknown.key for unknown in unknowns), machine_of(experiment)
        zeros = zeros_of(structure, parameters_of(experiment), varying=keys)
        self._predictor = compile_predictor(predicted(structure, keys, zeros))
        self.structure, self._threads = structure, threads
        self.filters = Filters(self._predictor, structure, sections, threads)
        self.columns = [parameter_names(structure).index(key) for key in keys]
        self._scale = np.array([unknown.scale for unknown in unknowns])
        self._bounds = [np.array([getattr(unknown, end) for unknown in unknowns]) for end in ("lower", "upper")]
        self.passes = 0

    def others(self, sections: Sequence[Section]) -> Filters:
        """Filters of other sections."""
        return Filters(self._predictor, self.structure, sections, self._threads)

    def with_values(self, values: Floats) -> Experiment:
        """The experiment with other values of the unknowns."""
        keys = (unknown.key for unknown in self.unknowns)
        return with_leaves(self._experiment, dict(zip(keys, values.tolist(), strict=True)))

    def first_levels(self) -> Levels:
        """Noise and scatter to begin with."""
        readings = np.concatenate([section.readings for section in self.filters.sections])
        return Levels(first_noise(readings, self._experiment.sensors), described(self._experiment))

    def information(self, values: Floats) -> Floats | None:
        """(p, p) of the logs where the unknowns have some values and noise is as believed; None: filters go astray."""
        levels = self.first_levels()
        weights = self._weighed(values, levels)
        if not all_completed(weights):
            return None
        experiment = self.with_values(values)
        runs = self.filters.predict(self.filters.vector(experiment, levels), experiment, levels, weights)
        return np.sum([run.normal for run in runs], axis=0)[:-1, :-1] if all_completed(runs) else None

    def run(
        self, start: Floats, progress: Callable[[float], None] = lambda _: None, known: Levels | None = None
    ) -> Fit:
        """From a start to where nothing moves any more.

        Args:
            start: (p,) where the search begins.
            progress: called now and then with the share that is done.
            known: noise and scatter, where they need not be found out.

        Raises:
            ConfigurationError: the filter goes astray at the start: the log is of another machine; or a number of which
                nothing is known has no effect at all.
            KeyboardInterrupt: interrupted.
        """
        values, levels, settled, calm = start, known or self.first_levels(), False, known is not None
        weights = self._weighed(values, levels)
        if not all_completed(weights):
            raise ConfigurationError(
                f"{self.filters.sections[0].name}: no machine near the one that is believed does what this log says"
            )
        information, squares, last = np.zeros((len(start), len(start))), np.inf, np.zeros(len(start))
        for number in range(ROUNDS):
            progress(number / ROUNDS)
            found, information, squares = self.solved(values, levels, weights)
            if number == 0:
                self._check_acting(information)
            deviation = self._deviations(information)
            move = (turned_back(found, self.unknowns) - values) / deviation
            moved = float(np.max(np.abs(move), initial=0.0))
            values = values + deviation * damped(move, last)
            last = move
            if known is None and (number in {0, 2} or (moved < NEAR and not calm)):
                levels, calm = self._scattered(values, levels), moved < NEAR
            weights = self._weighed(values, levels)
            quieter = known or self._levelled(levels, weights)
            changed = float(np.max(np.abs(np.log(quieter.noise / levels.noise)), initial=0.0))
            levels = quieter
            if moved < STILL and changed < STILL and calm:
                settled = True
                break
        return Fit(values, information, levels, tuple(weights), self.with_values(values), squares, self.passes, settled)

    def _check_acting(self, information: Floats) -> None:
        for unknown, told in zip(self.unknowns, np.diag(information).tolist(), strict=True):
            if told == 0 and not unknown.prior:
                raise ConfigurationError(
                    f"--fit {unknown.key}: nothing that these logs hold depends on it: other values switch it off, or "
                    "its sensor was not recorded"
                )

    def _weighed(self, values: Floats, levels: Levels) -> list[Weights]:
        self.passes += 1
        return self.filters.weigh(self.with_values(values), levels, outlier=self._outlier)

    def solved(
        self, values: Floats, levels: Levels, weights: Sequence[Weights], pinned: Sequence[tuple[int, Prior]] = ()
    ) -> tuple[Floats, Floats, float]:
        """Values that fit best with given gains, the information of the logs there, and the sum of squares.

        Args:
            values: (p,) where the search begins.
            levels: noise and scatter.
            weights: gains of the sections.
            pinned: indices of unknowns and what further is known of them; it does not count in the sum.
        """
        experiment, p = self.with_values(values), len(values)
        base = self.filters.vector(experiment, levels)
        scale, last = self._scale, dict[bytes, tuple[Floats, Floats, Floats]]()
        known = [(index, unknown.prior) for index, unknown in enumerate(self.unknowns) if unknown.prior]
        known += pinned

        def squares(scaled: Floats) -> tuple[Floats, Floats, Floats]:
            key = scaled.tobytes()
            if key not in last:
                vector = base.copy()
                vector[self.columns] = scaled * scale
                self.passes += 1
                runs = self.filters.predict(vector, experiment, levels, weights)
                normal = np.sum([run.normal for run in runs], axis=0)
                if not all_completed(runs) or not np.isfinite(normal).all():
                    last[key] = np.full(p + 1 + len(known), np.sqrt(LOST)), np.zeros((p + 1 + len(known), p)), normal
                else:
                    last[key] = self._rows(normal, scaled, known)
            return last[key]

        solver: Any = least_squares  # what is known of it knows no function as Jacobian
        solved = solver(
            lambda scaled: squares(scaled)[0],
            np.clip(values / scale, *(bound / scale for bound in self._bounds)),
            lambda scaled: squares(scaled)[1],
            bounds=[bound / scale for bound in self._bounds],
            x_scale="jac",
            ftol=1e-8,
            xtol=1e-7,
            max_nfev=SOLVING,
        )
        residual, _, normal = squares(solved.x)
        counted = residual[: len(residual) - len(pinned)]
        return solved.x * scale, normal[:-1, :-1], float(counted @ counted)

    def _rows(self, normal: Floats, scaled: Floats, known: Sequence) -> tuple[Floats, Floats, Floats]:
        """A problem of p + 1 rows that has the same squares and slopes, and a row for each prior."""
        by = np.append(self._scale, 1.0)
        size, ways = np.linalg.eigh(normal * np.outer(by, by))
        root = np.sqrt(np.maximum(size, 0.0))[:, np.newaxis] * ways.T
        residual, slopes = [root[:, -1]], [root[:, :-1]]
        for index, prior in known:
            slope = np.zeros((1, len(scaled)))
            slope[0, index] = self._scale[index] / prior.deviation
            residual.append(np.array([(scaled[index] * self._scale[index] - prior.mean) / prior.deviation]))
            slopes.append(slope)
        return np.concatenate(residual), np.concatenate(slopes), normal

    def _deviations(self, information: Floats) -> Floats:
        """Standard deviations, no larger than the scale of what the logs hardly tell."""
        return np.sqrt(np.diag(covariance_of(information, self.unknowns)))

    def _scattered(self, values: Floats, levels: Levels) -> Levels:
        """Levels with the scatter of the undescribed under which the logs are most likely."""
        samples = round(PART / self._experiment.simulation.sample_time)
        for names in SCATTERED:
            levels = self._most_likely(values, levels, names, samples)
        return levels

    def _most_likely(self, values: Floats, levels: Levels, names: Sequence[str], samples: int) -> Levels:
        lowest, experiment = described(self._experiment)[names[0]].deviation, self.with_values(values)

        def scattered(factor: float) -> Levels:
            wider = lowest * float(np.exp(factor))
            return levels.scattered({name: replace(levels.scatter[name], deviation=wider) for name in names})

        def unlikelihood(factor: float) -> float:
            self.passes += 1
            weights = self.filters.weigh(
                experiment, scattered(factor), outlier=self._outlier, gains=False, samples=samples
            )
            return sum(each.unlikelihood for each in weights) if all_completed(weights) else np.inf

        best = minimize_scalar(
            unlikelihood, bounds=(0.0, np.log(RANGE)), method="bounded", options={"xatol": 0.3, "maxiter": 10}
        )
        return scattered(best.x)

    def _levelled(self, levels: Levels, weights: Sequence[Weights]) -> Levels:
        """Levels with the noise that the sensors turn out to have."""
        counts = np.sum([each.counts for each in weights], axis=0)
        squares = np.sum([np.nan_to_num(each.noise * each.counts) for each in weights], axis=0)
        noise = np.where(counts > 0, squares / np.maximum(counts, 1), levels.noise)
        return replace(levels, noise=np.clip(noise, levels.noise / 4, levels.noise * 4))


def damped(move: Floats, last: Floats) -> Floats:
    """A move, shorter where it takes back what the last one did.

    New gains may turn a fit from one side of where it would rest to the other. Were each move r times the one before,
    moves would add up to 1 / (1 - r) of this one.
    """
    ratio = float(move @ last) / max(float(last @ last), np.finfo(float).tiny)
    return move / (1 - np.clip(ratio, -1.0, 0.0))


def turned_back(values: Floats, unknowns: Sequence[Unknown]) -> Floats:
    """Values with angles within half a turn of where the search began: whole turns more or less are the same."""
    starts, angles = np.array([each.start for each in unknowns]), np.array([each.cyclic for each in unknowns])
    return np.where(angles, starts + np.remainder(values - starts + np.pi, 2 * np.pi) - np.pi, values)


def covariance_of(information: Floats, unknowns: Sequence[Unknown]) -> Floats:
    """Covariance of the unknowns, with what is known of them beforehand.

    Where logs tell nothing and nothing is known, a number is taken to be within its scale.
    """
    beforehand = np.array([1 / (each.prior.deviation if each.prior else each.scale) ** 2 for each in unknowns])
    by = np.array([each.scale for each in unknowns])
    scaled = (information + np.diag(beforehand)) * np.outer(by, by)
    return np.asarray(np.linalg.inv(scaled) * np.outer(by, by), np.float64)
