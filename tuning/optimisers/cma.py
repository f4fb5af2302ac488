"""CMA-ES in the unit cube (Hansen, arXiv:1604.00772), on ranks of candidates, with restarts at the leader."""

from collections.abc import Sequence

import numpy as np

from dualwinch.tuning.scoring.ranking import Evaluation, penalised_first
from dualwinch.tuning.scoring.training_set import TrainingSet
from dualwinch.tuning.space import EDGE, Point

SIGMA = 0.2
"""Initial standard deviation, in shares of each range; half of it at a restart."""

NARROWING = 0.25
"""Factor on the standard deviation where it is too wide at first."""


class CmaSearch:
    """CMA-ES from the experiment's own gains, restarted at the best candidate once it stops.

    1. Draw a generation from a normal distribution, at first around the start.
    2. Learn mean, step size and covariance from the order of its candidates by the exact penalty function
       (`tuning.scoring.ranking.penalised_first`), those first that were run in more scenarios.
    3. If the start ranks before the whole first generation, begin again with a quarter of the standard deviation:
       around gains made for a machine, most of a wide distribution is worse.
    4. If the strategy stops, as its distribution no longer changes or has become too narrow, begin again at the leader.

    Args:
        prepared: the problem with its training scenarios.
        seed: the same seed gives the same candidates.
    """

    def __init__(self, prepared: TrainingSet, seed: int) -> None:
        problem = prepared.problem
        self._space, self._start, self._penalty = problem.space, problem.start, problem.options.penalty
        self._size = problem.options.generation
        self._random = np.random.default_rng(seed)
        self._waiting: list[Evaluation] = []
        self._leader: Evaluation | None = None
        self._reference: Evaluation | None = None
        self._sigma = SIGMA
        self._begin(self._start)

    def _begin(self, start: Point) -> None:
        import cmaes

        self._strategy = cmaes.CMA(
            mean=np.clip(self._space.encoded(start), EDGE, 1 - EDGE),
            sigma=self._sigma,
            bounds=np.tile([0.0, 1.0], (len(self._space.dimensions), 1)),
            seed=int(self._random.integers(2**31)),
            population_size=self._size,
        )

    def ask(self, count: int) -> list[Point]:
        """Candidates drawn from the current distribution."""
        return [self._space.decoded(self._strategy.ask()) for _ in range(count)]

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        """Update the strategy from all evaluations so far, a generation at a time."""
        self._waiting += evaluations
        while len(self._waiting) >= self._size:
            generation, self._waiting = self._waiting[: self._size], self._waiting[self._size :]
            if self._start_leads(generation) and self._sigma > EDGE:
                self._sigma *= NARROWING
                self._begin(self._start)
            else:
                self._learn(generation)

    def _start_leads(self, generation: Sequence[Evaluation]) -> bool:
        """Whether the start ranks before all of a first generation."""
        starts = [each for each in generation if each.point == self._start]
        self._reference = starts[0] if starts else self._reference
        if self._leader or self._reference is None:
            return False
        candidates = [self._reference, *(each for each in generation if each.point != self._start)]
        return penalised_first(candidates, self._penalty)[0] == 0

    def _learn(self, generation: Sequence[Evaluation]) -> None:
        order = penalised_first(generation, self._penalty)
        order.sort(key=lambda index: -generation[index].scenarios)
        points = [self._space.encoded(generation[index].point).clip(0, 1) for index in order]
        self._strategy.tell([(point, float(rank)) for rank, point in enumerate(points)])
        candidates = [*([self._leader] if self._leader else []), generation[order[0]]]
        self._leader = candidates[penalised_first(candidates, self._penalty)[0]]
        if self._strategy.should_stop():
            self._sigma = SIGMA / 2
            self._begin(self._leader.point)
