"""Numbers of a machine from its logs: those under which the logs are likeliest.

A prediction-error method (Ljung, System Identification, 2nd ed., Section 7; Kristensen, Madsen and Jørgensen,
Automatica 40 (2004) 225, for filters with unrecorded disturbances): an extended Kalman filter weighs the readings, and
with its gains as they are the surprises, whitened, are a least-squares problem with exact slopes. Solved, it is weighed
anew, until values are near; steps by the likelihood itself lead on to where it is greatest. Sensors' noise follows from
what the filter leaves of each reading, and the scatter of what nobody recorded from the likelihood of all.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.drivers.prediction import FilterPass, compile_predictor
from dualwinch.identification.coordinates import Coordinates
from dualwinch.identification.given_gains import GivenGains
from dualwinch.identification.level_search import LevelSearch
from dualwinch.identification.levels import Levels, first_levels
from dualwinch.identification.likelihood import MUCH, Likelihood
from dualwinch.identification.predictor import machine_of, parameter_names, predicted
from dualwinch.identification.sections import Filters, Section, all_completed
from dualwinch.identification.unknowns import Unknown
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.structure import parameters_of, zeros_of

Floats = NDArray[np.float64]

ROUNDS, STEPS = 40, 12
"""Times that least squares are solved with new gains, and steps by the likelihood after that, at most."""

ROUGH, LIKELY = 3, 2.0
"""Rounds at first in which nothing but the machine is thought to be at fault, and the standard deviations from what is
known beforehand that no value leaves in them."""

ROUGHLY = 1e-6
"""Change of the sum of squares, as a share, that ends least squares with the same gains."""

CLOSER = 6
"""Times that a move is halved where filters go astray at its end, at most."""

NEARER, NEAR = 3.0, 0.5
"""Moves, over the standard deviation, from which on values tell how noisy sensors are, and from which on steps by the
likelihood are worth their time."""

SCATTERING = 2
"""Steps before which scatter is looked for once more."""

STILL = 0.1
"""Fall of minus twice the logarithm of the likelihood that counts as none; a standard deviation costs 1."""

OUTLIER = 4.0
"""Surprise, over its standard deviation, from which on a reading counts less."""


@dataclass(frozen=True)
class Fit:
    """What fits best.

    Attributes:
        values: (p,) of the unknowns.
        information: (p, p) of the logs alone, without what was known beforehand.
        levels: noise and scatter.
        experiment: with these values.
        unlikely: minus twice the logarithm of the likelihood, but for a constant.
        passes: how many times the logs were gone through.
        settled: whether the last step made nothing likelier any more.
    """

    values: Floats
    information: Floats
    levels: Levels
    experiment: Experiment
    unlikely: float
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
        columns = [parameter_names(structure).index(key) for key in keys]
        self.gains = GivenGains(self.filters, self.with_values, columns)
        self._last: tuple[Floats, Levels | None, list[FilterPass]] = np.zeros(0), None, []
        self._levels = LevelSearch(self.filters, experiment, outlier)

    @property
    def passes(self) -> int:
        """How many times the logs were gone through."""
        return self.filters.passes

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
        return first_levels(readings, self._experiment)

    def information(self, values: Floats) -> Floats | None:
        """(p, p) of the logs where the unknowns have some values and noise is as believed; None: filters go astray."""
        levels = self.first_levels()
        weights = self._weighed(values, levels)
        if not all_completed(weights):
            return None
        normal = self.gains.normal(values, levels, weights)
        return normal[:-1, :-1] if np.isfinite(normal).all() else None

    def run(
        self, start: Floats, progress: Callable[[float], None] = lambda _: None, known: Levels | None = None
    ) -> Fit:
        """From a start to where nothing moves any more.

        Args:
            start: (p,) where the search begins.
            progress: called now and then with the share that is done.
            known: noise and scatter, where they need not be found out.

        Raises:
            ConfigurationError: the filter goes astray: the log is of another machine; or a number of which
                nothing is known has no effect at all.
            KeyboardInterrupt: interrupted.
        """
        levels = known or self.first_levels()
        if known is None and not all_completed(self._weighed(start, levels)):
            levels = self._levels.wide_enough(self.with_values(start), levels)
        if not all_completed(self._weighed(start, levels)):
            raise self._astray()
        values, levels = self._nearby(start, levels, known is not None, progress)
        likelihood = self.likelihood(Coordinates(self.unknowns))
        at, step, settled = likelihood.coordinates.of(values), None, False
        for number in range(STEPS):
            progress((1 + number / (number + 2)) / 2)  # a few steps are usual
            experiment = self.with_values(likelihood.coordinates.values(at))
            if known is None:
                if number < SCATTERING:
                    levels = self._levels.scattered(experiment, levels)
                weights = self.filters.weigh(experiment, levels, outlier=self._outlier, gains=False)
                levels = self._levels.quieted(experiment, levels, weights)
            found = likelihood.step(at, levels, step)
            if found is None:
                break
            step, at = found, found.at
            if step.better < STILL:
                settled = step.expected < MUCH
                break
        if step is None:
            raise self._astray()
        values = turned_back(likelihood.coordinates.values(at), self.unknowns)
        return Fit(
            values=values,
            information=step.information,
            levels=levels,
            experiment=self.with_values(values),
            unlikely=step.unlikely,
            passes=self.passes,
            settled=settled,
        )

    def _astray(self) -> ConfigurationError:
        name = self.filters.sections[0].name
        return ConfigurationError(f"{name}: no machine near the one that is believed does what this log says")

    def likelihood(self, coordinates: Coordinates) -> Likelihood:
        """The likelihood of the logs in some coordinates of the unknowns."""
        return Likelihood(self.filters, self.gains, self.with_values, self._weighed, coordinates, self._outlier)

    def _nearby(
        self, values: Floats, levels: Levels, known: bool, progress: Callable[[float], None]
    ) -> tuple[Floats, Levels]:
        """Values and levels near the best, by least squares with new gains every time."""
        likely, anywhere = Coordinates(self.unknowns, LIKELY), Coordinates(self.unknowns)
        weights, last, before = self._weighed(values, levels), np.zeros(len(values)), np.inf
        for number in range(ROUNDS):
            progress(number / (number + 6) / 2)  # some ten rounds are usual
            within = likely if number < ROUGH else anywhere
            found, told = self.gains.solved(values, levels, weights, within, ROUGHLY)
            if number == 0:
                self._check_acting(told)
            variances = np.diag(covariance_of(told, self.unknowns))
            if not (variances > 0).all():  # slopes that have grown beyond all measure, as where a rope slackens
                break
            deviation = np.sqrt(variances)
            move = (turned_back(found, self.unknowns) - values) / deviation
            moved = float(np.max(np.abs(move), initial=0.0))
            there = values + deviation * damped(move, last)
            if not known and number >= ROUGH:
                experiment, first = self.with_values(there), number == ROUGH
                levels = self._levels.scattered(experiment, levels, anywhere=first, roughly=True)
            there, weights = self._within_reach(values, there, levels)
            if not all_completed(weights):
                break
            values, last = there, move
            if not known and moved < NEARER:
                levels = self._levels.quieted(self.with_values(values), levels, weights)
            if moved < NEAR or (before < NEARER and moved > before / 2):
                break
            before = moved
        return values, levels

    def _within_reach(self, here: Floats, there: Floats, levels: Levels) -> tuple[Floats, list[FilterPass]]:
        """Values on the way from here to there, as far as filters do not go astray, and the gains for them."""
        for _ in range(CLOSER):
            weights = self._weighed(there, levels)
            if all_completed(weights):
                break
            there = (here + there) / 2
        return there, self._weighed(there, levels)

    def _check_acting(self, information: Floats) -> None:
        for unknown, told in zip(self.unknowns, np.diag(information).tolist(), strict=True):
            if told == 0 and not unknown.prior:
                raise ConfigurationError(
                    f"--fit {unknown.key}: nothing that these logs hold depends on it: other values switch it off, or "
                    "its sensor was not recorded"
                )

    def _weighed(self, values: Floats, levels: Levels) -> list[FilterPass]:
        """Gains at some values; those of the last call where it was for the same, else in the place of them."""
        vector = self.filters.vector(self.with_values(values), levels)
        last_vector, last_levels, weights = self._last
        if last_levels is not levels or not np.array_equal(vector, last_vector):
            weights = self.filters.weigh(self.with_values(values), levels, outlier=self._outlier, into=weights)
            self._last = vector, levels, weights
        return weights


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
