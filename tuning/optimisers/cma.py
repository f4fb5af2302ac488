"""Multistart CMA-ES in the unit cube (Hansen, arXiv:1604.00772), on ranks of candidates.

The strategy uses only the order of candidates by penalised objective (`tuning.scoring.ranking`).

There are several valleys: high or low preload, slow or fast winches. So when a strategy stagnates, the next one starts
at the best of several random candidates.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dualwinch.tuning.scoring.ranking import Evaluation, penalised_first
from dualwinch.tuning.scoring.training_set import TrainingSet
from dualwinch.tuning.space import Point

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class StagnationRule:
    """When a strategy counts as stagnating: it improves by less than `gain` within `generations`.

    Attributes:
        generations: number of generations compared with all before.
        gain: least improvement of the objective, as a share.
    """

    generations: int
    gain: float


ALONE = StagnationRule(25, 0.02)
"""Rule for a search by CMA-ES alone."""


class CmaSearch:
    """Multistart CMA-ES: first from the experiment's own gains, then from the best of random candidates.

    Args:
        prepared: the problem with its training scenarios.
        seed: the same seed gives the same candidates.
        patience: stagnation rule.
        sigma: initial standard deviation, in shares of each range.
        narrowing: factor on it for a restart of the first strategy if its first generation has no feasible candidate:
            around unusual gains, most of a wide distribution is infeasible.
        narrowings: largest number of such restarts.
        smallest: smallest population: one candidate per vector lane.
        edge: least distance of the initial mean from a bound, in shares of the range.
        starts: number of random candidates; the next strategy starts from the best.

    Attributes:
        finished: number of finished strategies.
        leader: the best candidate of the last finished strategy.
        rollouts: none of its own.
    """

    rollouts = 0

    def __init__(
        self,
        prepared: TrainingSet,
        seed: int,
        patience: StagnationRule = ALONE,
        *,
        sigma: float = 0.2,
        narrowing: float = 0.3,
        narrowings: int = 2,
        smallest: int = 16,
        edge: float = 0.02,
        starts: int = 64,
    ) -> None:
        self._first, self._sigma, self._smallest, self._edge, self._most_starts = (
            patience,
            sigma,
            smallest,
            edge,
            starts,
        )
        self._narrowing, self._narrowings, self._start = narrowing, narrowings, prepared.problem.start
        self._space = prepared.problem.space
        self._random = np.random.default_rng(seed)
        self._waiting: list[Evaluation] = []
        self.finished = 0
        self.leader: Evaluation | None = None
        self._starts: list[Evaluation] | None = None
        self._begin(self._start)

    def near(self, point: Point, covariance: Floats, patience: StagnationRule) -> None:
        """Restart around a point, with an initial covariance (d, d) in shares of the ranges."""
        self._narrowings = 0
        self._begin(point, covariance, patience)

    def _begin(self, start: Point, covariance: Floats | None = None, patience: StagnationRule | None = None) -> None:
        import cmaes

        self._patience = patience or self._first
        dimensions = len(self._space.dimensions)
        self._strategy = cmaes.CMA(
            mean=np.clip(self._space.encoded(start), self._edge, 1 - self._edge),
            sigma=self._sigma if covariance is None else 1.0,
            cov=covariance,
            bounds=np.tile([0.0, 1.0], (dimensions, 1)),
            seed=int(self._random.integers(2**31)),
            population_size=max(self._smallest, 4 + int(3 * np.log(dimensions))),
        )
        self._leaders: list[Evaluation] = []
        self._starts = None

    @property
    def population(self) -> int:
        """Number of candidates in a generation."""
        return self._strategy.population_size

    def ask(self, count: int) -> list[Point]:
        """Candidates drawn from the current distribution, or uniformly between strategies."""
        if self._starts is None:
            return [self._space.decoded(self._strategy.ask()) for _ in range(count)]
        return [self._space.decoded(self._random.random(len(self._space.dimensions))) for _ in range(count)]

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        """Update the strategy from all evaluations so far, a generation at a time."""
        self._waiting += evaluations
        while len(self._waiting) >= self.population:
            generation, self._waiting = self._waiting[: self.population], self._waiting[self.population :]
            if self._too_wide(generation):
                self._sigma, self._narrowings = self._narrowing * self._sigma, self._narrowings - 1
                self._begin(self._start)
            elif self._starts is None:
                self._learn(generation)
            else:
                self._starts += generation
                if len(self._starts) >= self._most_starts:
                    self._begin(self._starts[penalised_first(self._starts)[0]].point)

    def _too_wide(self, generation: Sequence[Evaluation]) -> bool:
        """Whether this is the first generation of the first strategy, and infeasible except for the start."""
        first = not (self.finished or self._leaders) and self._starts is None and self._narrowings > 0
        return first and not any(each.feasible for each in generation if each.point != self._start)

    def _learn(self, generation: Sequence[Evaluation]) -> None:
        order = penalised_first(generation)
        points = [self._space.encoded(generation[index].point).clip(0, 1) for index in order]
        self._strategy.tell([(point, float(rank)) for rank, point in enumerate(points)])
        self._leaders.append(generation[order[0]])
        if self._strategy.should_stop() or self._stagnates():
            self.leader = self._leaders[penalised_first(self._leaders)[0]]
            self._starts, self.finished = [], self.finished + 1

    def _stagnates(self) -> bool:
        """Whether the last generations improve by less than the stagnation rule demands."""
        lately, gain = self._patience.generations, self._patience.gain
        if len(self._leaders) <= lately:
            return False
        then, now = (
            leaders[penalised_first(leaders)[0]] for leaders in (self._leaders[:-lately], self._leaders[-lately:])
        )
        if then.feasible and now.feasible and len(then.objectives) == 1:
            return now.costs[0] > then.costs[0] - gain * abs(then.costs[0])
        return penalised_first([then, now])[0] == 0
