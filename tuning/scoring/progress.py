"""Progress of a study: its phases in words, and the status of the search after each batch."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from dualwinch.model.quantities.quantity import behind_number
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.progress import PhaseProgress, Progress, no_progress
from dualwinch.tuning.scoring import clock
from dualwinch.tuning.scoring.ranking import Evaluation, feasibility_first

DESIGNING = "designing a start for the machine"
DRAWING = "drawing scenarios"
REFERENCES = "compiling, up to a minute the first time; scoring the paper's gains and the start"
SEARCHING = "searching"
CERTIFYING = "certifying candidates in fresh draws"
SCORING = "scoring the best, the start and the paper's gains"
PHASES = (DRAWING, REFERENCES, SEARCHING, CERTIFYING, SCORING)
"""Phases of `tuning.tune.tune`, in this order; before them `DESIGNING`, where a start is designed."""


@dataclass
class SearchStatus:
    """Status of a search.

    Attributes:
        trials: number of finished trials, of all workers.
        complete: number of those that were run in all scenarios.
        feasible: number of those of them that satisfy every constraint.
        best: the best so far, by `tuning.scoring.ranking`; ``None`` before the first.
        rollouts: number of rollouts of this process.
        rollout_seconds: their wall time in s.
        seconds: wall time of the search in this process, in s.
        compiling: part of it spent compiling, in s.
        spent: rollouts of this process, those of checks and certificates included.
        share: of the budget of rollouts that is spent; 0 without such a budget.
    """

    trials: int = 0
    complete: int = 0
    feasible: int = 0
    best: Evaluation | None = None
    rollouts: int = 0
    rollout_seconds: float = 0.0
    seconds: float = 0.0
    compiling: float = 0.0
    spent: int = 0
    share: float = 0.0

    def add(self, evaluations: Sequence[Evaluation]) -> None:
        """Count more finished trials."""
        self.trials += len(evaluations)
        self.complete += sum(not evaluation.pruned for evaluation in evaluations)
        self.feasible += sum(evaluation.feasible for evaluation in evaluations)
        self.spent += sum(evaluation.scenarios for evaluation in evaluations)
        for evaluation in evaluations:
            if self.best is None or feasibility_first([self.best, evaluation])[0]:
                self.best = evaluation

    @property
    def overhead(self) -> float:
        """Share of the wall time outside of rollouts."""
        return 1 - self.rollout_seconds / self.seconds if self.seconds else 0.0


class TuningProgress:
    """Reports phases, batches of a search and steps of the selection to a `simulation.progress.PhaseProgress`.

    Attributes:
        objectives: for their names and units in the status line.
    """

    def __init__(self, progress: PhaseProgress = no_progress, objectives: Sequence[Statistic] = ()) -> None:
        self.objectives, self._progress = tuple(objectives), progress

    def phase(self, words: str) -> None:
        """Report the beginning of a phase, which `words` describe."""
        self._progress(0.0, words)

    def step(self, words: str, status: str = "") -> Progress:
        """Report the beginning of a step of a phase; return the callback for the share of it that is done.

        `status` has numbers, to distinguish successive steps with the same words.
        """

        def report(fraction: float) -> None:
            percentage = f", {100 * fraction:.0f} %" if fraction else ""
            self._progress(fraction, words, status and f"{status}{percentage}")

        report(0.0)
        return report

    def compiled(self, seconds: float) -> None:
        """Report the end of compilation and its duration, if it took a second or more."""
        if seconds >= 1:
            self._progress(0.0, f"compiled in {seconds:.0f} s")

    def forecast(self, preparing: float, searching: float, left: float) -> None:
        """Report, after preparation, how long it took, and how long search and everything after it will take, in s."""
        self._progress(
            0.0,
            f"prepared in {preparing:.0f} s; now {searching:.0f} s of search, and everything ends within {left:.0f} s",
        )

    def progress(self, progress: SearchStatus, until: float | None, trials: int | None) -> None:
        """Report a finished batch of a search that ends at `until`, by `clock.without_compiling`, or after `trials`."""
        self._progress(progress.share, status=self._status(progress, until, trials))

    def _status(self, now: SearchStatus, until: float | None, trials: int | None) -> str:
        of, remaining = f" of {trials}" if trials else "", _left(now, until, trials)
        words = [] if remaining is None else [f"{remaining:.0f} s of search left"]
        words.append(f"{now.trials}{of} trials, {now.feasible} of {now.complete} that ran in all scenarios feasible")
        if now.best and not all(map(math.isfinite, now.best.objectives)):
            words.append("no trial has completed its runs yet")
        elif now.best:
            values = ", ".join(
                f"{statistic.name} {value:.4g}{behind_number(statistic.unit)}"
                for statistic, value in zip(self.objectives, now.best.objectives, strict=False)
            )
            words.append(f"best {values}" + ("" if now.best.feasible else " (not feasible)"))
        if now.rollout_seconds:
            words.append(f"{now.rollouts / now.rollout_seconds:.0f} rollouts/s")
        return " · ".join(words)


SOON = 0.05
"""Share of a budget of trials or rollouts below which it gives no estimate of the remaining time."""


def _left(now: SearchStatus, until: float | None, trials: int | None) -> float | None:
    """Remaining time of the search in s, by the budget that ends first; ``None``: too early for an estimate."""
    shares = [*([now.trials / trials] if trials else []), *([now.share] if now.share else [])]
    seconds = [(now.seconds - now.compiling) * (1 / share - 1) for share in shares if share >= SOON]
    if until is not None:
        seconds.append(until - clock.without_compiling())
    return max(min(seconds), 0.0) if seconds else None


NO_PROGRESS = TuningProgress()
"""Reports nothing."""
