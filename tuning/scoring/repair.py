"""Candidates with as much reserve as their peaks ask for, neither more nor less.

The reserve, by which tension commands keep off `tension_max`, lowers the highest peaks by nearly its own size and costs
next to nothing, until it is the force that draws at the edge of authority lack. A search sees neither: its few
scenarios have lower peaks than hundreds do, and seldom such a draw.
"""

from collections.abc import Sequence
from dataclasses import replace

from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.baseline import RESERVE
from dualwinch.tuning.constraints import Constraint
from dualwinch.tuning.problem import MARGIN
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate, Evaluation
from dualwinch.tuning.scoring.rollouts import worst_of
from dualwinch.tuning.scoring.validation import FeasibilityScreen, Validated
from dualwinch.tuning.space import ContinuousDimension, Space

PEAK = "worst.peak_tension"

MOST, LEAST = 0.02, 0.001
"""Excess, as a share of the bound, beyond which a peak has other reasons; and the least change worth a try."""


def peak_bounds(constraints: Sequence[Constraint]) -> list[Constraint]:
    """The bounds on the highest tension."""
    return [each for each in constraints if each.statistic.name == PEAK and not each.at_least]


def reserve_dimension(space: Space) -> ContinuousDimension | None:
    """The range of the reserve; ``None`` where it does not vary."""
    found = [each for each in space.dimensions if each.name == RESERVE and isinstance(each, ContinuousDimension)]
    return found[0] if found else None


def repaired(
    candidate: Candidate, excess: float, space: Space, constraints: Sequence[Constraint], margin: float
) -> Candidate | None:
    """The candidate with the reserve that takes its peaks to a distance from their bound.

    Args:
        candidate: has been tried.
        excess: of its highest peak over the bound, as a share; negative where it is lower.
        space: what varies.
        constraints: among them the bound on peaks.
        margin: the distance, as a share of the bound.

    Returns:
        ``None`` where the reserve does not vary, nothing bounds the peak, or the reserve is not what matters.
    """
    bounds, varies = [each.bound for each in peak_bounds(constraints)], reserve_dimension(space)
    if not bounds or not varies or excess > MOST:
        return None
    bound = min(bounds)
    now = float(candidate.point[RESERVE])
    reserve = min(max(now + (excess + margin) * bound, varies.lower), varies.upper)
    if abs(reserve - now) < LEAST * bound:
        return None
    return replace(candidate, point=candidate.point | {RESERVE: reserve})


def screened(
    evaluator: Evaluator, sieve: FeasibilityScreen, trials: Sequence[Evaluation], margin: float
) -> list[Validated]:
    """The trials that keep to every constraint in a sieve's scenarios, and each that does once it is trimmed.

    Args:
        evaluator: runs the trimmed ones where the best were tuned as well: they have to keep to all bounds there too.
        sieve: where they have to hold.
        trials: as they were tuned.
        margin: distance from the bound on peaks that trimming leads to, as a share (`tuning.scoring.repair`).

    Returns:
        Each as it was tuned, a trimmed one with the number of the trial that it was; and what it came to.
    """
    space = evaluator.prepared.problem.space
    attempts = sieve.meet([trial.candidate for trial in trials])
    met = [(trial, attempt.held) for trial, attempt in zip(trials, attempts, strict=True) if attempt.held]
    others: list[tuple[int, Candidate]] = []
    for trial, attempt in zip(trials, attempts, strict=True):
        excess = max(attempt.excess, -trial.reserve - MARGIN)
        other = repaired(trial.candidate, excess, space, sieve.constraints, margin)
        others += [(trial.number, other)] if other else []
    tried = sieve.meet([other for _, other in others])
    held = [(number, attempt.held) for (number, _), attempt in zip(others, tried, strict=True) if attempt.held]
    tuned = evaluator.over([result.candidate for _, result in held], evaluator.for_the_best, tuning=True)
    return met + [
        (replace(trial, number=number), result)
        for trial, (number, result) in zip(tuned, held, strict=True)
        if trial.violation <= MARGIN
    ]


DISTANCE = 0.006
"""Distance from their bound, as a share, that the highest peaks are to keep."""

SHARES = (1.0, 0.75, 0.5, 0.25)
"""Shares of what the reserve is to be raised by: the largest is taken that does no harm where motors are overwhelmed,
for there the force that it takes away is missing."""


def repaired_after_further_draws(evaluator: Evaluator, trial: Evaluation, scenarios: Sequence[Scenario]) -> Evaluation:
    """A trial, or the same with the reserve that takes its peaks to a distance from their bound, if they come nearer.

    The reserve is never lowered: in yet more draws a peak may be higher still. Peaks far beyond the bound (`MOST`) have
    other reasons.

    Args:
        evaluator: runs it, and with more reserve where the best were tuned: it has to keep to all bounds there too.
        trial: as it was tuned.
        scenarios: where its peaks are looked at; none leave it as it is.
    """
    candidate, space = trial.candidate, evaluator.prepared.problem.space
    bounds = peak_bounds(evaluator.prepared.constraints)
    if not (bounds and scenarios and reserve_dimension(space)):
        return trial
    beyond = worst_of(evaluator.run([candidate], scenarios), bounds, scenarios)
    excess = float(beyond[beyond <= MOST].max(initial=-1.0))
    wanted = repaired(candidate, excess, space, bounds, DISTANCE) if excess > -DISTANCE else None
    if wanted is None:
        return trial
    now = float(candidate.point[RESERVE])
    raised = [now + share * (float(wanted.point[RESERVE]) - now) for share in SHARES]
    others = [replace(candidate, point=candidate.point | {RESERVE: reserve}) for reserve in raised]
    tuned = evaluator.over(others, evaluator.for_the_best, tuning=True)
    held = [other for other in tuned if other.violation <= MARGIN]
    return replace(held[0], number=trial.number) if held else trial
