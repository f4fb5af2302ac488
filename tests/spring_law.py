"""A law of a user's own, as the text of a file that they would write."""

SPRING = """
from dataclasses import dataclass
from typing import Annotated, ClassVar

import annotated_types as at
import dualwinch as dw
from dualwinch.model.scalar import clip


@dataclass(frozen=True)
class Memory:
    e: Annotated[float, dw.Quantity("m", "tracking error of the last sample")] = 0.0


@dataclass(frozen=True)
class SpringOutput(dw.PositionOutput):
    stretch: Annotated[float, dw.Quantity("m", "stretch of the spring")]


@dataclass(frozen=True)
class Spring(dw.PositionLaw):
    stiffness: Annotated[float, at.Gt(0), dw.Quantity("N/m", "force a metre", "by hand"), dw.Tunable(10, 1e5)] = 5e3
    damping: Annotated[float, at.Ge(0), dw.Quantity("N s/m", "force at 1 m/s")] = 2e4
    kind: ClassVar = "spring"
    label: ClassVar = "spring and damper"
    colour: ClassVar = "#CC79A7"

    def initial_state(self):
        return Memory()

    def step(self, state, estimate, setpoint, context):
        e1, e2 = estimate.x - setpoint.x, estimate.v - setpoint.v
        u = -self.stiffness * e1 - self.damping * e2
        u_sat = clip(u, -context.limits.force, context.limits.force)
        return Memory(e1), SpringOutput(u=u, u_sat=u_sat, stretch=e1)
"""


def changed(*pairs: tuple[str, str]) -> str:
    """The text with some words written otherwise."""
    text = SPRING
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    return text
