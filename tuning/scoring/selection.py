"""The method of tuning: training set, search, validation set, chance constraint, test set.

1. **Training set** (`tuning.scoring.training_set`): sample average approximation with common random numbers (Shapiro,
   Dentcheva and Ruszczyński, Lectures on Stochastic Programming, 2009, Chapter 5), strata by authority ratio, vertices,
   and a pool of active scenarios. Bounds on the worst case keep a back-off.
2. **Search** (`tuning.optimisers`, `tuning.scoring.evaluation`): CMA-ES (Hansen, arXiv:1604.00772) and gradients, on
   an exact penalty (Nocedal and Wright, Numerical Optimization, 2006, Section 17.2); within a batch, successive halving
   over scenarios (Jamieson and Talwalkar, AISTATS 2016).
3. **Validation set** (`tuning.scoring.screening`, `tuning.scoring.validation`): candidates that are feasible in
   training, in order of the training objective, are evaluated sequentially in draws of another stream, hardest
   scenarios first, and rejected at the first violation. After a group without a feasible candidate, the next group
   keeps twice the back-off in training from each violated bound; if no candidate keeps it, groups step through the
   remaining ones. Feasible candidates that improve on the start are validated; if there are none, a sample of all
   groups that improve on it. They are ordered by an exact penalty on the share of scenarios that violate a bound;
   candidates behind the start are dropped. Repair: a peak beyond its bound is lowered by the reserve.
4. **Chance constraint** (`tuning.scoring.chance`): validated candidates are run in this order, each in its own fresh
   draws, until one violates no bound in M ≥ ln(K/β)/ε of them (scenario approach). Draws with a violation join the
   validation set (sequential probabilistic validation; Alamo, Tempo, Luque and Ramirez, Automatica 52, 2015), where
   they reject others, also of groups screened later; a candidate with too high a peak is repaired by a line search on
   the reserve and counts as another candidate. The start comes last, if it satisfies the bounds on means. If no
   candidate passes, one is selected by an exact penalty on its share of violations, and the result states the
   supported probability.
5. **Test set**: evaluated once, for the selected candidate, the start and the baseline controller; reported with
   intervals, never fed back. The result states any contradiction to the selection.

Without an ensemble, the best feasible trial in the experiment is selected. Hyper-parameters: `SelectionConfig`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from dualwinch.tuning.problem import CHANCE, TEST, TuningProblem
from dualwinch.tuning.scoring.chance import ChanceConstraint, clopper_pearson
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.progress import CHOOSING, NO_PROGRESS, SCORING, VALIDATING, TuningProgress
from dualwinch.tuning.scoring.ranking import Evaluation, feasibility_first, improves_on, rarest_violations_first
from dualwinch.tuning.scoring.rollouts import worst_of
from dualwinch.tuning.scoring.screening import Screening, Validated
from dualwinch.tuning.scoring.test_set import ControllerScore, SelectionResult, TestSet
from dualwinch.tuning.scoring.validation import ValidationSet, validation_scenarios
from dualwinch.tuning.selection_config import SampleSizes

NOT_CHOSEN = "no trial is better than the gains that the search started from"
CONTRADICTED = "the test set contradicts the choice: there the start is better"
PROBABILITY_CONTRADICTED = "the test set contradicts the probability: there more scenarios violate a bound"


def select(
    evaluator: Evaluator,
    trials: Sequence[Evaluation],
    sizes: SampleSizes | None = None,
    watch: TuningProgress = NO_PROGRESS,
) -> SelectionResult:
    """Select the best of finished trials by validation set and chance constraint, and score it on the test set.

    The largest sizes of the sets are by default those of the problem's `SelectionConfig`. They are reduced if the
    evaluator's time is short, and computed again after validation. `watch` gets both phases and their steps.
    """
    problem = evaluator.training.problem
    asked = sizes or problem.selection.sizes
    sizes = evaluator.affordable(asked)
    watch.phase(CHOOSING)
    evaluator.watch = watch
    start = _start(evaluator, trials)
    chosen, validation, chance, better = start, None, None, ""
    if problem.ensemble is None:
        leader = trials[feasibility_first(trials)[0]]
        chosen = leader if improves_on(leader, start) else start
    else:
        scenarios = validation_scenarios(problem, sizes)
        evaluator.step(VALIDATING, 2 * len(scenarios))
        validation_set = ValidationSet(evaluator, scenarios)
        screening = Screening(evaluator, validation_set, trials, start, sizes)
        validated = screening.following()
        left = evaluator.affordable(asked.after_validation)
        sizes = replace(sizes, chance=left.chance, test=left.test)
        best, chance, better = _chance_constrained(evaluator, screening, validated, sizes)
        if best:
            chosen, validation = best.trial, best.result
    watch.phase(SCORING)
    evaluator.step(SCORING, (2 if chosen is start else 3) * (sizes.test if problem.ensemble else 1))
    test = TestSet(evaluator, sizes.test, problem.stream(TEST))
    scores = {"start": test.score(start.candidate), "paper": test.paper}
    scores = {"best": scores["start"] if chosen is start else test.score(chosen.candidate)} | scores
    contradiction = "" if chosen is start else _contradiction(scores, chance)
    return SelectionResult(
        best=chosen,
        obstacle="" if chosen is not start else f"{NOT_CHOSEN}; {better}" if better else NOT_CHOSEN,
        contradiction=contradiction,
        validation=validation,
        chance=chance,
        test_violations=scores["best"].evaluation.violated,
        scores=scores,
        constraints=test.constraints,
        has_test_set=problem.ensemble is not None,
        within_authority=test.within_authority,
        sizes=sizes,
    )


def _contradiction(scores: Mapping[str, ControllerScore], chance: ChanceConstraint | None) -> str:
    """Contradiction of the test set to the selection or to its probability, in words; empty if there is none.

    Means are over feasible scenarios, as in validation: with too little force the vehicle falls behind whatever the
    gains, and a few such scenarios would decide. Violations no more frequent than the fresh draws support are expected,
    and are no argument for the start.
    """
    best, start = (scores[name].feasible for name in ("best", "start"))
    if chance:
        least, _ = clopper_pearson(best.violated, best.scenarios, chance.confidence)
        if least > chance.supported:
            return PROBABILITY_CONTRADICTED
        best = replace(best, violations={}) if not best.violation_of_means else best
    return "" if improves_on(best, start) else CONTRADICTED


def _start(evaluator: Evaluator, trials: Sequence[Evaluation]) -> Evaluation:
    """The start's evaluation on the training set: its trial, else from the rollouts of `prepare`."""
    point = evaluator.training.problem.start
    return next((trial for trial in trials if trial.point == point and not trial.pruned), None) or evaluator.start()


