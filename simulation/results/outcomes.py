"""Outcomes of runs: how and when each ended, with its figures of merit."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.drivers.outcome import Outcome

WORDS = {
    Outcome.COMPLETED: "completed",
    Outcome.DIVERGED: "diverged",
    Outcome.LEFT: "left_track",
    Outcome.GIVEN_UP: "went_slack",
    Outcome.RUNNING: "running",
    Outcome.NOT_RUN: "not_run",
}
"""Names of outcomes in results."""

_ALL_WORDS = np.array([WORDS[outcome] for outcome in Outcome])


def words_of(outcomes: NDArray[np.integer]) -> NDArray[np.str_]:
    """Names of outcomes (`WORDS`), for arrays of any shape."""
    return _ALL_WORDS[outcomes]


@dataclass(frozen=True, eq=False)
class RunOutcomes:
    """Outcomes and figures of merit of runs; all arrays have one shape, such as (scenarios,).

    Arrays of derived classes have this shape in their first axes.

    Attributes:
        outcomes: how each run ended, a word of `WORDS`.
        end_times: time in s at which each ended; NaN if it was not run.
        metrics: figure of merit → its values, as in `simulation.metrics.metrics.Metrics`; NaN for runs that were not
            completed.
    """

    outcomes: NDArray[np.str_]
    end_times: NDArray[np.float64]
    metrics: dict[str, NDArray[np.float64]]

    @property
    def completed(self) -> NDArray[np.bool_]:
        """Whether each run was completed."""
        return self.outcomes == WORDS[Outcome.COMPLETED]

    @property
    def outcome_counts(self) -> dict[str, int]:
        """Outcome → number of runs, the most frequent first."""
        return dict(Counter(self.outcomes.ravel().tolist()).most_common())

    def of_completed(self, metric: str) -> NDArray[np.float64]:
        """(completed,) values of a figure of merit in the completed runs, as others are not comparable."""
        return self.metrics[metric][self.completed]

    @property
    def _arrays(self) -> Mapping[str, NDArray[Any] | Mapping[str, NDArray[Any]]]:
        """Name → array, or dictionary of arrays, whose first axes are those of the runs."""
        return {"outcomes": self.outcomes, "end_times": self.end_times, "metrics": self.metrics}

    def take(self, indices: Any, axis: int = -1) -> Self:
        """Select runs by indices along an axis, like `numpy.take`."""
        positive_axis = axis % self.outcomes.ndim
        return self._changed(lambda values: values.take(indices, positive_axis))

    def reshape(self, shape: Sequence[int]) -> Self:
        """The same runs with another shape."""
        axes = self.outcomes.ndim
        return self._changed(lambda values: values.reshape((*shape, *values.shape[axes:])))

    def _changed(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Self:
        changed = {
            name: {key: change(values) for key, values in array.items()}
            if isinstance(array, Mapping)
            else change(array)
            for name, array in self._arrays.items()
        }
        return replace(self, **changed)

    def put(self, at: Any, part: "RunOutcomes") -> None:
        """Store a part of the runs, of the same class, at an index of these arrays."""
        for name, array in self._arrays.items():
            addition = getattr(part, name)
            if isinstance(array, Mapping):
                for key, values in array.items():
                    values[at] = addition[key]
            else:
                array[at] = addition


def not_run(shape: Sequence[int], metrics: Iterable[str]) -> RunOutcomes:
    """Empty results, of a shape, of runs that have not started; `metrics` are names of figures of merit."""
    return RunOutcomes(
        outcomes=np.full(shape, WORDS[Outcome.NOT_RUN], dtype=_ALL_WORDS.dtype),
        end_times=np.full(shape, np.nan),
        metrics={name: np.full(shape, np.nan) for name in metrics},
    )


def concatenated(parts: Sequence[RunOutcomes]) -> RunOutcomes:
    """Concatenate runs along their last axis, with the figures of merit of the first part."""
    return RunOutcomes(
        outcomes=np.concatenate([part.outcomes for part in parts], -1),
        end_times=np.concatenate([part.end_times for part in parts], -1),
        metrics={name: np.concatenate([part.metrics[name] for part in parts], -1) for name in parts[0].metrics},
    )
