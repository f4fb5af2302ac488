"""Users' own figures of merit in the closed loop: their states before, during and after a run, and their values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import is_array
from dualwinch.model.quantities.steps import over_symbols
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.scalar import Scalar
from dualwinch.simulation.metrics.metric import Metric
from dualwinch.simulation.rows import Sample

PREFIX = "metrics."
"""What the names of their states in a closed loop begin with."""

STEP = 6e-6
"""Change of a state, as a share of it, in a central difference: the cube root of round-off."""


@dataclass(frozen=True)
class Single:
    """A state that is no dataclass, as the one field of one."""

    value: Any


def states_before(metrics: Sequence[Metric]) -> dict[str, Scalar]:
    """Name → value of every state before the first sample."""
    return {key: value for metric in metrics for key, value in leaves(_start(metric), _prefix(metric)).items()}


def states_after(
    metrics: Sequence[Metric], states: Mapping[str, Scalar], sample: Sample, sample_time: Scalar
) -> dict[str, Scalar]:
    """Name → value of every state with one sample more.

    Args:
        metrics: with symbols for their numbers.
        states: name → symbol of (at least) every state.
        sample: what the sample offers.
        sample_time: in s.

    Raises:
        ConfigurationError: a metric gives a state of other elements than it was given.
    """
    found: dict[str, Scalar] = {}
    for metric in metrics:
        start = _start(metric)
        state = with_leaves(start, states, _prefix(metric))
        with over_symbols(f"metric '{metric.kind}': its step"):
            stepped = metric.step(_plain(state), sample, sample_time)
        following = _group(stepped, metric, "step")
        after = leaves(following, _prefix(metric))
        odd = leaves(start, _prefix(metric)).keys() ^ after.keys()
        if odd:
            names = ", ".join(sorted(name.removeprefix(_prefix(metric)) for name in odd))
            raise ConfigurationError(
                f"metric '{metric.kind}': its step must give a state of the elements it was given, not {names}"
            )
        found |= after
    return found


def values_of(metrics: Sequence[Metric], final: Mapping[str, Any], samples: Any) -> dict[str, Any]:
    """Name → figure of merit, NaN where there are no samples.

    Args:
        metrics: with numbers, or arrays of them that broadcast with the runs.
        final: name → number after the last sample of (at least) every state, or an array of many runs.
        samples: number of samples, or an array of those.

    Raises:
        ConfigurationError: a metric gives anything but a number for each run.
    """
    return {metric.table(): _value(metric, final, samples) for metric in metrics}


def slopes_of(
    metrics: Sequence[Metric], final: Mapping[str, float], tangents: Mapping[str, NDArray[np.float64]], samples: float
) -> dict[str, NDArray[np.float64]]:
    """Name → (directions,) derivatives of the figures of merit, by central differences of `Metric.value` alone.

    Args:
        metrics: with numbers.
        final: name → number of (at least) every state after the last sample.
        tangents: name → (directions,) exact derivatives of those.
        samples: number of samples.
    """
    found = {}
    for metric in metrics:
        names = list(leaves(_start(metric), _prefix(metric)))
        state = np.array([final[name] for name in names])
        sizes = STEP * np.where(state == 0, 1.0, np.abs(state))
        moved = np.concatenate([np.diag(sizes), -np.diag(sizes)]) + state
        ends = _value(metric, dict(zip(names, moved.T, strict=True)), np.full(len(moved), samples))
        with np.errstate(invalid="ignore"):
            by_state = (ends[: len(names)] - ends[len(names) :]) / (2 * sizes)
            found[metric.table()] = by_state @ np.array([tangents[name] for name in names])
    return found


def _value(metric: Metric, final: Mapping[str, Any], samples: Any) -> Any:
    state = _plain(
        with_leaves(_start(metric), {name: np.float64(value) for name, value in final.items()}, _prefix(metric))
    )
    with np.errstate(all="ignore"):  # of runs that ended early
        value = np.asarray(metric.value(state, np.float64(samples)))
    if value.dtype.kind not in "bif" or np.broadcast_shapes(value.shape, np.shape(samples)) != np.shape(samples):
        raise ConfigurationError(
            f"metric '{metric.kind}': its value must be a number for each run, shape {np.shape(samples)}, "
            f"not {value.dtype} of shape {value.shape}"
        )
    measured = np.where(np.asarray(samples) > 0, value, np.nan)
    return measured if np.ndim(samples) else float(measured)


def _start(metric: Metric) -> Any:
    return _group(metric.initial_state(), metric, "initial_state")


def _prefix(metric: Metric) -> str:
    return f"{PREFIX}{metric.table()}."


def _group(state: Any, metric: Metric, method: str) -> Any:
    """A state as a dataclass."""
    if is_dataclass(state) and not isinstance(state, type):
        return state
    if isinstance(state, (int, float, np.number, np.ndarray)) or is_array(state) or hasattr(state, "is_scalar"):
        return Single(state)
    raise ConfigurationError(
        f"metric '{metric.kind}': {method} must give a number, an array or a dataclass of them, "
        f"not {type(state).__name__}"
    )


def _plain(state: Any) -> Any:
    """A state as the metric gave it."""
    return state.value if isinstance(state, Single) else state
