"""How likely logs are, and steps to where they are likeliest.

Least squares with gains as they are lead near; but gains themselves tell something of a machine, and the variance of
what a filter did not expect does. Differences of the likelihood itself know all of it. They are taken along directions
that are of one standard deviation each and hardly correlated, so that each tells its own slope and curvature; those
along which least squares turn out to say all are left alone from then on.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.codegen.drivers.prediction import FilterPass
from dualwinch.identification.coordinates import Coordinates
from dualwinch.identification.given_gains import GivenGains
from dualwinch.identification.levels import Levels
from dualwinch.identification.sections import Filters, all_completed
from dualwinch.simulation.experiment import Experiment

Floats = NDArray[np.float64]

FLATTEST = 0.2
"""Least curvature along a direction, over what the slopes of readings say."""

LOOKED, LEAST = 1.0, 0.01
"""How far the likelihood is looked at along a direction, and how far must fit into the range of all coordinates."""

NOTHING = 0.1
"""What counts as nothing of a slope or curvature along a direction of one standard deviation."""

SMALL = 0.05
"""Gain in twice the logarithm of the likelihood that need not be seen to be believed."""

MUCH = 4.0
"""Gain in twice the logarithm of the likelihood that is not let go: two standard deviations."""

HALVED, INSISTED = 2, 8
"""Times that a step is halved where it leads to what is less likely, at most; and where much is to be gained."""


@dataclass(frozen=True)
class Step:
    """A step.

    Attributes:
        at: (p,) coordinates where it leads.
        unlikely: minus twice the logarithm of the likelihood there, but for a constant.
        better: by how much that has fallen.
        expected: by how much it should have.
        beyond: (p,) slopes of half of it along the directions, less what least squares say of them.
        curvature: (p,) likewise second derivatives; 1 is what least squares say.
        information: (p, p) where it begins, of the logs alone, in units of the unknowns, with these curvatures. One
            above 1 is taken for 1: mostly that is a direction that turns, as an angle's does, and is straight for a
            part of the deviation only.
    """

    at: Floats
    unlikely: float
    better: float
    expected: float
    beyond: Floats
    curvature: Floats
    information: Floats


class Likelihood:
    """The likelihood of logs, and of what was known beforehand, at coordinates of the unknowns."""

    def __init__(
        self,
        filters: Filters,
        gains: GivenGains,
        machine: Callable[[Floats], Experiment],
        weighed: Callable[[Floats, Levels], list[FilterPass]],
        coordinates: Coordinates,
        outlier: float,
    ) -> None:
        """A likelihood of the logs that `filters` go through.

        Args:
            filters: they go through the logs.
            gains: least squares of the same logs.
            machine: gives the experiment with some values of the unknowns.
            weighed: gives the filters' gains for some values.
            coordinates: of the unknowns.
            outlier: as of `codegen.drivers.prediction.Predictor.filter`.
        """
        self._filters, self._gains, self._machine, self._outlier = filters, gains, machine, outlier
        self._weighed = weighed
        self.coordinates = coordinates
        self._rows, self._centre = coordinates.beforehand()
        self._beforehand = self._rows.T @ self._rows + np.diag(1.0 - coordinates.known)

    def unlikely(self, points: Sequence[Floats], levels: Levels) -> Floats:
        """Minus twice the logarithm, but for a constant, at each of some coordinates; infinite where filters go astray.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        ends = self.coordinates.bounds
        machines = [self._machine(self.coordinates.values(np.clip(point, *ends))) for point in points]
        logs = self._filters.unlikely(machines, levels, outlier=self._outlier) if machines else np.zeros(0)
        return logs + np.array([self._departed(point) for point in points])

    def _departed(self, at: Floats) -> float:
        """Squares of the distance from what was known beforehand."""
        return float(np.sum((self._rows @ (at - self._centre)) ** 2))

    def step(self, at: Floats, levels: Levels, before: Step | None = None, held: int | None = None) -> Step | None:
        """A step of Newton's method towards what is likelier; None: filters go astray where it would begin.

        Args:
            at: (p,) coordinates.
            levels: noise and scatter.
            before: the last step; where it found nothing beyond least squares, nothing is looked for.
            held: a coordinate that stays as it is.

        Raises:
            KeyboardInterrupt: interrupted.
        """
        values, slopes = self.coordinates.values(at), self.coordinates.slopes(at)
        weights = self._weighed(values, levels)
        normal = self._gains.normal(values, levels, weights)
        if not all_completed(weights) or not np.isfinite(normal).all():
            return None
        plain = slopes.T @ normal[:-1, -1] + self._rows.T @ (self._rows @ (at - self._centre))
        known = slopes.T @ normal[:-1, :-1] @ slopes + self._beforehand
        moving = self._moving(at, held)
        try:
            root = np.linalg.cholesky(known[moving])
        except np.linalg.LinAlgError:  # slopes that have grown beyond all measure, as where a rope slackens
            return None
        ways = np.zeros_like(known)
        ways[moving] = np.linalg.inv(root)
        reach = np.array([min(self._room(at, way), self._room(at, -way), LOOKED) for way in ways])
        here = 2 * sum(each.negative_log_likelihood for each in weights) + self._departed(at)
        beyond, curvature = self._looked(at, here, ways, reach, ways @ plain, levels, before)
        way = np.where(reach > LEAST, -(ways @ plain + beyond) / curvature, 0.0) @ ways
        way *= min(self._room(at, way), 1.0)
        gain = float(np.where(reach > LEAST, (ways @ plain + beyond) ** 2 / curvature, 0.0).sum())
        way, there = self._checked(at, way, here, gain, levels)
        back = np.linalg.inv(slopes)
        known[moving] = (root * np.minimum(curvature[moving[0][:, 0]], 1.0)) @ root.T
        information = back.T @ _not_below_zero(known - self._beforehand) @ back
        at = np.clip(at + way, *self.coordinates.bounds)
        return Step(at, there, here - there, gain, beyond, curvature, information)

    def _checked(self, at: Floats, way: Floats, here: float, gain: float, levels: Levels) -> tuple[Floats, float]:
        """A way, shorter where it leads to what is less likely, and how unlikely logs are at its end.

        A gain that is next to nothing is taken for what it is expected to be.
        """
        if gain < SMALL:
            return way, here - gain
        for _ in range(INSISTED if gain > MUCH else HALVED):
            there = float(self.unlikely([at + way], levels)[0])
            if there <= here:
                return way, there
            way = way / 2
        return np.zeros_like(at), here

    def _looked(
        self, at: Floats, here: float, ways: Floats, reach: Floats, plain: Floats, levels: Levels, before: Step | None
    ) -> tuple[Floats, Floats]:
        """Along each way the slope beyond the plain one, and the curvature."""
        last_beyond, last_curvature = np.zeros(len(at)), np.ones(len(at))
        wanted = (reach > LEAST) & ways.any(axis=1)
        if before is not None:
            last_beyond, last_curvature = before.beyond, before.curvature
            wanted &= (np.abs(last_beyond) > NOTHING) | (np.abs(last_curvature - 1) > NOTHING)
        ahead, behind = np.full(len(at), np.nan), np.full(len(at), np.nan)
        ahead[wanted] = _finite(self.unlikely([*(at + (reach[:, np.newaxis] * ways)[wanted])], levels))
        beyond = (ahead - here) / (2 * reach) - reach / 2 - plain
        wanted &= ~(np.abs(beyond) < NOTHING)
        behind[wanted] = _finite(self.unlikely([*(at - (reach[:, np.newaxis] * ways)[wanted])], levels))
        slope, curvature = (ahead - behind) / (4 * reach), (ahead + behind - 2 * here) / (2 * reach**2)
        beyond = np.where(np.isfinite(beyond), beyond, last_beyond)
        beyond = np.where(np.isfinite(slope), slope - plain, beyond)
        curvature = np.where(np.isfinite(slope), np.maximum(curvature, FLATTEST), last_curvature)
        return beyond, curvature

    def _room(self, at: Floats, way: Floats) -> float:
        """How often a way can be gone before a coordinate leaves its range."""
        lower, upper = self.coordinates.bounds
        ends = np.where(way > 0, upper, lower)
        return float(np.min(np.divide(ends - at, way, out=np.full(len(at), np.inf), where=way != 0)))

    def _moving(self, at: Floats, held: int | None) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns of all coordinates but those that are held, or at an end of their range."""
        lower, upper = self.coordinates.bounds
        rows = np.flatnonzero((at > lower) & (at < upper) & (np.arange(len(at)) != held))
        return rows[:, np.newaxis], rows[np.newaxis, :]


def _finite(values: ArrayLike) -> Floats:
    """Values, NaN in the place of what is infinite."""
    found = np.array(values, float)
    return np.where(np.isinf(found), np.nan, found)


def _not_below_zero(information: Floats) -> Floats:
    """Information of which there is nothing where it would be less."""
    size, ways = np.linalg.eigh(information)
    return (ways * np.maximum(size, 0.0)) @ ways.T
