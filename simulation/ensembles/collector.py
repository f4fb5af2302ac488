"""Gathers finished scenarios into a result; each takes about 1 kB, however long its run was."""

from array import array
from dataclasses import dataclass
from sys import intern

import numpy as np
from numpy.typing import NDArray

from dualwinch.simulation.ensembles.ensemble import Ensemble, Scenario
from dualwinch.simulation.ensembles.result import EnsembleResult, Traces

TRACED = ("e", "F1", "F2")
"""Columns whose traces are kept."""

SAMPLED = 2000
"""Scenarios whose traces are kept one by one (12 MB); of all others only their extremes."""


@dataclass(frozen=True)
class Finished:
    """One scenario after its run.

    Attributes:
        scenario: what was run.
        metrics: figure of merit → value.
        outcome, end_time: how it ended, and when in s.
        t: (rows,) times in s of the trace.
        trace: (columns of `TRACED`, rows) float32.
    """

    scenario: Scenario
    metrics: dict[str, float]
    outcome: str
    end_time: float
    t: NDArray[np.float64]
    trace: NDArray[np.float32]


class Collector:
    """Finished scenarios of an ensemble so far."""

    def __init__(self, ensemble: Ensemble) -> None:
        self.ensemble = ensemble
        self._draws: list[tuple] = []
        self._outcomes: list[str] = []
        self._end_times, self._metrics = array("d"), array("d")
        self._merits: tuple[str, ...] = ()
        self._count = 0
        self._t = np.empty(0)
        self._sampled: list[NDArray[np.float32]] = []
        self._lowest = self._highest = np.empty(0, np.float32)

    def __len__(self) -> int:
        return self._count

    def add(self, run: Finished) -> None:
        """Take a scenario in."""
        if run.outcome == "completed" and run.t.size:
            if not self._sampled:
                self._t, self._lowest, self._highest = run.t, run.trace, run.trace
            if len(self._sampled) < SAMPLED:
                self._sampled.append(run.trace)
            self._lowest = np.minimum(self._lowest, run.trace)
            self._highest = np.maximum(self._highest, run.trace)
        self._draws.append(tuple(run.scenario.draws.values()))
        self._outcomes.append(intern(run.outcome))
        self._end_times.append(run.end_time)
        self._merits = tuple(run.metrics)
        self._metrics.extend(run.metrics.values())
        self._count += 1

    def result(self, seed: int, asked: int) -> EnsembleResult:
        """The result of the scenarios taken in; of an interrupted `add` nothing is seen.

        Args:
            seed: of the draws.
            asked: number of scenarios asked for.
        """
        count = len(self)
        merits = np.array(self._metrics[: count * len(self._merits)]).reshape(count, -1).T
        draws = zip(*self._draws[:count], strict=True)
        return EnsembleResult(
            ensemble=self.ensemble,
            seed=seed,
            asked=asked,
            draws={key: np.array(values) for key, values in zip(self.ensemble.drawn_keys, draws, strict=True)},
            outcomes=tuple(self._outcomes[:count]),
            end_times=np.array(self._end_times[:count]),
            metrics=dict(zip(self._merits, merits, strict=True)),
            traces=self._traces() if self._sampled else None,
        )

    def _traces(self) -> Traces:
        sampled = np.array(self._sampled)
        return Traces(
            t=self._t,
            sampled={column: sampled[:, index] for index, column in enumerate(TRACED)},
            lowest={column: self._lowest[index] for index, column in enumerate(TRACED)},
            highest={column: self._highest[index] for index, column in enumerate(TRACED)},
        )
