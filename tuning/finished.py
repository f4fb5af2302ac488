"""A finished study as data."""

from dataclasses import dataclass
from typing import Any

from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.prepared import Prepared
from dualwinch.tuning.problem import Problem
from dualwinch.tuning.progress import Progress
from dualwinch.tuning.scoring.evaluation import Evaluation
from dualwinch.tuning.scoring.verdict import Verdict


@dataclass(frozen=True)
class Cost:
    """What a study took.

    Attributes:
        rollouts: of this process, choice and score included.
        rollout_seconds: wall time in s they took.
        preparing, searching, judging: wall time in s of the parts.
        overhead: share of the search's time that was not spent in rollouts.
        margin_seconds: wall time in s that stability margins took, in all parts.
    """

    rollouts: int
    rollout_seconds: float
    preparing: float
    searching: float
    judging: float
    overhead: float
    margin_seconds: float = 0.0

    @property
    def seconds(self) -> float:
        """Wall time in s of all parts."""
        return self.preparing + self.searching + self.judging


@dataclass(frozen=True)
class Finished:
    """A finished study.

    Attributes:
        prepared: what was tuned, with scenarios and bounds.
        method: name of the optimiser.
        trials: every finished trial, in order.
        verdict: the best, and its score beside that of the start and of the paper's gains.
        progress: what the search took.
        cost: what all of it took.
        interrupted: whether an interrupt (Ctrl-C) ended the search.
    """

    prepared: Prepared
    method: str
    trials: tuple[Evaluation, ...]
    verdict: Verdict
    progress: Progress
    cost: Cost
    interrupted: bool

    @property
    def problem(self) -> Problem:
        """What was tuned."""
        return self.prepared.problem

    @property
    def trimmed(self) -> dict[str, tuple[float, float]]:
        """Gains of the best that were trimmed where it was chosen → as the search had them, and as they are."""
        best = self.verdict.best
        was = next((trial.point for trial in self.trials if trial.number == best.number), best.point)
        return {name: (float(was[name]), float(now)) for name, now in best.point.items() if now != was[name]}

    @property
    def best(self) -> Experiment:
        """The experiment with the best gains."""
        return self.problem.tuned(self.verdict.best.point)

    @property
    def gains(self) -> dict[str, Any]:
        """Every tuned key of the best and its value."""
        return self.problem.space.settings(self.verdict.best.point)
