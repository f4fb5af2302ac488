"""Global search and gradient steps, in turns."""

from collections.abc import Sequence

from dualwinch.tuning.optimisers.cma import Cma
from dualwinch.tuning.optimisers.gradient import Gradient
from dualwinch.tuning.prepared import Prepared
from dualwinch.tuning.scoring.evaluation import Evaluation
from dualwinch.tuning.scoring.ranking import promising_first
from dualwinch.tuning.space import Point


class Hybrid:
    """CMA-ES until it gets no further, gradient steps from the best until they get no further, and so on.

    In a single scenario gradient steps come first: few of them lead to a minimum. CMA-ES learns from every evaluation,
    whoever asked for it.
    """

    def __init__(self, prepared: Prepared, seed: int) -> None:
        """The optimiser of a problem; the same seed gives the same candidates."""
        self._search, self._polish = Cma(prepared, seed), Gradient(prepared, seed)
        self._best: Evaluation | None = None
        self._searched, self._polishing = 0, prepared.problem.ensemble is None

    @property
    def rollouts(self) -> int:
        """What the gradients took."""
        return self._polish.rollouts

    def ask(self, count: int) -> list[Point]:
        """Candidates of the optimiser whose turn it is."""
        return (self._polish if self._polishing else self._search).ask(count)

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        """Learn from evaluations, and pass the turn on where they bring nothing better."""
        if not evaluations:
            return
        self._search.tell(evaluations)
        if self._polishing:
            self._polish.tell(evaluations)
        leader = evaluations[promising_first(evaluations)[0]]
        if self._best is None or promising_first([self._best, leader])[0]:
            self._best = leader
        if self._polishing:
            self._polishing = not self._polish.converged
        elif self._search.finished > self._searched:
            self._polishing = True
            self._polish.restart(self._best)
        self._searched = self._search.finished
