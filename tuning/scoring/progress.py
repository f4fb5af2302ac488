"""Where a study stands: the phases of tuning in words, and the search batch by batch."""

from collections.abc import Sequence
from dataclasses import dataclass

from dualwinch.model.quantities.quantity import behind_number
from dualwinch.simulation.ensembles.result import Statistic
from dualwinch.simulation.progress import PhaseProgress, Progress, no_progress
from dualwinch.tuning.scoring import clock
from dualwinch.tuning.scoring.ranking import Evaluation, feasibility_first

DRAWING = "drawing scenarios"
REFERENCES = "compiling, a minute or two the first time; scoring the paper's gains and the start"
SEARCHING = "searching"
CHOOSING = "choosing among the validated candidates"
SCORING = "scoring the best, the start and the paper's gains"
VALIDATING = "choosing: the paper's gains and the start in the validation set"
SCREENING = "choosing: candidates of the search in the validation set"
REPAIRING = "choosing: a candidate with more reserve in the validation set"
PHASES = (DRAWING, REFERENCES, SEARCHING, CHOOSING, SCORING)
"""What `tuning.tune.tune` does, in this order."""


@dataclass
class SearchStatus:
    """Where a study stands.

    Attributes:
        trials: finished trials, of all workers.
        feasible: how many of them satisfy every constraint.
        best: the best so far, by `tuning.scoring.ranking`; ``None`` before the first.
        rollouts: rollouts of this process.
        rollout_seconds: wall time they took.
        seconds: wall time of the search in this process.
        compiling: how much of that was compiling, which comes once.
        spent: rollouts of the finished trials, of all workers, and of this process's gradients.
        share: of the rollouts that there may be; 0 where the budget does not say.
    """

    trials: int = 0
    feasible: int = 0
    best: Evaluation | None = None
    rollouts: int = 0
    rollout_seconds: float = 0.0
    seconds: float = 0.0
    compiling: float = 0.0
    spent: int = 0
    share: float = 0.0

    def add(self, evaluations: Sequence[Evaluation]) -> None:
        """Count further finished trials."""
        self.trials += len(evaluations)
        self.feasible += sum(evaluation.feasible for evaluation in evaluations)
        self.spent += sum(evaluation.scenarios for evaluation in evaluations)
        for evaluation in evaluations:
            if self.best is None or feasibility_first([self.best, evaluation])[0]:
                self.best = evaluation

    @property
    def overhead(self) -> float:
        """Share of the wall time that was not spent in rollouts."""
        return 1 - self.rollout_seconds / self.seconds if self.seconds else 0.0


class TuningProgress:
    """Reports phases, batches of a search and steps of a choice as `simulation.progress.PhaseProgress`.

    Attributes:
        objectives: names and units of what is minimised, for the status line.
    """

    def __init__(self, progress: PhaseProgress = no_progress, objectives: Sequence[Statistic] = ()) -> None:
        self.objectives, self._progress = tuple(objectives), progress

    def phase(self, words: str) -> None:
        """A phase begins; `words` say what is done in it."""
        self._progress(0.0, words)

    def step(self, words: str, status: str = "") -> Progress:
        """A step of a phase begins.

        Args:
            words: what is done in it.
            status: the same in numbers, where steps of the same words follow each other.

        Returns:
            What receives the share of the step that is done.
        """

        def report(fraction: float) -> None:
            done = f", {100 * fraction:.0f} %" if fraction else ""
            self._progress(fraction, words, status and f"{status}{done}")

        report(0.0)
        return report

    def compiled(self, seconds: float) -> None:
        """What the study runs is compiled, which took so many seconds; next to none where it was in the cache."""
        if seconds >= 1:
            self._progress(0.0, f"compiled in {seconds:.0f} s")

    def progress(self, progress: SearchStatus, until: float | None, trials: int | None) -> None:
        """A batch of the search is finished; it ends at the time `until` in s since the epoch, or after `trials`."""
        self._progress(progress.share, status=self._status(progress, until, trials))

    def _status(self, now: SearchStatus, until: float | None, trials: int | None) -> str:
        of, left = f" of {trials}" if trials else "", _left(now, until, trials)
        words = [] if left is None else [f"{left:.0f} s of search left"]
        words.append(f"{now.trials}{of} trials, {100 * now.feasible / max(now.trials, 1):.0f} % feasible")
        if now.best:
            values = ", ".join(
                f"{statistic.name} {value:.4g}{behind_number(statistic.unit)}"
                for statistic, value in zip(self.objectives, now.best.objectives, strict=False)
            )
            words.append(f"best {values}" + ("" if now.best.feasible else " (not feasible)"))
        if now.rollout_seconds:
            words.append(f"{now.rollouts / now.rollout_seconds:.0f} rollouts/s")
        return " · ".join(words)


SOON = 0.05
"""Share of a budget of trials or rollouts before which it does not say how long the rest takes."""


def _left(now: SearchStatus, until: float | None, trials: int | None) -> float | None:
    """Time in s that the search will take, by the budget that ends first; ``None``: it is too early to say."""
    shares = [*([now.trials / trials] if trials else []), *([now.share] if now.share else [])]
    left = [(now.seconds - now.compiling) * (1 / share - 1) for share in shares if share >= SOON]
    if until is not None:
        left.append(until - clock.now())
    return max(min(left), 0.0) if left else None


NO_PROGRESS = TuningProgress()
"""Reports to nothing."""
