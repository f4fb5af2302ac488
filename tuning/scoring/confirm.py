"""The best once more in many draws that neither the search nor the choice saw, with more reserve if its peaks ask so.

Peaks have a long tail: of hundreds of draws one may be a good deal higher than the others. All finalists cannot meet in
so many, but the one that is chosen can.
"""

from collections.abc import Sequence
from dataclasses import replace

from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.tuning.problem import MARGIN
from dualwinch.tuning.scoring.evaluate import Evaluator
from dualwinch.tuning.scoring.evaluation import Evaluation
from dualwinch.tuning.scoring.runs import worst_of
from dualwinch.tuning.scoring.trim import on_peaks, reserve_in, trimmed

DISTANCE = 0.006
"""Distance from their bound, as a share, that the highest peaks are to keep."""


def confirmed(evaluator: Evaluator, trial: Evaluation, scenarios: Sequence[Scenario]) -> Evaluation:
    """A trial, or the same with the reserve that takes its peaks to a distance from their bound, if they come nearer.

    The reserve is never lowered: in yet more draws a peak may be higher still.

    Args:
        evaluator: runs it, and with more reserve where the best were tuned: it has to keep to all bounds there too.
        trial: as it was tuned.
        scenarios: where its peaks are looked at; none leave it as it is.
    """
    space, bounds = evaluator.prepared.problem.space, on_peaks(evaluator.prepared.constraints)
    if not (bounds and scenarios and reserve_in(space)):
        return trial
    excess = float(worst_of(evaluator.run([trial.candidate], scenarios), bounds, scenarios).max())
    other = trimmed(trial.candidate, excess, space, bounds, DISTANCE) if excess > -DISTANCE else None
    if other is None:
        return trial
    (tuned,) = evaluator.over([other], evaluator.for_the_best, tuning=True)
    return replace(tuned, number=trial.number) if tuned.violation <= MARGIN else trial
