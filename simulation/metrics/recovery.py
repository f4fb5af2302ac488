"""Recovery from overloads: how long a run stays off its reference."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from dualwinch.model.quantities.part import Registry
from dualwinch.model.quantities.quantity import Positive, Quantity
from dualwinch.model.scalar import Scalar, absolute, maximum, where
from dualwinch.simulation.metrics.metric import Metric, MetricQuantity
from dualwinch.simulation.rows import Sample


@dataclass(frozen=True)
class Excursion:
    """Times that a run stays off its reference."""

    current: Annotated[Scalar, Quantity("s", "time since the error was last within the tolerance")] = 0.0
    longest: Annotated[Scalar, Quantity("s", "longest such time until now")] = 0.0


@dataclass(frozen=True)
class Recovery(Metric):
    """Longest time during which the tracking error stays beyond a tolerance: that of the worst overload of a run.

    The time of the overload itself is included. Peak tension, smallest tension and slack of the recovery are figures of
    merit of every run.
    """

    tolerance: Annotated[
        Positive, Quantity("m", "tracking error beyond which the vehicle is off its reference", "assumption")
    ] = 5e-3

    kind: ClassVar = "recovery"
    quantity: ClassVar = MetricQuantity(
        "s", "longest time during which |e| stays beyond the tolerance", label="recovery", lower=0.0
    )

    def initial_state(self) -> Excursion:
        """On the reference."""
        return Excursion()

    def step(self, state: Excursion, sample: Sample, sample_time: Scalar) -> Excursion:
        """Time goes on while the error is beyond the tolerance."""
        current = where(absolute(sample.error) > self.tolerance, state.current + sample_time, 0.0)
        return Excursion(current, maximum(state.longest, current))

    def value(self, state: Excursion, samples: object) -> Scalar:  # noqa: ARG002
        """The longest time in s."""
        return state.longest


METRICS: Registry[Metric] = Registry("metric", Recovery)
"""Figures of merit that files and command lines accept by kind; those of `Metrics` are always available."""
