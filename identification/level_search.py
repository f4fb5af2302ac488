"""Noise of sensors and scatter of what nobody recorded, by how likely they make the logs."""

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from dualwinch.codegen.drivers.prediction import FilterPass
from dualwinch.identification.levels import Levels
from dualwinch.identification.noise import FINEST
from dualwinch.identification.sections import Filters, all_completed
from dualwinch.identification.sensed import READINGS
from dualwinch.identification.unrecorded import described
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

SCATTERED = (("force",), ("torque_1", "torque_2"))
"""The unrecorded whose scatter nobody describes; each group has one."""

RANGE = 1e6
"""How far that scatter may lie above its start, as a factor."""

APART = 30.0
"""Distance of the points at which scatter is looked for at first, and how far from there after that, as a factor."""

PART = 10.0
"""Time in s of each section that tells it."""

LOST = 1e12
"""What counts for minus the logarithm of the likelihood where a filter goes astray."""

LEAST = np.array([FINEST[name] for name in READINGS]) ** 2
"""Least variance of each sensor's noise."""

STEPS, ROUGHLY = 8, 0.1
"""Times that noise is corrected by a part of the sections, at most, and the change, as a share, that ends it."""


class LevelSearch:
    """Finds noise and scatter for a machine that is known well enough."""

    def __init__(self, filters: Filters, believed: Experiment, outlier: float) -> None:
        """A search that begins at what is believed; `outlier` as of `identification.fit.OUTLIER`."""
        self._filters, self._outlier = filters, outlier
        self._lowest = {name: each.deviation for name, each in described(believed).items()}
        self._samples = round(PART / believed.simulation.sample_time)

    def wide_enough(self, experiment: Experiment, levels: Levels) -> Levels:
        """Levels with the least scatter with which no filter goes astray; as they were where there is none.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        wider = sorted(self._everywhere(levels), key=lambda each: each.scatter["torque_1"].deviation)
        return next((each for each in wider if all_completed(self._weighed(experiment, each, None))), levels)

    def scattered(
        self, experiment: Experiment, levels: Levels, *, anywhere: bool = False, roughly: bool = False
    ) -> Levels:
        """Levels with the scatter of the undescribed under which the logs are most likely.

        Args:
            experiment: the machine.
            levels: as they were.
            anywhere: whether it is looked for in all its range, or near where it was.
            roughly: whether the beginning of each section is enough to go by.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        samples = self._samples if roughly else None
        if anywhere:
            levels = min(self._everywhere(levels), key=lambda each: self._unlikely(experiment, each, samples))
        for names in SCATTERED:
            levels = self._most_likely(experiment, levels, names, samples)
        return levels

    def _everywhere(self, levels: Levels) -> list[Levels]:
        """Levels with the scatter of every group here and there in its range, each with each."""
        factors = APART ** np.arange(np.ceil(np.log(RANGE) / np.log(APART)))
        return [
            reduce(lambda found, pair: self._scattered(found, *pair), zip(SCATTERED, chosen, strict=True), levels)
            for chosen in product(factors.tolist(), repeat=len(SCATTERED))
        ]

    def _most_likely(self, experiment: Experiment, levels: Levels, names: Sequence[str], samples: int | None) -> Levels:
        """Levels with the scatter of one group that is best, near where it was."""
        there, reach = np.log(levels.scatter[names[0]].deviation / self._lowest[names[0]]), np.log(APART)
        best = minimize_scalar(
            lambda factor: self._unlikely(experiment, self._scattered(levels, names, np.exp(factor)), samples),
            bounds=(max(there - reach, 0.0), min(there + reach, np.log(RANGE))),
            method="bounded",
            options={"xatol": 0.3, "maxiter": 5},
        )
        return self._scattered(levels, names, np.exp(best.x))

    def _scattered(self, levels: Levels, names: Sequence[str], factor: float) -> Levels:
        """Levels with a group's scatter so many times its lowest."""
        wider = float(factor) * self._lowest[names[0]]
        return levels.scattered({name: replace(levels.scatter[name], deviation=wider) for name in names})

    def _unlikely(self, experiment: Experiment, levels: Levels, samples: int | None) -> float:
        weights = self._weighed(experiment, levels, samples)
        return sum(each.negative_log_likelihood for each in weights) if all_completed(weights) else LOST

    def quieted(self, experiment: Experiment, levels: Levels, weights: Sequence[FilterPass]) -> Levels:
        """Levels with the noise that the sensors turn out to have.

        Args:
            experiment: the machine.
            levels: as they were.
            weights: of the sections, with these.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        levels, changed = _corrected(levels, weights)
        for _ in range(STEPS):
            if changed < ROUGHLY:
                break
            levels, changed = _corrected(levels, self._weighed(experiment, levels, self._samples))
        return levels

    def _weighed(self, experiment: Experiment, levels: Levels, samples: int | None) -> list[FilterPass]:
        return self._filters.weigh(experiment, levels, outlier=self._outlier, gains=False, samples=samples)


def _corrected(levels: Levels, weights: Sequence[FilterPass]) -> tuple[Levels, float]:
    """A step of expectation and maximisation; and how far it went, as a share."""
    counts = np.sum([each.counts for each in weights], axis=0)
    squares = np.sum([np.nan_to_num(each.noise * each.counts) for each in weights], axis=0)
    noise = np.where(counts > 0, squares / np.maximum(counts, 1), levels.noise)
    noise = np.maximum(np.clip(noise, levels.noise / 4, levels.noise * 4), LEAST)
    return replace(levels, noise=noise), float(np.max(np.abs(np.log(noise / levels.noise)), initial=0.0))
