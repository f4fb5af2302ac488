"""First-order low-pass on the measured speed."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from dualwinch.controllers.signals import Measurement, Seen
from dualwinch.model.plant import Plant
from dualwinch.model.quantity import Quantity
from dualwinch.model.scalar import Scalar

if TYPE_CHECKING:
    from dualwinch.controllers.controller import Controller


@dataclass(frozen=True)
class SpeedFilterState:
    """State of the filter."""

    v: Annotated[Scalar, Quantity("m/s", "filtered speed")] = 0.0


def filter_speed(state: SpeedFilterState, v: Scalar, filter_time: Scalar, sample_time: Scalar) -> SpeedFilterState:
    """Filtered speed in m/s; a filter time of 0 s passes the measured speed v in m/s on."""
    share = filter_time / (filter_time + sample_time)
    return SpeedFilterState(v + share * (state.v - v))


def speed_filter_step(
    state: SpeedFilterState, measurement: Measurement, controller: "Controller", _nominal: Plant, sample_time: Scalar
) -> tuple[SpeedFilterState, Seen]:
    """One sample: the measurement with the filtered speed in place of the measured one."""
    now = filter_speed(state, measurement.v, controller.speed_filter_time, sample_time)
    return now, Seen(**vars(measurement) | {"v": now.v})
