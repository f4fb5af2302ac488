"""Which trials hold in the scenarios of a sieve, as they are or with a little more or less reserve."""

from collections.abc import Sequence
from dataclasses import replace

from dualwinch.tuning.problem import MARGIN
from dualwinch.tuning.scoring.evaluate import Evaluator
from dualwinch.tuning.scoring.evaluation import Candidate, Evaluation
from dualwinch.tuning.scoring.finalists import Met
from dualwinch.tuning.scoring.sieve import Sieve
from dualwinch.tuning.scoring.trim import trimmed


def holding(evaluator: Evaluator, sieve: Sieve, trials: Sequence[Evaluation], margin: float) -> list[Met]:
    """The trials that keep to every constraint in a sieve's scenarios, and each that does once it is trimmed.

    Args:
        evaluator: runs the trimmed ones where the best were tuned as well: they have to keep to all bounds there too.
        sieve: where they have to hold.
        trials: as they were tuned.
        margin: distance from the bound on peaks that trimming leads to, as a share (`tuning.scoring.trim`).

    Returns:
        Each as it was tuned, a trimmed one with the number of the trial that it was; and what it came to.
    """
    space = evaluator.prepared.problem.space
    attempts = sieve.meet([trial.candidate for trial in trials])
    met = [(trial, attempt.held) for trial, attempt in zip(trials, attempts, strict=True) if attempt.held]
    others: list[tuple[int, Candidate]] = []
    for trial, attempt in zip(trials, attempts, strict=True):
        excess = max(attempt.excess, -trial.reserve - MARGIN)
        other = trimmed(trial.candidate, excess, space, sieve.constraints, margin)
        others += [(trial.number, other)] if other else []
    tried = sieve.meet([other for _, other in others])
    held = [(number, attempt.held) for (number, _), attempt in zip(others, tried, strict=True) if attempt.held]
    tuned = evaluator.over([result.candidate for _, result in held], evaluator.for_the_best, tuning=True)
    return met + [
        (replace(trial, number=number), result)
        for trial, (number, result) in zip(tuned, held, strict=True)
        if trial.violation <= MARGIN
    ]
