"""The best once more in many draws that neither the search nor the choice saw, with more reserve if its peaks ask so.

Peaks have a long tail: of hundreds of draws one may be a good deal higher than the others. All finalists cannot meet in
so many, but the one that is chosen can.
"""

from collections.abc import Sequence
from dataclasses import replace

from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.by_ensemble import RESERVE
from dualwinch.tuning.problem import MARGIN
from dualwinch.tuning.scoring.evaluate import Evaluator
from dualwinch.tuning.scoring.evaluation import Evaluation
from dualwinch.tuning.scoring.runs import worst_of
from dualwinch.tuning.scoring.trim import MOST, on_peaks, reserve_in, trimmed

DISTANCE = 0.006
"""Distance from their bound, as a share, that the highest peaks are to keep."""

SHARES = (1.0, 0.75, 0.5, 0.25)
"""Shares of what the reserve is to be raised by: the largest is taken that does no harm where motors are overwhelmed,
for there the force that it takes away is missing."""


def confirmed(evaluator: Evaluator, trial: Evaluation, scenarios: Sequence[Scenario]) -> Evaluation:
    """A trial, or the same with the reserve that takes its peaks to a distance from their bound, if they come nearer.

    The reserve is never lowered: in yet more draws a peak may be higher still. Peaks far beyond the bound (`MOST`) have
    other reasons.

    Args:
        evaluator: runs it, and with more reserve where the best were tuned: it has to keep to all bounds there too.
        trial: as it was tuned.
        scenarios: where its peaks are looked at; none leave it as it is.
    """
    candidate, space = trial.candidate, evaluator.prepared.problem.space
    bounds = on_peaks(evaluator.prepared.constraints)
    if not (bounds and scenarios and reserve_in(space)):
        return trial
    beyond = worst_of(evaluator.run([candidate], scenarios), bounds, scenarios)
    excess = float(beyond[beyond <= MOST].max(initial=-1.0))
    wanted = trimmed(candidate, excess, space, bounds, DISTANCE) if excess > -DISTANCE else None
    if wanted is None:
        return trial
    now = float(candidate.point[RESERVE])
    raised = [now + share * (float(wanted.point[RESERVE]) - now) for share in SHARES]
    others = [replace(candidate, point=candidate.point | {RESERVE: reserve}) for reserve in raised]
    tuned = evaluator.over(others, evaluator.for_the_best, tuning=True)
    held = [other for other in tuned if other.violation <= MARGIN]
    return replace(held[0], number=trial.number) if held else trial
