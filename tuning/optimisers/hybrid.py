"""Hybrid of global search and gradient steps, alternating."""

from collections.abc import Sequence

from dualwinch.tuning.optimisers.cma import ALONE, CmaSearch, StagnationRule
from dualwinch.tuning.optimisers.gradient import GradientSearch
from dualwinch.tuning.optimisers.linearise import gradients_guide
from dualwinch.tuning.scoring.ranking import Evaluation, penalised_first
from dualwinch.tuning.scoring.training_set import TrainingSet
from dualwinch.tuning.space import Point

FIRST, AROUND = StagnationRule(6, 0.3), StagnationRule(8, 0.1)
"""Defaults of `HybridSearch`."""


class HybridSearch:
    """CMA-ES alternating with gradient steps.

    1. CMA-ES until it stagnates.
    2. Gradient steps from its best candidate while they gain enough.
    3. CMA-ES around the final point, with the inverse curvature of the last gradient as its initial covariance, which
       it would otherwise have to learn. If it finds nothing better, it restarts elsewhere.

    In a single scenario, gradient steps come first, down to a minimum, since they cost little there. CMA-ES learns from
    every evaluation, its own or not; if gradients are no guide, it is used alone (`gradients_guide`).

    Args:
        prepared: the problem with its training scenarios.
        seed: the same seed gives the same candidates.
        first, around: stagnation rules of CMA-ES at first, and around the final point of gradient steps.
        worthwhile: least decrease of the merit by a gradient step with many scenarios, where a step takes as long as
            two generations.
    """

    def __init__(
        self,
        prepared: TrainingSet,
        seed: int,
        *,
        first: StagnationRule = FIRST,
        around: StagnationRule = AROUND,
        worthwhile: float = 0.25,
    ) -> None:
        problem, self._around = prepared.problem, around
        self._polish = GradientSearch(prepared, seed) if gradients_guide(problem) else None
        self._search = CmaSearch(prepared, seed, first if self._polish else ALONE)
        self._least = worthwhile if problem.ensemble else 0.0
        self._searched, self._polishing = 0, problem.ensemble is None and self._polish is not None
        self._polished: Evaluation | None = None

    @property
    def rollouts(self) -> int:
        """Equivalents of the gradients."""
        return self._polish.rollouts if self._polish else 0

    def ask(self, count: int) -> list[Point]:
        """Candidates of the current optimiser."""
        return (self._polish if self._polish and self._polishing else self._search).ask(count)

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        """Learn from evaluations, and switch the optimiser when it gains too little."""
        if not evaluations:
            return
        self._search.tell(evaluations)
        if self._polish and self._polishing:
            self._polish.tell(evaluations)
            centre = self._polish.centre
            if centre and (self._polish.converged or self._polish.gain < self._least):
                self._polishing, self._polished = False, centre
                self._search.near(centre.point, self._polish.sampling_covariance, self._around)
        elif self._polish and self._search.finished > self._searched:
            self._pass_on(self._polish)
        self._searched = self._search.finished

    def _pass_on(self, polish: GradientSearch) -> None:
        """Begin gradient steps at the search's best candidate, if it improves on the point where the search began."""
        leader, began_at, self._polished = self._search.leader, self._polished, None
        if leader and (began_at is None or penalised_first([began_at, leader])[0]):
            self._polishing = True
            polish.restart(leader)
