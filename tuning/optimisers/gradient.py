"""Trust-region search with exact gradients: linear or quadratic steps in logarithms, accepted by a merit function.

1. At the best point so far, linearise the logarithms of objective and constraints over the gains' (`local_model`).
2. Minimise the linear model within the constraints and a box around the point: sequential linear programming with an
   exact penalty (Fletcher and Sainz de la Maza, Math. Programming 43, 1989). The penalty permits temporary violations
   where the objective gains far more.
3. If the step fails, try a Gauss–Newton step in the same box, then both in ever smaller boxes.
4. Keep a distance from constraints for their curvature, as observed in tried steps (second-order correction, Nocedal
   and Wright, Numerical Optimization, 2006, Section 18.3).
"""

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.optimisers.linearise import active_scenarios, linearise
from dualwinch.tuning.optimisers.local_model import (
    LocalModel,
    linear_step,
    merit,
    quadratic_step,
    sampling_covariance,
    scaled_violation,
)
from dualwinch.tuning.scoring.ranking import Evaluation
from dualwinch.tuning.scoring.training_set import TrainingSet
from dualwinch.tuning.space import ContinuousDimension, Point

Floats = NDArray[np.float64]

STEPS = {"linear": linear_step, "quadratic": quadratic_step}

ATTEMPTS = [("linear", 1.0)] + [(kind, 0.5**n) for n in range(1, 20) for kind in ("linear", "quadratic")]
"""Kinds of steps from one point, each with the size of its box as a share of the first."""


