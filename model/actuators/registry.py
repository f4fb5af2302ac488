"""The actuators that files and command lines know."""

from dualwinch.model.actuators.actuator import Actuator
from dualwinch.model.actuators.ideal import Ideal
from dualwinch.model.actuators.motor import Motor
from dualwinch.model.quantities.part import Registry

ACTUATORS: Registry[Actuator] = Registry("actuator", Ideal, Motor)
"""Every actuator by its kind."""
