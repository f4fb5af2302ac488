"""Repair of candidates whose peaks are too near their bound, or too far from it, by the reserve.

The reserve, by which tension commands keep off `tension_max`, lowers the highest peaks by nearly its own size and costs
next to nothing, until it is the force that draws at the edge of authority lack. A search sees neither: its few
scenarios have lower peaks than hundreds do, and seldom such a draw.
"""

from collections.abc import Sequence
from dataclasses import replace

from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.baseline import RESERVE
from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.rollouts import worst_of
from dualwinch.tuning.scoring.validation import FeasibilityScreen, Validated
from dualwinch.tuning.space import ContinuousDimension, Space

PEAK = "worst.peak_tension"


def peak_bounds(constraints: Sequence[Constraint]) -> list[Constraint]:
    """The bounds on the highest tension."""
    return [each for each in constraints if each.statistic.name == PEAK and not each.at_least]


def reserve_dimension(space: Space) -> ContinuousDimension | None:
    """The range of the reserve; ``None`` where it does not vary."""
    found = [each for each in space.dimensions if each.name == RESERVE and isinstance(each, ContinuousDimension)]
    return found[0] if found else None


def repaired(
    candidate: Candidate, excess: float, problem: TuningProblem, constraints: Sequence[Constraint], margin: float
) -> Candidate | None:
    """The candidate with the reserve that takes its peaks to a distance from their bound.

    Args:
        candidate: has been run.
        excess: of its highest peak over the bound, as a share; negative where it is lower.
        problem: says what varies.
        constraints: among them the bound on peaks.
        margin: the distance, as a share of the bound.

    Returns:
        ``None`` where the reserve does not vary, nothing bounds the peak, or the reserve is not what matters.
    """
    bounds, varies = [each.bound for each in peak_bounds(constraints)], reserve_dimension(problem.space)
    if not bounds or not varies or excess > problem.selection.repair_most:
        return None
    bound = min(bounds)
    now = float(candidate.point[RESERVE])
    reserve = min(max(now + (excess + margin) * bound, varies.lower), varies.upper)
    if abs(reserve - now) < problem.selection.repair_least * bound:
        return None
    return replace(candidate, point=candidate.point | {RESERVE: reserve})


def screened(
    evaluator: Evaluator, screen: FeasibilityScreen, trials: Sequence[Evaluation], margin: float
) -> list[Validated]:
    """The trials that are feasible in a validation set, and those that are once they are repaired.

    Args:
        evaluator: runs repaired ones in the training scenarios of the best, where they have to be feasible too.
        screen: the validation set.
        trials: in the training set.
        margin: distance from the bound on peaks that a repair leads to, as a share.

    Returns:
        Each in the training and in the validation set; a repaired one has the number of the trial that it was.
    """
    problem = evaluator.training.problem
    back_off = problem.selection.back_off
    results = screen.screen([trial.candidate for trial in trials])
    found = [(trial, result.feasible) for trial, result in zip(trials, results, strict=True) if result.feasible]
    others: list[tuple[int, Candidate]] = []
    for trial, result in zip(trials, results, strict=True):
        excess = max(result.excess, -trial.clearance - back_off)
        other = repaired(trial.candidate, excess, problem, screen.constraints, margin)
        others += [(trial.number, other)] if other else []
    again = screen.screen([other for _, other in others])
    kept = [(number, each.feasible) for (number, _), each in zip(others, again, strict=True) if each.feasible]
    trained = evaluator.over([result.candidate for _, result in kept], evaluator.for_the_best, training=True)
    return found + [
        (replace(trial, number=number), result)
        for trial, (number, result) in zip(trained, kept, strict=True)
        if trial.violation <= back_off
    ]


def repaired_after_further_draws(evaluator: Evaluator, trial: Evaluation, scenarios: Sequence[Scenario]) -> Evaluation:
    """A trial, with more reserve where its peaks in further draws are nearer to their bound than a back-off.

    Peaks have a long tail, and of hundreds of draws one may be much higher than the others. The reserve is never
    lowered; peaks far beyond the bound have other reasons. Of several shares of the wanted change the largest is taken
    that is feasible in training, for beyond the actuators' authority the force that it takes away is missing.

    Args:
        evaluator: runs it, and with more reserve in the training scenarios of the best.
        trial: in the training set.
        scenarios: the further draws; none leave it as it is.
    """
    problem, candidate = evaluator.training.problem, trial.candidate
    config, bounds = problem.selection, peak_bounds(evaluator.training.constraints)
    if not (bounds and scenarios and reserve_dimension(problem.space)):
        return trial
    beyond = worst_of(evaluator.run([candidate], scenarios), bounds, scenarios, config.leeway_beyond_authority)
    excess, back_off = float(beyond[beyond <= config.repair_most].max(initial=-1.0)), config.repair_back_off
    wanted = repaired(candidate, excess, problem, bounds, back_off) if excess > -back_off else None
    if wanted is None:
        return trial
    now = float(candidate.point[RESERVE])
    reserves = [now + share * (float(wanted.point[RESERVE]) - now) for share in config.repair_steps]
    others = [replace(candidate, point=candidate.point | {RESERVE: reserve}) for reserve in reserves]
    trained = evaluator.over(others, evaluator.for_the_best, training=True)
    feasible = [other for other in trained if other.violation <= config.back_off]
    return replace(feasible[0], number=trial.number) if feasible else trial
