"""User-defined figures of merit: base class, and their states and values in the closed loop."""

import math
import sys
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.figures import FigureColumn
from dualwinch.model.quantities.part import Part
from dualwinch.model.quantities.quantity import Quantity, is_array
from dualwinch.model.quantities.steps import over_symbols
from dualwinch.model.quantities.tables import readable_unit
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.scalar import Scalar
from dualwinch.simulation.rows import Sample


@dataclass(frozen=True)
class MetricQuantity(Quantity):
    """Metadata of a figure of merit, with its display unit.

    Attributes:
        label: name in tables and figures.
        formula: in LaTeX.
        display: display unit (empty: its own unit), factor from its unit to the display unit, and number format.
        small_is_bad: whether the worst of many runs is the smallest value.
        abbreviated: whether its name is an abbreviation, written in capitals in sentences.
        lower, upper: bounds of its values.
    """

    label: str = ""
    formula: str = ""
    display: tuple[str, float, str] = ("", 1.0, ".4g")
    small_is_bad: bool = False
    abbreviated: bool = False
    lower: float = -math.inf
    upper: float = math.inf

    @property
    def shown_unit(self) -> str:
        """Display unit; empty for a pure number."""
        return self.display[0] or readable_unit(self.unit)

    @property
    def scale(self) -> float:
        """Factor from its unit to the display unit."""
        return self.display[1]

    @property
    def axis(self) -> str:
        """Label of an axis: name and unit."""
        return f"{self.label} ({self.shown_unit})" if self.shown_unit else self.label

    def column(self, name: str, heading: str = "", form: str = "") -> FigureColumn:
        """The column of this figure of merit, printed in the display unit; heading and form default to its own."""
        _, factor, own_form = self.display
        words, form = heading or self.label, form or own_form
        return FigureColumn(name, self.unit, words, factor, form, shown_unit=self.shown_unit, meaning=self.meaning)

    def text(self, value: float) -> str:
        """A value for a table, in the display unit; a dash for NaN."""
        return "–" if math.isnan(value) else f"{self.scale * value:{self.display[2]}}"


class Metric(Part):
    """Base class of user-defined figures of merit: a frozen dataclass of parameters, accumulated at every sample.

    It is compiled together with the loop. Its name in results is its kind with underscores:
    ``settling-time`` is ``result.metrics.settling_time`` and, over scenarios, ``mean.settling_time``.

    Attributes:
        quantity: unit and meaning.
        small_is_bad: whether the worst of many runs is the smallest value.
    """

    quantity: ClassVar[Quantity]
    small_is_bad: ClassVar[bool] = False

    @abstractmethod
    def initial_state(self) -> Any:
        """The state before the first sample: a number, an array, or a dataclass of these."""

    @abstractmethod
    def step(self, state: Any, sample: Sample, sample_time: Scalar) -> Any:
        """The state after one more sample, over scalars (`model.scalar`).

        Args:
            state: structured like that of `initial_state`.
            sample: its signals.
            sample_time: in s.

        Returns:
            A state with the same elements.
        """

    def value(self, state: Any, samples: Any) -> Any:  # noqa: ARG002
        """The figure of merit of a whole run; by default the state itself, if it is one number.

        Args:
            state: after the last sample. Its elements are NumPy numbers, or arrays over many runs: use NumPy here.
            samples: number of samples, or an array of them.

        Returns:
            A number, or an array of the same shape.
        """
        return state


PREFIX = "metrics."
"""Prefix of their states in a closed loop."""

STEP = sys.float_info.epsilon ** (1 / 3)
"""Relative step of central differences: the cube root of round-off."""


@dataclass(frozen=True)
class Single:
    """Dataclass with a single field, for a state that is no dataclass."""

    value: Any


def states_before(metrics: Sequence[Metric]) -> dict[str, Scalar]:
    """Initial states by name."""
    return {key: value for metric in metrics for key, value in leaves(_start(metric), _prefix(metric)).items()}


def states_after(
    metrics: Sequence[Metric], states: Mapping[str, Scalar], sample: Sample, sample_time: Scalar
) -> dict[str, Scalar]:
    """States after one more sample, by name, of metrics with symbols for their numbers; sample time in s.

    Raises:
        ConfigurationError: a metric returns a state with other elements.
    """
    values: dict[str, Scalar] = {}
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
        values |= after
    return values


def values_of(metrics: Sequence[Metric], final: Mapping[str, Any], samples: Any) -> dict[str, Any]:
    """Figures of merit by name; NaN without samples.

    Numbers of the metrics, final values of (at least) every state and the number of samples may be arrays over many
    runs.

    Raises:
        ConfigurationError: a metric does not return one number per run.
    """
    return {metric.table(): _value(metric, final, samples) for metric in metrics}


def slopes_of(
    metrics: Sequence[Metric], final: Mapping[str, float], tangents: Mapping[str, NDArray[np.float64]], samples: float
) -> dict[str, NDArray[np.float64]]:
    """(directions,) derivatives of the figures of merit by name, with central differences of only `Metric.value`.

    `final` has the final value of (at least) every state, `tangents` its exact derivatives (directions,).
    """
    rows = {}
    for metric in metrics:
        names = list(leaves(_start(metric), _prefix(metric)))
        state = np.array([final[name] for name in names])
        sizes = STEP * np.where(state == 0, 1.0, np.abs(state))
        neighbours = np.concatenate([np.diag(sizes), -np.diag(sizes)]) + state
        ends = _value(metric, dict(zip(names, neighbours.T, strict=True)), np.full(len(neighbours), samples))
        with np.errstate(invalid="ignore"):
            by_state = (ends[: len(names)] - ends[len(names) :]) / (2 * sizes)
            rows[metric.table()] = by_state @ np.array([tangents[name] for name in names])
    return rows


def _value(metric: Metric, final: Mapping[str, Any], samples: Any) -> Any:
    state = _plain(
        with_leaves(_start(metric), {name: np.float64(value) for name, value in final.items()}, _prefix(metric))
    )
    with np.errstate(all="ignore"):  # runs that ended early
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
    """A state in the metric's own form."""
    return state.value if isinstance(state, Single) else state
