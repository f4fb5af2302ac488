"""Registries of the parts of controllers, by their kinds in files and on command lines."""

from dualwinch.controllers.coordinations.differential_tension import DifferentialTension
from dualwinch.controllers.coordinations.force_position import ForcePosition
from dualwinch.controllers.coordinations.master_slave import MasterSlave
from dualwinch.controllers.coordinations.proportional_tension import ProportionalTension
from dualwinch.controllers.coordinations.scheduled_preload import ScheduledPreload
from dualwinch.controllers.estimators.calibrating_kalman import CalibratingKalman
from dualwinch.controllers.estimators.kalman import Kalman
from dualwinch.controllers.estimators.low_pass import LowPass
from dualwinch.controllers.estimators.self_calibrating_kalman import SelfCalibratingKalman
from dualwinch.controllers.estimators.unfiltered import Unfiltered
from dualwinch.controllers.laws.adrc import Adrc
from dualwinch.controllers.laws.equivalent_input_disturbance import Eid
from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.laws.lqi import Lqi
from dualwinch.controllers.laws.nftsm import Nftsm
from dualwinch.controllers.laws.pid_cascade import PidCascade
from dualwinch.controllers.laws.predictive.mpc import Mpc
from dualwinch.controllers.laws.rbf_sliding_mode import RbfSlidingMode
from dualwinch.controllers.laws.super_twisting import SuperTwisting
from dualwinch.controllers.parts import Coordination, Estimator, PositionLaw
from dualwinch.model.quantities.part import Registry

POSITION_LAWS: Registry[PositionLaw] = Registry(
    "position law", FandoNftsm, Nftsm, PidCascade, SuperTwisting, Adrc, Lqi, Eid, RbfSlidingMode, Mpc
)

ESTIMATORS: Registry[Estimator] = Registry(
    "estimator", Unfiltered, LowPass, Kalman, CalibratingKalman, SelfCalibratingKalman
)

COORDINATIONS: Registry[Coordination] = Registry(
    "coordination", DifferentialTension, ProportionalTension, ScheduledPreload, MasterSlave, ForcePosition
)
