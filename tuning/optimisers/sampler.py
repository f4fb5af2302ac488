"""Optuna's samplers, each on a study in memory, so that the cost of a candidate does not grow with the storage."""

import importlib.util
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from dualwinch.model.errors import ConfigurationError
from dualwinch.tuning.scoring.ranking import Evaluation, feasibility_first
from dualwinch.tuning.scoring.training_set import TrainingSet
from dualwinch.tuning.space import Point
from dualwinch.tuning.storage.record import distributions, finish, finished_trial

if TYPE_CHECKING:
    import optuna


@dataclass(frozen=True)
class SamplerKind:
    """A kind of sampler.

    Attributes:
        name: of Optuna's class.
        memory: largest number of evaluations it uses; beyond, half of them are dropped, and the best and the latest
            kept. 0: without limit.
        settings: further arguments of the class.
    """

    name: str
    memory: int
    settings: Mapping[str, Any] = field(default_factory=dict)

    def make(self, seed: int) -> "optuna.samplers.BaseSampler":
        """Make the sampler from a seed."""
        import optuna

        if self.name == "GPSampler" and importlib.util.find_spec("torch") is None:
            raise ConfigurationError("--method gp: needs PyTorch, `pip install torch`, or `uv run --with torch ...`")
        return getattr(optuna.samplers, self.name)(seed=seed, **self.settings)


TPE = SamplerKind("TPESampler", 256, {"n_startup_trials": 20})
GP = SamplerKind("GPSampler", 128, {"deterministic_objective": True})
NSGA2, NSGA3 = SamplerKind("NSGAIISampler", 0), SamplerKind("NSGAIIISampler", 0)
QMC = SamplerKind("QMCSampler", 256, {"scramble": True, "warn_independent_sampling": False})
RANDOM = SamplerKind("RandomSampler", 256)


class SamplerSearch:
    """An optimiser by one of Optuna's samplers; the same seed gives the same candidates."""

    def __init__(self, kind: SamplerKind, prepared: TrainingSet, seed: int) -> None:
        self._kind, problem = kind, prepared.problem
        self._space = problem.space
        self._distributions = distributions(problem.space)
        self._objectives = len(problem.objectives)
        self._random = np.random.default_rng(seed)
        self._known: list[Evaluation] = []
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # some of the samplers are experimental
            self._sampler = kind.make(int(self._random.integers(2**31)))
        self._asked: dict[tuple[object, ...], optuna.Trial] = {}
        self._begin([])

    def _begin(self, kept: Sequence[Evaluation]) -> None:
        import optuna

        self._study = optuna.create_study(
            directions=[optuna.study.StudyDirection.MINIMIZE] * self._objectives, sampler=self._sampler
        )
        self._asked.clear()
        self._study.add_trials([finished_trial(evaluation, self._space) for evaluation in kept])
        self._known = list(kept)

    def ask(self, count: int) -> list[Point]:
        """Candidates, each sampled with regard to those still under way."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            trials = [self._study.ask(self._distributions) for _ in range(count)]
        points = [{name: trial.params[name] for name in self._distributions} for trial in trials]
        self._asked |= {tuple(point.values()): trial for point, trial in zip(points, trials, strict=True)}
        return points

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        """Learn from evaluations, and drop half of them beyond the sampler's memory."""
        for evaluation in evaluations:
            trial = self._asked.pop(tuple(evaluation.point[name] for name in self._distributions), None)
            if trial is None:
                self._study.add_trial(finished_trial(evaluation, self._space))
            else:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    finish(self._study, trial, evaluation)
        self._known += evaluations
        if self._kind.memory and len(self._known) > self._kind.memory and not self._asked:
            self._begin(_remembered(self._known, self._kind.memory // 2))


def _remembered(known: Sequence[Evaluation], count: int) -> list[Evaluation]:
    """The best and the latest evaluations, half of each, in their original order."""
    memory = set(feasibility_first(known)[: count // 2])
    memory |= set([index for index in range(len(known)) if index not in memory][-(count - len(memory)) :])
    return [known[index] for index in sorted(memory)]
