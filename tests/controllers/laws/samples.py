"""One sample of a position law by itself, for tests that work it out by hand."""

from typing import Any

from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, Estimate, PositionLaw
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Setpoint
from dualwinch.model.vehicle import Vehicle

T, STILL = 1e-3, Setpoint(0.0, 0.0, 0.0)
SMOOTH = Plant(vehicle=Vehicle(drag_coefficient=0.0, friction_coefficient=0.0))
"""A vehicle that only has its mass."""


def step(
    law: PositionLaw, state: Any, x: float, v: float = 0.0, setpoint: Setpoint = STILL, plant: Plant = SMOOTH
) -> tuple[Any, Any]:
    """State after a sample and output, at half the preload in both ropes."""
    estimate = Estimate(x, v, 1e3, 1e3, 0.0, 0.0, 0.0, 0.0)
    return law.step(state, estimate, setpoint, Context(plant, Limits(), T))
