"""The position laws that files and command lines know."""

from dualwinch.controllers.laws.adrc import Adrc
from dualwinch.controllers.laws.equivalent_input_disturbance import Eid
from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.laws.lqi import Lqi
from dualwinch.controllers.laws.nftsm import Nftsm
from dualwinch.controllers.laws.pid_cascade import PidCascade
from dualwinch.controllers.laws.position_law import PositionLaw
from dualwinch.controllers.laws.predictive.mpc import Mpc
from dualwinch.controllers.laws.rbf_sliding_mode import RbfSlidingMode
from dualwinch.controllers.laws.super_twisting import SuperTwisting
from dualwinch.model.quantities.part import Registry

POSITION_LAWS: Registry[PositionLaw] = Registry(
    "position law", FandoNftsm, Nftsm, PidCascade, SuperTwisting, Adrc, Lqi, Eid, RbfSlidingMode, Mpc
)
"""Every position law by its kind."""
