"""First-order low-pass on the measured speed."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from dualwinch.controllers.parts import Context, Estimate, Estimator, Measurement
from dualwinch.model.quantities.quantity import Key, Mark, NonNegative, Quantity, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class SpeedFilterState:
    """State of the filter."""

    v: Annotated[Scalar, Quantity("m/s", "filtered speed"), Mark.SPEED] = 0.0


def filter_speed(state: SpeedFilterState, v: Scalar, filter_time: Scalar, sample_time: Scalar) -> SpeedFilterState:
    """Filtered speed from the measured speed v in m/s; unfiltered for a filter time of 0 s."""
    share = filter_time / (filter_time + sample_time)
    return SpeedFilterState(v + share * (state.v - v))


@dataclass(frozen=True)
class LowPass(Estimator):
    """The measurement with the filtered speed in place of the measured one."""

    speed_filter_time: Annotated[
        NonNegative,
        Quantity("s", "time constant of the low-pass on the measured speed; 0: none", "assumption"),
        Tunable(0, 0.1, log=False),
        Key("speed_filter_time"),
        Mark.OFF_AT_ZERO,
    ] = 0.0

    kind: ClassVar = "lowpass"
    label: ClassVar = "low-pass"

    def initial_state(self) -> SpeedFilterState:
        """At rest."""
        return SpeedFilterState()

    def step(
        self, state: SpeedFilterState, measurement: Measurement, setpoint: Setpoint, context: Context
    ) -> tuple[SpeedFilterState, Estimate]:
        """One sample of the filter."""
        now = filter_speed(state, measurement.v, self.speed_filter_time, context.sample_time)
        return now, Estimate(**vars(measurement) | {"v": now.v})
