"""First-order low-pass on the measured speed."""

from dataclasses import dataclass
from typing import Annotated

from model.quantity import Quantity
from model.scalar import Scalar


@dataclass(frozen=True)
class SpeedFilterState:
    """State of the filter."""

    v: Annotated[Scalar, Quantity("m/s", "filtered speed")] = 0.0


def filter_speed(state: SpeedFilterState, v: Scalar, filter_time: Scalar, sample_time: Scalar) -> SpeedFilterState:
    """Filtered speed in m/s; a filter time of 0 s passes the measured speed v in m/s on."""
    share = filter_time / (filter_time + sample_time)
    return SpeedFilterState(v + share * (state.v - v))
