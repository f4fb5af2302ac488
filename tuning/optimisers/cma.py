"""CMA-ES in the unit cube, led by ranks: constraints first, then the objective (Hansen, arXiv:1604.00772).

The strategy sees nothing but who is better than whom (`tuning.ranking`): a constraint needs no penalty, no weight.
"""

from collections.abc import Sequence

import numpy as np

from tuning.evaluation import Evaluation
from tuning.problem import Problem
from tuning.ranking import best_first
from tuning.space import Point

SPREAD = 0.2
"""First standard deviation, in shares of each range."""

SMALLEST = 16
"""Smallest generation: one for each vector lane."""

EDGE = 0.02
"""Nearest to a bound that the first mean lies."""


class Cma:
    """CMA-ES that starts at the experiment's own gains, and starts again around the best when it has converged."""

    def __init__(self, problem: Problem, seed: int) -> None:
        """The strategy of a problem; the same seed gives the same candidates."""
        self._space = problem.space
        self._random = np.random.default_rng(seed)
        self._mean = np.clip(self._space.encoded(problem.start), EDGE, 1 - EDGE)
        self._waiting: list[Evaluation] = []
        self._best: Evaluation | None = None
        self._begin()

    def _begin(self) -> None:
        import cmaes

        dimensions = len(self._space.dimensions)
        self._strategy = cmaes.CMA(
            mean=self._mean,
            sigma=SPREAD,
            bounds=np.tile([0.0, 1.0], (dimensions, 1)),
            seed=int(self._random.integers(2**31)),
            population_size=max(SMALLEST, 4 + int(3 * np.log(dimensions))),
        )

    @property
    def population(self) -> int:
        """Number of candidates a generation learns from."""
        return self._strategy.population_size

    def ask(self, count: int) -> list[Point]:
        """Candidates drawn from the current distribution."""
        return [self._space.decoded(self._strategy.ask()) for _ in range(count)]

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        """Learn, a generation at a time, from whatever has been evaluated by now."""
        self._waiting += evaluations
        while len(self._waiting) >= self.population:
            generation, self._waiting = self._waiting[: self.population], self._waiting[self.population :]
            order = best_first(generation)
            places = [self._space.encoded(generation[place].point).clip(0, 1) for place in order]
            self._strategy.tell([(place, float(rank)) for rank, place in enumerate(places)])
            leader = generation[order[0]]
            if self._best is None or best_first([self._best, leader])[0]:
                self._best = leader
            if self._strategy.should_stop():
                self._mean = np.clip(self._space.encoded(self._best.point), EDGE, 1 - EDGE)
                self._begin()
