"""The estimators that files and command lines know."""

from dualwinch.controllers.estimators.calibrating_kalman import CalibratingKalman
from dualwinch.controllers.estimators.estimator import Estimator
from dualwinch.controllers.estimators.kalman import Kalman
from dualwinch.controllers.estimators.low_pass import LowPass
from dualwinch.controllers.estimators.self_calibrating_kalman import SelfCalibratingKalman
from dualwinch.controllers.estimators.unfiltered import Unfiltered
from dualwinch.model.quantities.part import Registry

ESTIMATORS: Registry[Estimator] = Registry(
    "estimator", Unfiltered, LowPass, Kalman, CalibratingKalman, SelfCalibratingKalman
)
"""Every estimator by its kind."""
