"""The rope laws that files and command lines know."""

from dualwinch.model.quantities.part import Registry
from dualwinch.model.ropes.kelvin_voigt import Rope
from dualwinch.model.ropes.rope_law import RopeLaw

ROPES: Registry[RopeLaw] = Registry("rope", Rope)
"""Every rope law by its kind."""