class GradientSearch:
    """Multistart gradient search: steps from the start until convergence, then from the best of several points.

    Args:
        prepared: the problem with its training scenarios.
        seed: the same seed gives the same candidates.
        starts: number of points of a Sobol sequence; the next search starts from the best.
        abreast: number of steps tried at once with many scenarios; with a single scenario steps are tried one by one,
            because each costs as much as it gains.
        first, largest: half widths of the first and the largest box, in shares of each range.
        smallest: half width of the smallest box, for a single scenario and for many, where noise and the instants of
            slack make the merit rough.
        enough: least decrease of the merit for an accepted step, likewise.
        penalty: on a violation of 1, added to the logarithm of the objective in the merit; times ten if a search
            converges to an infeasible point.
        kept: distance of steps from the constraints.
        bent, bent_at_most: share of the observed curvature of constraints that steps allow for, and the largest
            allowance.
        rise: relative rise of the objective that determines the sampling covariance around a point.
        width: least and largest standard deviation of that covariance, in shares of the ranges: the objective is not
            quadratic beyond.

    Attributes:
        centre: the point from which steps are taken: the best since the last restart.
        gradients: number of gradients computed.
        gain: decrease of the merit by the last accepted step; infinite before the first.
        minima: points of convergence, in order.
        rollouts: equivalents of the gradients: in every active scenario as many as finite differences would take, about
            the cost of exact derivatives, and one in all scenarios to determine the active ones.
    """

    def __init__(
        self,
        prepared: TrainingSet,
        seed: int,
        *,
        starts: int = 16,
        abreast: int = 8,
        first: float = 0.15,
        largest: float = 0.5,
        smallest: tuple[float, float] = (1e-4, 1e-3),
        enough: tuple[float, float] = (1e-3, 1e-2),
        penalty: float = 100.0,
        kept: float = 5e-4,
        bent: float = 0.75,
        bent_at_most: float = 0.1,
        rise: float = 0.2,
        width: tuple[float, float] = (0.005, 0.15),
    ) -> None:
        """Set up.

        Raises:
            ConfigurationError: the space has no dimension with a derivative.
        """
        from scipy.stats import qmc

        problem = prepared.problem
        many = problem.ensemble is not None
        self._most_starts, self._first, self._largest, self._usual_penalty = starts, first, largest, penalty
        self._kept, self._bent, self._bent_at_most, self._rise, self._width = kept, bent, bent_at_most, rise, width
        self._sequence = qmc.Sobol(len(problem.space.dimensions), rng=seed)
        self._prepared, self._space = prepared, problem.space
        self._smooth = [
            index
            for index, dimension in enumerate(self._space.dimensions)
            if isinstance(dimension, ContinuousDimension)
        ]
        if not self._smooth:
            raise ConfigurationError("--method gradient: --space must have a gain that is a continuous number")
        self.gradients, self.rollouts, self.minima = 0, 0, list[Evaluation]()
        self._smallest, self._enough, self._abreast = smallest[many], enough[many], abreast if many else 1
        self.centre: Evaluation | None = None
        self._starts: list[Evaluation] | None = None
        self._curvature: Floats | None = None
        self.gain = np.inf
        self._begin(None)

    def _begin(self, centre: Evaluation | None, size: float | None = None, penalty: float | None = None) -> None:
        """Begin steps from a new centre, or from the same one again."""
        if centre is not self.centre or centre is None:
            self._model: LocalModel | None = None
        self.centre, self._size = centre, self._first if size is None else size
        self._penalty = self._usual_penalty if penalty is None else penalty
        self._bend = np.zeros(len(self._prepared.constraints))
        self._attempt, self._asked = 0, list[Point]()

    @property
    def _box(self) -> float:
        return self._size * ATTEMPTS[self._attempt][1] if self._attempt < len(ATTEMPTS) else 0.0

    @property
    def converged(self) -> bool:
        """Whether all steps down to the smallest box have failed."""
        return self._box < self._smallest

    @property
    def sampling_covariance(self) -> Floats:
        """Covariance (d, d) around the centre, in shares of the ranges (`local_model.sampling_covariance`)."""
        covariance = np.eye(len(self._space.dimensions)) * self._width[1] ** 2
        if self._curvature is not None:
            covariance[np.ix_(self._smooth, self._smooth)] = sampling_covariance(
                self._curvature, self._rise, self._width
            )
        return covariance

    def restart(self, centre: Evaluation) -> None:
        """Begin with large steps from a point; from another start if it failed, because it has no gradient then."""
        self._begin(centre)
        self.gain = np.inf
        self._starts = None if np.isfinite(self._merit(centre)) else []

    def ask(self, count: int) -> list[Point]:
        """The start, candidates for the next start, or steps from the centre."""
        if self._starts is not None:
            number = min(count, self._most_starts - len(self._starts))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # about counts other than powers of two
                return [self._space.decoded(shares) for shares in self._sequence.random(number)]
        if self.centre is None:
            return [self._prepared.problem.start]
        if self._model is None:
            scenarios = active_scenarios(self._prepared, self.centre.point)
            self._model = linearise(self._prepared, scenarios, self.centre.point)
            self._curvature = self._model.curvature
            self.gradients += 1
            self.rollouts += len(self._prepared.scenarios) + len(self._prepared.hard)
            self.rollouts += len(scenarios) * (1 + len(self._smooth))
        attempts = ATTEMPTS[self._attempt : self._attempt + min(count, self._abreast)]
        points = [self._stepped(self.centre.point, self._model, *attempt) for attempt in attempts]
        self._asked += points
        return points

    def _stepped(self, point: Point, model: LocalModel, kind: str, share: float) -> Point:
        centre, size = self._space.encoded(point), self._size * share
        model = model.closer(np.minimum(self._bent * self._bend * size**2, self._bent_at_most) + self._kept)
        centre[self._smooth] += STEPS[kind](model, centre[self._smooth], size)
        stepped = self._space.decoded(centre)
        fixed = [name for index, name in enumerate(self._space.names) if index not in self._smooth]
        return stepped | {name: point[name] for name in fixed}

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        """Move to the best evaluation, of any origin, and enlarge the box; else try the next kinds of steps."""
        if not evaluations:
            return
        if self._starts is not None:
            self._starts += evaluations
            if len(self._starts) >= self._most_starts:
                self.restart(min(self._starts, key=self._merit))
            return
        leader = min(evaluations, key=self._merit)
        if self.centre is None:
            self.restart(leader)
            return
        self._learn_bend(evaluations)
        gain = self._merit(self.centre) - self._merit(leader)
        if gain > self._enough:
            self.gain = gain
            moved = np.abs(self._encoded(leader) - self._encoded(self.centre)).max(initial=0.0)
            bend = self._bend
            self._begin(leader, float(np.clip(2 * moved, 10 * self._smallest, self._largest)), self._penalty)
            self._bend = bend
        else:
            self._attempt += sum(evaluation.point in self._asked for evaluation in evaluations)
        if self.converged and not self.centre.feasible and self._penalty == self._usual_penalty:
            self._begin(self.centre, penalty=10 * self._usual_penalty)
        elif self.converged:
            self.minima.append(self.centre)
            self._starts = []

    def _merit(self, evaluation: Evaluation) -> float:
        return merit(evaluation, self._prepared.constraints, self._penalty)

    def _encoded(self, evaluation: Evaluation) -> Floats:
        return self._space.encoded(evaluation.point)[self._smooth]

    def _learn_bend(self, evaluations: Sequence[Evaluation]) -> None:
        """Estimate the curvature of constraints: deviation from the linear model over the square of the step's size."""
        if self.centre is None or self._model is None or not len(self._bend):
            return
        found: list[Floats] = []
        for evaluation in evaluations:
            moved = self._encoded(evaluation) - self._encoded(self.centre)
            size = float(np.abs(moved).max(initial=0.0))
            if evaluation.pruned or not 0 < size <= 1.01 * self._size:
                continue
            beyond = [
                scaled_violation(constraint, evaluation.violations[constraint.label])[0]
                for constraint in self._prepared.constraints
            ]
            excess = np.array(beyond) - self._model.predicted(moved, len(beyond))
            found.append(np.maximum(excess / size**2, 0.0))
        if found:
            self._bend = np.min(found, axis=0)
