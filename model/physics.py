"""The equations of the machine, part by part, for models that are composed of them.

Each is written over scalars that are floats or CasADi symbols (`dualwinch.model.scalar`).
"""

# ruff: noqa: F401

from dualwinch.model.actuators import ACTUATORS, Motor, drive
from dualwinch.model.disturbance import Disturbance, vortex_frequency
from dualwinch.model.heavy_ropes import span_of, transverse_mass
from dualwinch.model.linear.operating_point import steady_motion
from dualwinch.model.plant import Plant, Torques, holding_torques, shaft_torques, tensions
from dualwinch.model.ropes import crept, rope_lengths
from dualwinch.model.vehicle import Vehicle, bent_bristles, drag, friction
from dualwinch.model.winch import winding
