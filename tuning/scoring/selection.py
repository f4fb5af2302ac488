"""The method of tuning: training set, search, validation set, chance constraint, test set.

1. **Training set** (`tuning.scoring.training_set`): sample average approximation with common random numbers (Shapiro,
   Dentcheva and Ruszczyński, Lectures on Stochastic Programming, 2009, Chapter 5), strata by authority ratio, vertices,
   and a pool of active scenarios. Bounds on the worst case keep a back-off.
2. **Search** (`tuning.optimisers`, `tuning.scoring.evaluation`): CMA-ES (Hansen, arXiv:1604.00772) and gradients, led
   by an exact penalty (Nocedal and Wright, Numerical Optimization, 2006, Section 17.2); in a batch successive halving
   over scenarios (Jamieson and Talwalkar, AISTATS 2016).
3. **Validation set** (`tuning.scoring.validation`): candidates that are feasible in training, by training objective,
   are evaluated sequentially in draws of another stream, hardest scenarios first, out at the first violation. After a
   group without a feasible one those of the next keep twice the back-off in training from each bound that it violated.
   The feasible ones that improve on the start there are validated; where there are none, some of all groups. The start
   is one of them where it satisfies the bounds on means: they are ordered by an exact penalty on the share of scenarios
   that violate a bound, and what comes after the start is dropped. One repair: a peak beyond its bound is taken back by
   the reserve.
4. **Chance constraint** (`tuning.scoring.chance`): the validated candidates in their order are run in fresh draws, each
   in its own, until one violates no bound in M ≥ ln(K/β)/ε of them (scenario approach). One that violates a peak is
   repaired by a line search on the reserve and counts as another candidate. If none passes, one is chosen by an exact
   penalty on its share of violations, and the result says which probability they support.
5. **Test set**: evaluated once, for the choice, the start and the baseline controller; reported with its intervals and
   never fed back. Where it contradicts the choice, the result says so.

Without an ensemble the best feasible trial is chosen in the experiment. Hyper-parameters: `SelectionConfig`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dualwinch.simulation.analysis.authority import within_authority
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.problem import CHANCE, TEST
from dualwinch.tuning.scoring.chance import ChanceConstraint, clopper_pearson
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.progress import CHOOSING, SCORING, SILENT, TuningProgress
from dualwinch.tuning.scoring.ranking import Evaluation, best_first, improves_on, pareto_front, rarest_violations_first
from dualwinch.tuning.scoring.rollouts import worst_of
from dualwinch.tuning.scoring.test_set import ControllerScore, SelectionResult, TestSet
from dualwinch.tuning.scoring.validation import ValidationSet, repaired, validation_scenarios
from dualwinch.tuning.selection_config import SampleSizes

NOT_CHOSEN = "no trial is better than the gains that the search started from"
CONTRADICTED = "the test set contradicts the choice: there the start is better"
PROBABILITY_CONTRADICTED = "the test set contradicts the probability: there more scenarios violate a bound"


@dataclass(frozen=True)
class Validated:
    """A candidate that improves on the start in the validation set, or the start.

    Attributes:
        trial: in the training set; a repaired one has the number of the trial that it was.
        result: in the validation set.
    """

    trial: Evaluation
    result: Evaluation


def select(
    evaluator: Evaluator,
    trials: Sequence[Evaluation],
    sizes: SampleSizes | None = None,
    watch: TuningProgress = SILENT,
) -> SelectionResult:
    """Choose the best trial by validation set and chance constraint, and score it in the test set.

    Args:
        evaluator: of the problem.
        trials: finished trials, at least one.
        sizes: of the sets, at most; default: those of the problem's `SelectionConfig`. They are smaller where the
            evaluator's time is short, and counted anew once candidates are validated.
        watch: gets both phases.

    Raises:
        KeyboardInterrupt: interrupted.
    """
    problem = evaluator.training.problem
    asked = sizes or problem.selection.sizes
    sizes = evaluator.affordable(asked)
    watch.phase(CHOOSING)
    start = _start(evaluator, trials)
    chosen, validation, chance = start, None, None
    if problem.ensemble is None:
        leader = trials[best_first(trials)[0]]
        chosen = leader if improves_on(leader, start) else start
    else:
        validation_set = ValidationSet(evaluator, validation_scenarios(problem, sizes))
        validated = _validated(evaluator, validation_set, trials, start, sizes)
        left = evaluator.affordable(asked.after_validation)
        sizes = replace(sizes, chance=left.chance, test=left.test)
        if validated:
            best, chance = _confirmed(evaluator, validation_set, validated, sizes)
            chosen, validation = best.trial, best.result
    watch.phase(SCORING)
    test = TestSet(evaluator, sizes.test, problem.stream(TEST))
    scores = {"start": test.score(start.candidate), "paper": test.paper}
    scores = {"best": scores["start"] if chosen is start else test.score(chosen.candidate)} | scores
    contradiction = "" if chosen is start else _contradiction(scores, chance)
    return SelectionResult(
        best=chosen,
        obstacle=NOT_CHOSEN if chosen is start else "",
        contradiction=contradiction,
        validation=validation,
        chance=chance,
        test_violations=scores["best"].evaluation.violated,
        scores=scores,
        constraints=test.constraints,
        has_test_set=problem.ensemble is not None,
        within_authority=within_authority(test.scenarios),
        sizes=sizes,
    )


def _contradiction(scores: Mapping[str, ControllerScore], chance: ChanceConstraint | None) -> str:
    """In what the test set contradicts the choice or the probability, in words; empty where it does not.

    Violations that are no more frequent than the fresh draws support are expected, and do not speak for the start.
    """
    best, start = (scores[name].evaluation for name in ("best", "start"))
    if chance:
        least, _ = clopper_pearson(best.violated, best.scenarios, chance.confidence)
        if least > chance.supported:
            return PROBABILITY_CONTRADICTED
        best = replace(best, violations={}) if not best.violation_of_means else best
    return "" if improves_on(best, start) else CONTRADICTED


def _start(evaluator: Evaluator, trials: Sequence[Evaluation]) -> Evaluation:
    """The start in the training set: the trial that is it, else from the rollouts of `prepare`."""
    point = evaluator.training.problem.start
    return next((trial for trial in trials if trial.point == point and not trial.pruned), None) or evaluator.start()


def _validated(
    evaluator: Evaluator,
    validation: ValidationSet,
    trials: Sequence[Evaluation],
    start: Evaluation,
    sizes: SampleSizes,
) -> list[Validated]:
    """The first group with candidates that improve on the start in the validation set, the best first, the start last.

    Where none is feasible before the rollouts for it are spent, some of all groups that improve on the start.
    """
    config = evaluator.training.problem.selection
    constraints, machines = validation.constraints, validation.machines
    (reference,) = evaluator.over([start.candidate], validation.scenarios, constraints=constraints, machines=machines)
    waiting = _by_training_objective([trial for trial in trials if trial.point != start.point], config.back_off)
    if waiting and len(waiting[0].objectives) > 1:
        front = [waiting[index] for index in pareto_front(waiting)] or waiting
        waiting = front[:: -(-len(front) // sizes.candidates)]
    tried, before, back_off = list[Evaluation](), evaluator.rollouts, dict[str, float]()
    while evaluator.rollouts - before <= sizes.screening_rollouts and (
        not tried or evaluator.affords(sizes.after_validation)
    ):
        group = [trial for trial in waiting if _keeps(trial, back_off, config.back_off)][: sizes.candidates]
        if not group:
            break
        found, violated = _screened(evaluator, validation, group)
        found = [each for each in found if improves_on(each.result, reference)]
        if found:
            return _to_the_start(found, Validated(start, reference), constraints, config.penalty)
        waiting, tried = [trial for trial in waiting if trial not in group], [*tried, *group]
        back_off |= {label: 2 * back_off.get(label, config.back_off) for label in violated}
    some = tried[:: -(-len(tried) // sizes.candidates) or 1]
    candidates = [trial.candidate for trial in some]
    results = evaluator.over(candidates, validation.scenarios, constraints=constraints, machines=machines)
    found = [
        Validated(trial, result) for trial, result in zip(some, results, strict=True) if improves_on(result, reference)
    ]
    return _to_the_start(found, Validated(start, reference), constraints, config.penalty)


def _to_the_start(
    found: Sequence[Validated], start: Validated, constraints: Sequence[Constraint], penalty: float
) -> list[Validated]:
    """Candidates by an exact penalty on their share of violations, and the start, behind which none counts.

    The start takes part where it violates nothing but bounds on single scenarios, and objectives have an order.
    """
    result, single = start.result, len(start.result.objectives) == 1
    margins = (each.label for each in constraints if not isinstance(each.statistic, Statistic))
    if not single or result.violation_of_means > 0 or any(result.violations[label] > 0 for label in margins):
        return _by_penalty(found, penalty)
    ordered = _by_penalty([*found, start], penalty)
    return ordered[: next(place for place, each in enumerate(ordered) if each is start) + 1]


def _by_penalty(found: Sequence[Validated], penalty: float) -> list[Validated]:
    results = [each.result for each in found]
    shares = [result.violated / result.scenarios for result in results]
    return [found[index] for index in rarest_violations_first(results, shares, penalty)]


def _keeps(trial: Evaluation, back_off: Mapping[str, float], at_first: float) -> bool:
    """Whether a trial keeps a back-off from each bound in training, where its violations contain that at first."""
    return all(trial.violations.get(label, 0.0) - at_first <= -distance for label, distance in back_off.items())


def _by_training_objective(trials: Sequence[Evaluation], back_off: float) -> list[Evaluation]:
    """Complete trials that satisfy the bounds themselves, without the back-off, by objective; all where none does."""
    finished = [trials[index] for index in best_first(trials) if not trials[index].pruned]
    near = [trial for trial in finished if trial.violation <= back_off]
    if not near or len(near[0].objectives) > 1:
        return finished
    return sorted(near, key=lambda trial: trial.costs[0])


def _screened(
    evaluator: Evaluator, validation: ValidationSet, group: Sequence[Evaluation]
) -> tuple[list[Validated], set[str]]:
    """The candidates of a group that are feasible, as they are or repaired, and bounds that others violate."""
    problem = evaluator.training.problem
    results = validation.screen([trial.candidate for trial in group])
    found = [Validated(trial, each.feasible) for trial, each in zip(group, results, strict=True) if each.feasible]
    others = [
        (trial, other)
        for trial, each in zip(group, results, strict=True)
        if each.excess > 0 and (other := repaired(trial.candidate, each.excess, problem))
    ]
    again = validation.screen([other for _, other in others])
    found += [
        Validated(replace(trial, candidate=other), each.feasible)
        for (trial, other), each in zip(others, again, strict=True)
        if each.feasible
    ]
    return found, {label for each in results for label, value in each.missing.items() if 0 < value < np.inf}


def _confirmed(
    evaluator: Evaluator, validation: ValidationSet, validated: Sequence[Validated], sizes: SampleSizes
) -> tuple[Validated, ChanceConstraint]:
    """The first candidate without a violation in fresh draws of its own, else that with the fewest (step 4)."""
    problem, config = evaluator.training.problem, evaluator.training.problem.selection
    ensemble = problem.ensemble
    if ensemble is None:
        raise ValueError("only an ensemble has a chance constraint")
    ensemble = replace(ensemble, experiment=problem.experiment)
    waiting, found = list(validated), list[tuple[int, Validated]]()
    while waiting and len(found) < config.confirmed:
        candidate, first = waiting.pop(0), len(found) * sizes.chance
        draws = ensemble.chosen(range(first, first + sizes.chance), problem.stream(CHANCE))
        excess = worst_of(evaluator.run([candidate.trial.candidate], draws), validation.constraints)[0]
        found.append((int((excess > 0).sum()), candidate))
        if not found[-1][0] or not evaluator.affords(sizes.after_validation):
            break
        worst = float(excess[excess <= config.repair_most].max(initial=-np.inf))
        steps = [repaired(candidate.trial.candidate, worst, problem, share) for share in config.repair_steps]
        results = validation.screen([step for step in steps if step])
        feasible = [each.feasible for each in results if each.feasible]
        waiting[:0] = [
            Validated(replace(candidate.trial, candidate=result.candidate), result) for result in feasible[:1]
        ]
    shares = [violations / sizes.chance for violations, _ in found]
    chosen = rarest_violations_first([each.result for _, each in found], shares, config.penalty)[0]
    violations, best = next((each for each in found if not each[0]), found[chosen])
    return best, ChanceConstraint(config.violation, config.confidence, config.confirmed, sizes.chance, violations)
