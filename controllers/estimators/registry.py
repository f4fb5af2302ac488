"""What stands between the sensors and the position law: nothing, a low-pass, or one of two Kalman filters."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dualwinch.controllers.estimators.calibrating_kalman import CalibratingState, calibrating_kalman_step
from dualwinch.controllers.estimators.kalman import KalmanState, kalman_step
from dualwinch.controllers.estimators.low_pass import SpeedFilterState, speed_filter_step
from dualwinch.controllers.signals import Measurement, Seen


@dataclass(frozen=True)
class Unfiltered:
    """State of no estimator."""


def pass_on(state: Unfiltered, measurement: Measurement, *_: Any) -> tuple[Unfiltered, Seen]:
    """The measurement as it is."""
    return state, Seen(**vars(measurement))


@dataclass(frozen=True)
class Estimator:
    """An estimator: its initial state and one sample, ``(state, measurement, ...) -> (state, Seen)``."""

    initial_state: Any
    step: Callable[..., tuple[Any, Seen]]


ESTIMATORS = {
    "none": Estimator(Unfiltered(), pass_on),
    "lowpass": Estimator(SpeedFilterState(), speed_filter_step),
    "kalman": Estimator(KalmanState(), kalman_step),
    "calibrating-kalman": Estimator(CalibratingState(), calibrating_kalman_step),
}
"""Every estimator by its name; a new one is a new file and one line here."""
