"""The choice of the best trial: feasible in validation sets, better than the start there, and tested once.

1. Trials that are feasible in the training set, up to its back-off, are ordered by training objective.
2. Those of several strata of it are screened in the first validation set (`tuning.scoring.validation`), each as it is
   and repaired (`tuning.scoring.repair`). Scenarios beyond the actuators' authority count, unless that leaves only
   trials that are far worse in training.
3. The feasible ones that improve on the start are ranked with back-off; the first of them are run, beside the start, in
   the second validation set, and ranked again. The first is the choice.
4. Its peaks are checked in further draws, and repaired where they are near their bound.
5. Chance constraint: the choice is run in fresh draws, which say with which probability its bounds are satisfied
   (`tuning.scoring.chance`). They do not change the choice.
6. The test set is evaluated once, for the choice, the start and the baseline controller. It is reported with its
   intervals and never fed back: where it contradicts the choice or the probability, the result says so.

Without an ensemble the best feasible trial is chosen in the experiment.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from dualwinch.simulation.analysis.authority import within_authority
from dualwinch.simulation.batch.scenarios import experiment_of
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.problem import CHANCE, TEST
from dualwinch.tuning.scoring.chance import ChanceConstraint, clopper_pearson
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.progress import CHOOSING, SCORING, SILENT, TuningProgress
from dualwinch.tuning.scoring.ranking import (
    Evaluation,
    backed_off_first,
    best_first,
    improves_on,
    pareto_front,
    penalised_first,
)
from dualwinch.tuning.scoring.repair import repaired_after_further_draws, screened
from dualwinch.tuning.scoring.rollouts import worst_of
from dualwinch.tuning.scoring.test_set import SelectionResult, TestSet
from dualwinch.tuning.scoring.validation import (
    FeasibilityScreen,
    Validated,
    further_draws,
    screened_by_strata,
    strata,
    validation_sets,
)
from dualwinch.tuning.selection_config import SampleSizes

NOT_CHOSEN = "no trial is better than the gains that the search started from"
CONTRADICTED = "the test set contradicts the choice: there the start is better"
PROBABILITY_CONTRADICTED = "the test set contradicts the probability: there more scenarios violate a bound"


def select(
    evaluator: Evaluator,
    trials: Sequence[Evaluation],
    sizes: SampleSizes | None = None,
    watch: TuningProgress = SILENT,
) -> SelectionResult:
    """Choose the best trial by validation, and score it in the test set.

    Args:
        evaluator: of the problem.
        trials: finished trials, at least one.
        sizes: of the sets; default: those of the problem's `SelectionConfig`.
        watch: gets both phases.

    Raises:
        KeyboardInterrupt: interrupted.
    """
    problem = evaluator.training.problem
    sizes = sizes or problem.selection.sizes
    watch.phase(CHOOSING)
    start = _start(evaluator, trials)
    chosen, validation, chance = start, None, None
    if problem.ensemble is None:
        leader = trials[best_first(trials)[0]]
        chosen = leader if improves_on(leader, start) else start
    elif ranking := _validated(evaluator, trials, start, sizes):
        chosen, validation = ranking[0]
        chosen = repaired_after_further_draws(evaluator, chosen, further_draws(problem, sizes))
        chance = _chance_constraint(evaluator, chosen, sizes)
    watch.phase(SCORING)
    test = TestSet(evaluator, sizes.test, problem.stream(TEST))
    scores = {"start": test.score(start.candidate), "paper": test.paper}
    scores = {"best": scores["start"] if chosen is start else test.score(chosen.candidate)} | scores
    violations = int((worst_of(scores["best"].result, test.constraints, test.scenarios) > 0).sum())
    contradiction = ""
    if chosen is not start and not improves_on(scores["best"].evaluation, scores["start"].evaluation):
        contradiction = CONTRADICTED
    elif chance and chance.satisfied:
        least, _ = clopper_pearson(violations, len(test.scenarios), chance.confidence)
        contradiction = PROBABILITY_CONTRADICTED if least > chance.violation else ""
    return SelectionResult(
        best=chosen,
        obstacle=NOT_CHOSEN if chosen is start else "",
        contradiction=contradiction,
        validation=validation,
        chance=chance,
        test_violations=violations,
        scores=scores,
        constraints=test.constraints,
        has_test_set=problem.ensemble is not None,
        within_authority=np.array([within_authority(experiment_of(each)) for each in test.scenarios]),
        sizes=sizes,
    )


def _chance_constraint(evaluator: Evaluator, chosen: Evaluation, sizes: SampleSizes) -> ChanceConstraint:
    """The chosen gains in draws of the stream `CHANCE`."""
    problem, config = evaluator.training.problem, evaluator.training.problem.selection
    draws = problem.drawn(sizes.chance, problem.stream(CHANCE))
    excess = worst_of(evaluator.run([chosen.candidate], draws), evaluator.training.constraints, draws)
    return ChanceConstraint(config.violation, config.confidence, sizes.chance, int((excess > 0).sum()))


def _start(evaluator: Evaluator, trials: Sequence[Evaluation]) -> Evaluation:
    """The start in the training set: the trial that is it, else from the rollouts of `prepare`."""
    point = evaluator.training.problem.start
    return next((trial for trial in trials if trial.point == point and not trial.pruned), None) or evaluator.start()


def _validated(
    evaluator: Evaluator, trials: Sequence[Evaluation], start: Evaluation, sizes: SampleSizes
) -> list[Validated]:
    """The trials that improve on the start in both validation sets, the best first."""
    first, second, beyond = validation_sets(evaluator.training.problem, sizes)
    others = [trial for trial in trials if trial.point != start.point]
    ranking = _in_first_set(evaluator, others, start, [*beyond, *first], sizes)
    if beyond and _too_costly(others, ranking, evaluator.training.problem.selection.authority_price):
        ranking = _in_first_set(evaluator, others, start, first, sizes)
    leading = ranking[: sizes.second_candidates]
    again, before = zip(*leading, strict=True) if leading else ((), ())
    return _ranked(evaluator, again, start, second, before) + ranking[sizes.second_candidates :]


def _too_costly(trials: Sequence[Evaluation], ranking: Sequence[Validated], price: float) -> bool:
    """Whether all that are feasible beyond the actuators' authority are far worse than the best in training.

    Several objectives have no best one: there it is whether none is feasible.
    """
    if trials and len(trials[0].objectives) > 1:
        return not ranking
    best = trials[penalised_first(trials)[0]].objectives[0] if trials else 0.0
    return all(trial.objectives[0] > price * best for trial, _ in ranking)


def _in_first_set(
    evaluator: Evaluator,
    trials: Sequence[Evaluation],
    start: Evaluation,
    scenarios: Sequence[Scenario],
    sizes: SampleSizes,
) -> list[Validated]:
    """Trials that are feasible in the first validation set and improve on the start there, the best first.

    Where none is feasible, those of the first group that improve on the start.
    """
    problem, config = evaluator.training.problem, evaluator.training.problem.selection
    ordered = _feasible_in_training(trials, config.back_off)
    if not ordered:
        return []
    screen, before = FeasibilityScreen(evaluator, scenarios), evaluator.rollouts
    screening = partial(screened, evaluator, screen, margin=config.selection_back_off)
    if len(problem.objectives) == 1:
        first = [ordered[index] for index in strata(ordered, sizes.candidates, config)]
        found = screened_by_strata(
            ordered, first, screening, lambda: evaluator.rollouts - before < sizes.screening_rollouts
        )
    else:
        front = [trials[index] for index in pareto_front(trials)] or ordered
        first = front[:: -(-len(front) // sizes.candidates)]
        found = screening(first)
    if not found:
        return _ranked(evaluator, first, start, scenarios)
    (reference,) = evaluator.over([start.candidate], scenarios, constraints=screen.constraints)
    results = [result for _, result in found]
    order = backed_off_first(results, config.selection_back_off, config.penalty)
    return [found[index] for index in order if improves_on(results[index], reference)]


def _feasible_in_training(trials: Sequence[Evaluation], back_off: float) -> list[Evaluation]:
    """Trials that may be feasible, the best first; all where none is.

    Training asks for a back-off from bounds on the worst case, as more scenarios have worse ones; validation does not.
    A search often ends a little nearer, so whatever satisfies the bounds themselves is as good.
    """
    finished = [trials[index] for index in best_first(trials) if not trials[index].pruned]
    near = [trial for trial in finished if trial.violation <= back_off]
    if not near or len(near[0].objectives) > 1:
        return finished
    return sorted(near, key=lambda trial: trial.objectives[0])


def _ranked(
    evaluator: Evaluator,
    trials: Sequence[Evaluation],
    start: Evaluation,
    scenarios: Sequence[Scenario],
    before: Sequence[Evaluation] = (),
) -> list[Validated]:
    """Trials that improve on the start in some scenarios, the best first, with their results there.

    Args:
        evaluator: runs them.
        trials: in the training set.
        start: is run as well.
        scenarios: of a validation set.
        before: results in another validation set; the smaller clearance counts.
    """
    config = evaluator.training.problem.selection
    candidates = [trial.candidate for trial in (*trials, start)]
    *found, reference = evaluator.over(candidates, scenarios, constraints=evaluator.bounds(scenarios))
    if before:
        found = [_least_clearance(result, earlier) for result, earlier in zip(found, before, strict=True)]
    order = backed_off_first(found, config.selection_back_off, config.penalty)
    return [(trials[index], found[index]) for index in order if improves_on(found[index], reference)]


def _least_clearance(result: Evaluation, earlier: Evaluation) -> Evaluation:
    """A result that is as near to its bounds as an earlier one was, if that was nearer."""
    known = {label: min(value, 0.0) for label, value in earlier.violations.items()}
    nearer = {label: max(value, known.get(label, value)) for label, value in result.violations.items()}
    return replace(result, violations=nearer)
