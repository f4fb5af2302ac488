"""The coordinations that files and command lines know."""

from dualwinch.controllers.coordinations.coordination import Coordination
from dualwinch.controllers.coordinations.differential_tension import DifferentialTension
from dualwinch.controllers.coordinations.force_position import ForcePosition
from dualwinch.controllers.coordinations.master_slave import MasterSlave
from dualwinch.controllers.coordinations.scheduled_preload import ScheduledPreload
from dualwinch.model.quantities.part import Registry

COORDINATIONS: Registry[Coordination] = Registry(
    "coordination", DifferentialTension, ScheduledPreload, MasterSlave, ForcePosition
)
"""Every coordination by its kind."""
