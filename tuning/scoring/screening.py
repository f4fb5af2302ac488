"""Screening: evaluate candidates of the search on the validation set, the best in training first (step 3)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.progress import REPAIRING, SCREENING
from dualwinch.tuning.scoring.ranking import (
    Evaluation,
    feasibility_first,
    improves_on,
    pareto_front,
    rarest_violations_first,
)
from dualwinch.tuning.scoring.rollouts import worst_of
from dualwinch.tuning.scoring.validation import ValidationSet, repaired
from dualwinch.tuning.selection_config import SampleSizes


@dataclass(frozen=True)
class Validated:
    """A candidate that improves on the start in the validation set, or the start.

    Attributes:
        trial: its evaluation on the training set; a repaired candidate keeps the number of its trial.
        result: its evaluation on the validation set.
    """

    trial: Evaluation
    result: Evaluation


class Screening:
    """Validates candidates group by group, while there are candidates, rollouts and time.

    Attributes:
        constraints: with bounds as numbers for the validation set.
        start: the start; ``None`` if it is excluded: it violates bounds on means or margins, or there are several
            objectives.
    """

    def __init__(
        self,
        evaluator: Evaluator,
        validation: ValidationSet,
        trials: Sequence[Evaluation],
        start: Evaluation,
        sizes: SampleSizes,
    ) -> None:
        """Evaluate the start on the validation set; `trials` and `start` are evaluations on the training set."""
        self._evaluator, self._validation, self._sizes = evaluator, validation, sizes
        self.constraints = validation.constraints
        self._config = evaluator.training.problem.selection
        (reference,) = self._in_all([start])
        self._reference = Validated(start, reference)
        margins = (each.label for each in self.constraints if not isinstance(each.statistic, Statistic))
        excluded = reference.violation_of_means > 0 or any(reference.violations[label] > 0 for label in margins)
        self.start = None if excluded or len(reference.objectives) > 1 else self._reference
        waiting = by_training_objective(
            [trial for trial in trials if trial.point != start.point], self._config.back_off
        )
        if waiting and len(waiting[0].objectives) > 1:
            front = [waiting[index] for index in pareto_front(waiting)] or waiting
            waiting = front[:: -(-len(front) // sizes.candidates)]
        self._waiting, self._count, self._tried, self._spent = waiting, len(waiting), list[Evaluation](), 0
        self._back_off, self._stride, self._given = dict[str, float](), 2, False

    def following(self) -> list[Validated]:
        """Validated candidates that rank before the start, the best first, from the next group that has any.

        If no group had a feasible candidate that improves on the start, then, once, a sample of all groups is evaluated
        in all scenarios, and infeasible candidates that improve on the start count too.
        """
        while group := self._group():
            before = self._evaluator.rollouts
            first, last = len(self._tried) + 1, len(self._tried) + len(group)
            self._step(f"candidates {first} to {last} of {self._count}", len(group))
            found, violated = self.screened(group)
            self._spent += self._evaluator.rollouts - before
            self._tried += group
            if found := [each for each in found if improves_on(each.result, self._reference.result)]:
                self._given = True
                return before_the_start(found, self.start, self._config.penalty)
            self._back_off |= {label: 2 * self._back_off.get(label, self._config.back_off) for label in violated}
        if self._given:
            return []
        self._given = True
        some = self._tried[:: -(-len(self._tried) // self._sizes.candidates) or 1]
        self._step(f"{len(some)} of {len(self._tried)} candidates once more", len(some))
        pairs = zip(some, self._in_all(some), strict=True)
        improved = [Validated(trial, each) for trial, each in pairs if improves_on(each, self._reference.result)]
        return before_the_start(improved, self.start, self._config.penalty)

    def learn(self, draws: Sequence[Scenario], waiting: Sequence[Validated]) -> list[Validated]:
        """Add draws in which a validated candidate violated a bound to the validation set.

        Returns:
            The other validated candidates, of `waiting`, that violate no bound in these draws.
        """
        added = self._validation.extend(draws)
        if not (added and waiting):
            return list(waiting)
        result = self._evaluator.run([each.trial.candidate for each in waiting], added)
        violated = worst_of(result, self.constraints).max(axis=1) > 0
        return [each for each, out in zip(waiting, violated, strict=True) if not out]

    def repair(self, candidate: Validated, excess: float) -> list[Validated]:
        """The first feasible candidate of a line search on the reserve; empty if there is none.

        The peak of the given one exceeds its bound by `excess`, a share of the bound.
        """
        trial, problem = candidate.trial, self._evaluator.training.problem
        steps = [repaired(trial.candidate, excess, problem, share) for share in self._config.repair_steps]
        others = [step for step in steps if step]
        if others:
            self._evaluator.step(REPAIRING, len(others) * len(self._validation.scenarios))
        results = [each.feasible for each in self._validation.screen(others)]
        feasible = [each for each in results if each]
        return [Validated(replace(trial, candidate=each.candidate), each) for each in feasible[:1]]

    def screened(self, group: Sequence[Evaluation]) -> tuple[list[Validated], set[str]]:
        """The feasible candidates of a group, repaired ones included, and the bounds that the others violate."""
        problem = self._evaluator.training.problem
        results = self._validation.screen([trial.candidate for trial in group])
        found = [Validated(trial, each.feasible) for trial, each in zip(group, results, strict=True) if each.feasible]
        others = [
            (trial, other)
            for trial, each in zip(group, results, strict=True)
            if each.excess > 0 and (other := repaired(trial.candidate, each.excess, problem))
        ]
        if others:
            self._step(f"{len(others)} repaired candidates", len(others))
        again = self._validation.screen([other for _, other in others])
        found += [
            Validated(replace(trial, candidate=other), each.feasible)
            for (trial, other), each in zip(others, again, strict=True)
            if each.feasible
        ]
        return found, {label for each in results for label, value in each.missing.items() if 0 < value < np.inf}

    def _group(self) -> list[Evaluation]:
        """The next candidates, with twice the back-off in training from bounds that earlier ones violated.

        If none keeps that back-off, it is not the cause of the violations: each group then takes twice as large steps
        through the remaining candidates, to reach less aggressive gains before the rollouts are spent.
        """
        affords = not self._tried or self._evaluator.affords(self._sizes.after_validation)
        if self._spent > self._sizes.screening_rollouts or not affords:
            return []
        kept = [trial for trial in self._waiting if _keeps(trial, self._back_off, self._config.back_off)]
        if not kept:
            kept, self._stride = self._waiting[:: self._stride], 2 * self._stride
        group = kept[: self._sizes.candidates]
        self._waiting = [trial for trial in self._waiting if trial not in group]
        return group

    def _step(self, which: str, count: int) -> None:
        """Begin a step that runs `count` candidates in the validation set."""
        scenarios = len(self._validation.scenarios)
        status = f"choosing: {which} in {scenarios} validation scenarios"
        self._evaluator.step(SCREENING, count * scenarios, status)

    def _in_all(self, trials: Sequence[Evaluation]) -> list[Evaluation]:
        return self._evaluator.over(
            [trial.candidate for trial in trials],
            self._validation.scenarios,
            constraints=self.constraints,
            machines=self._validation.machines,
        )


def before_the_start(found: Sequence[Validated], start: Validated | None, penalty: float) -> list[Validated]:
    """Candidates that rank before the start by an exact penalty on their share of violations, the best first."""
    together = [*found, *([start] if start else [])]
    results = [each.result for each in together]
    shares = [result.violated / result.scenarios for result in results]
    ordered = [together[index] for index in rarest_violations_first(results, shares, penalty)]
    return ordered[: next((place for place, each in enumerate(ordered) if each is start), None)]


def by_training_objective(trials: Sequence[Evaluation], back_off: float) -> list[Evaluation]:
    """Complete trials that satisfy the bounds without back-off, in order of the objective; all if none does."""
    finished = [trials[index] for index in feasibility_first(trials) if not trials[index].pruned]
    near = [trial for trial in finished if trial.violation <= back_off]
    if not near or len(near[0].objectives) > 1:
        return finished
    return sorted(near, key=lambda trial: trial.costs[0])


def _keeps(trial: Evaluation, back_off: Mapping[str, float], at_first: float) -> bool:
    """Whether a trial keeps given back-offs from bounds in training; its violations contain the initial `at_first`."""
    return all(trial.violations.get(label, 0.0) - at_first <= -distance for label, distance in back_off.items())
