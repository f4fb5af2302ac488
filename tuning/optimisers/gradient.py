"""Steps along exact gradients within a trust region, linear in logarithms or quadratic, led by a merit function.

At the best point so far every logarithm is linear in the gains' logarithms (`local_model`). What is best within the
linear constraints and a box around the point is the next candidate: sequential linear programming with an exact penalty
(Fletcher and Sainz de la Maza, Math. Programming 43, 1989), which may leave the constraints for a while where that
brings far more than it costs. Where such steps fail, a Gauss–Newton step has its turn before the box shrinks further.
Constraints are curved; how much shows where steps were tried, and the next ones keep that distance (second-order
correction, Nocedal and Wright, Numerical Optimization, 2006, Section 18.3).
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
"""Steps from one point, and their boxes beside the first."""


class GradientSearch:
    """Multistart: steps from the start until they get no further, then from the best of some points, and so on.

    Args:
        prepared: the problem with its training scenarios.
        seed: the same seed gives the same candidates.
        starts: points of a Sobol sequence, from the best of which the next search starts.
        abreast: steps tried at once where there are many scenarios: in a single one each costs as much as the gradient
            is worth.
        first, largest: half widths of the first and the largest box, in shares of each range.
        smallest: half width of the smallest box in a single scenario, and in many, where noise and the moments at which
            ropes go slack make the ground uneven.
        enough: least improvement of the merit that a step is taken for, likewise.
        penalty: what a violation of 1 counts in the merit, beside the logarithm of the objective; ten times that if it
            has to.
        kept: distance that steps keep from the constraints.
        bent, bent_at_most: share of the curvature seen that constraints are taken for bent by, and the most that a step
            allows for.
        rise: what the objective rises by around a point where the search goes on, as a share.
        width: how wide that is, at the least and at most, in shares of the ranges: the objective is no parabola beyond.

    Attributes:
        gradients: how many gradients it took.
        gain: by how much the last step that was taken lowered the merit; infinite before the first.
        minima: where steps got no further, in their order; there is more than one.
        rollouts: what the gradients took: in every scenario that decides as many as differences would have taken,
            which is about what exact derivatives cost, and in all of them one to see which these are.
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
        """The optimiser of a problem.

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
        self._centre: Evaluation | None = None
        self._starts: list[Evaluation] | None = None
        self._curvature: Floats | None = None
        self.gain = np.inf
        self._begin(None)

    def _begin(self, centre: Evaluation | None, size: float | None = None, penalty: float | None = None) -> None:
        """Go on from another point, or from the same once more."""
        if centre is not self._centre or centre is None:
            self._model: LocalModel | None = None
        self._centre, self._size = centre, self._first if size is None else size
        self._penalty = self._usual_penalty if penalty is None else penalty
        self._bend = np.zeros(len(self._prepared.constraints))
        self._attempt, self._asked = 0, list[Point]()

    @property
    def _box(self) -> float:
        return self._size * ATTEMPTS[self._attempt][1] if self._attempt < len(ATTEMPTS) else 0.0

    @property
    def converged(self) -> bool:
        """Whether no step that is still tried makes anything better."""
        return self._box < self._smallest

    @property
    def centre(self) -> Evaluation | None:
        """The best point since steps began at another, from which they are taken."""
        return self._centre

    @property
    def sampling_covariance(self) -> Floats:
        """The covariance (d, d) of points around the centre, in shares of the ranges (`local_model.surroundings`)."""
        covariance = np.eye(len(self._space.dimensions)) * self._width[1] ** 2
        if self._curvature is not None:
            covariance[np.ix_(self._smooth, self._smooth)] = sampling_covariance(
                self._curvature, self._rise, self._width
            )
        return covariance

    def restart(self, centre: Evaluation) -> None:
        """Try large steps from a point; from another start where it failed, for such a point has no slope."""
        self._begin(centre)
        self.gain = np.inf
        self._starts = None if np.isfinite(self._merit(centre)) else []

    def ask(self, count: int) -> list[Point]:
        """The start, or points among which the next is chosen, or steps from the best point."""
        if self._starts is not None:
            number = min(count, self._most_starts - len(self._starts))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # about counts that are no powers of two
                return [self._space.decoded(shares) for shares in self._sequence.random(number)]
        if self._centre is None:
            return [self._prepared.problem.start]
        if self._model is None:
            scenarios = active_scenarios(self._prepared, self._centre.point)
            self._model = linearise(self._prepared, scenarios, self._centre.point)
            self._curvature = self._model.curvature
            self.gradients += 1
            self.rollouts += len(self._prepared.scenarios) + len(self._prepared.hard)
            self.rollouts += len(scenarios) * (1 + len(self._smooth))
        attempts = ATTEMPTS[self._attempt : self._attempt + min(count, self._abreast)]
        points = [self._stepped(self._centre.point, self._model, *attempt) for attempt in attempts]
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
        """Go to the best, by any optimiser, and try larger steps next; else smaller ones or another kind."""
        if not evaluations:
            return
        if self._starts is not None:
            self._starts += evaluations
            if len(self._starts) >= self._most_starts:
                self.restart(min(self._starts, key=self._merit))
            return
        leader = min(evaluations, key=self._merit)
        if self._centre is None:
            self.restart(leader)
            return
        self._learn_bend(evaluations)
        gain = self._merit(self._centre) - self._merit(leader)
        if gain > self._enough:
            self.gain = gain
            moved = np.abs(self._encoded(leader) - self._encoded(self._centre)).max(initial=0.0)
            bend = self._bend
            self._begin(leader, float(np.clip(2 * moved, 10 * self._smallest, self._largest)), self._penalty)
            self._bend = bend
        else:
            self._attempt += sum(evaluation.point in self._asked for evaluation in evaluations)
        if self.converged and not self._centre.feasible and self._penalty == self._usual_penalty:
            self._begin(self._centre, penalty=10 * self._usual_penalty)
        elif self.converged:
            self.minima.append(self._centre)
            self._starts = []

    def _merit(self, evaluation: Evaluation) -> float:
        return merit(evaluation, self._prepared.constraints, self._penalty)

    def _encoded(self, evaluation: Evaluation) -> Floats:
        return self._space.encoded(evaluation.point)[self._smooth]

    def _learn_bend(self, evaluations: Sequence[Evaluation]) -> None:
        """Learn how far constraints leave their linear model, as a multiple of the square of the step's size."""
        if self._centre is None or self._model is None or not len(self._bend):
            return
        found: list[Floats] = []
        for evaluation in evaluations:
            moved = self._encoded(evaluation) - self._encoded(self._centre)
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
