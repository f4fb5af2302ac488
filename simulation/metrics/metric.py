"""Base of figures of merit that users add to the built-in ones, and what a figure of merit is."""

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from dualwinch.model.quantities.part import Part, Registry
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.quantities.tables import readable_unit
from dualwinch.model.scalar import Scalar
from dualwinch.simulation.rows import Sample


@dataclass(frozen=True)
class MetricQuantity(Quantity):
    """What a figure of merit is, and how people read it.

    Attributes:
        label: its name in tables and figures.
        formula: in LaTeX.
        shown: the unit that people read it in (default: its own), how many of those are one of its own, and the
            format of a number in that unit.
        small_is_bad: whether its bad end, and so what is the worst of many runs, is the smallest.
    """

    label: str = ""
    formula: str = ""
    shown: tuple[str, float, str] = ("", 1.0, ".4g")
    small_is_bad: bool = False

    @property
    def shown_unit(self) -> str:
        """The unit that people read it in; nothing for a pure number."""
        return self.shown[0] or readable_unit(self.unit)

    @property
    def scale(self) -> float:
        """Factor from its own unit to that."""
        return self.shown[1]

    @property
    def axis(self) -> str:
        """Label and unit, as on an axis."""
        return f"{self.label} ({self.shown_unit})" if self.shown_unit else self.label

    def text(self, value: float, form: str = "") -> str:
        """A value as a table shows it, without its unit; a dash where there was nothing to measure."""
        return "–" if math.isnan(value) else f"{self.scale * value:{form or self.shown[2]}}"


class Metric(Part):
    """A figure of merit of your own: a frozen dataclass of its numbers, summed up at every sample of a run.

    It is compiled together with the loop. Its name among the others is its kind as it is written in a key:
    ``settling-time`` is ``result.metrics.settling_time`` and, over scenarios, ``mean.settling_time``.

    Attributes:
        quantity: unit and meaning.
        small_is_bad: whether its bad end, and so what is the worst of many runs, is the smallest.
    """

    quantity: ClassVar[Quantity]
    small_is_bad: ClassVar[bool] = False

    @abstractmethod
    def initial_state(self) -> Any:
        """What is known before the first sample: a number, an array or a dataclass of them."""

    @abstractmethod
    def step(self, state: Any, sample: Sample, sample_time: Scalar) -> Any:
        """The state with one sample more, over scalars (`model.scalar`).

        Args:
            state: as `initial_state` gives it.
            sample: what the sample offers.
            sample_time: in s.

        Returns:
            A state of the same elements.
        """

    def value(self, state: Any, samples: Any) -> Any:  # noqa: ARG002
        """The figure of merit of a whole run; by default the state itself, where that is one number.

        Args:
            state: after the last sample. Its numbers are NumPy's, or arrays of many runs: use NumPy here.
            samples: number of samples, or an array of those.

        Returns:
            A number, or an array of the same shape.
        """
        return state


METRICS: Registry[Metric] = Registry("metric", base=Metric)
"""Every figure of merit that is a part, by its kind; the built-in ones are always there (`Metrics`)."""