def _chance_constrained(
    evaluator: Evaluator, screening: Screening, first: Sequence[Validated], sizes: SampleSizes
) -> tuple[Validated | None, ChanceConstraint | None, str]:
    """The first candidate without a violation in its own fresh draws, else the best by an exact penalty (step 4).

    Returns:
        The candidate, or ``None``; the result of its draws; and, if it is the start, a note on a better candidate that
        rarely violates bounds.
    """
    problem, config = evaluator.training.problem, evaluator.training.problem.selection
    ensemble = problem.ensemble
    if ensemble is None:
        raise ValueError("only an ensemble has a chance constraint")
    ensemble = replace(ensemble, experiment=problem.experiment)
    waiting, found = list(first), list[tuple[int, Validated]]()
    while len(found) < config.chance_candidates:
        waiting = waiting or screening.following() or [each for each in (screening.start,) if each]
        if not waiting:
            break
        candidate, number = waiting.pop(0), len(found) * sizes.chance
        ours = f"candidate {len(found) + 1} of at most {config.chance_candidates}"
        which = "the start" if candidate is screening.start else ours
        evaluator.step(f"choosing: {which} in {sizes.chance} fresh draws", sizes.chance)
        draws = ensemble.chosen(range(number, number + sizes.chance), problem.stream(CHANCE))
        excess = worst_of(evaluator.run([candidate.trial.candidate], draws), screening.constraints)[0]
        found.append((int((excess > 0).sum()), candidate))
        if not found[-1][0] or candidate is screening.start or not evaluator.affords(sizes.after_validation):
            break
        waiting = screening.learn([draw for draw, each in zip(draws, excess, strict=True) if each > 0], waiting)
        worst = float(excess[excess <= config.repair_most].max(initial=-np.inf))
        waiting[:0] = screening.repair(candidate, worst)
    if not found:
        return None, None, ""
    shares = [violations / sizes.chance for violations, _ in found]
    order = rarest_violations_first([each.result for _, each in found], shares, config.penalty)
    violations, best = next((each for each in found if not each[0]), found[order[0]])
    others = [found[index] for index in order if found[index][1] is not screening.start]
    better = _better_candidate(*others[0], sizes.chance, problem) if best is screening.start and others else ""
    chance = ChanceConstraint(config.violation, config.confidence, config.chance_candidates, sizes.chance, violations)
    return best, chance, better


def _better_candidate(violations: int, candidate: Validated, draws: int, problem: TuningProblem) -> str:
    """Note on a candidate that violates bounds in some fresh draws: its objective and number of violations."""
    trial, objective = candidate.trial, problem.objectives[0]
    reached = f"{objective.name} = {trial.objectives[0]:.4g} {objective.unit}".rstrip()
    return f"trial {trial.number} reaches {reached}, but violates bounds in {violations} of {draws} fresh draws"
