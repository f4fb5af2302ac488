"""A law and a coordination that look ahead, as users write them."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import annotated_types as at

from dualwinch.controllers.coordinations.differential_tension import DifferentialTension, TensionLoops
from dualwinch.controllers.laws.adrc import Adrc
from dualwinch.controllers.laws.extended_state_observer import ExtendedState, ObserverOutput
from dualwinch.controllers.parts import Context, CoordinationOutput, Estimate
from dualwinch.model.quantities.quantity import Mark, Quantity, Tunable
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar


@dataclass(frozen=True)
class Foreseen(ObserverOutput):
    """Beside the force, what was seen."""

    x_soon: Annotated[Scalar, Quantity("m", "reference position ahead")] = 0.0
    v_soon: Annotated[Scalar, Quantity("m/s", "reference speed ahead")] = 0.0
    a_soon: Annotated[Scalar, Quantity("m/s^2", "reference acceleration ahead")] = 0.0


@dataclass(frozen=True)
class Foresight(Adrc):
    """ADRC with some of the acceleration ahead."""

    soon: Annotated[float, at.Gt(0), Quantity("s", "time ahead"), Mark.SHAPES_CODE] = 0.25
    share: Annotated[float, at.Ge(0), Quantity("1", "share of the acceleration ahead"), Tunable(0.01, 1)] = 0.5

    kind: ClassVar = "foresight"

    @property
    def preview(self) -> tuple[float, ...]:
        return (2 * self.soon, self.soon)

    def step(
        self, state: ExtendedState, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[ExtendedState, Foreseen]:
        point = setpoint.ahead(self.soon)
        blended = Setpoint(setpoint.x, setpoint.v, setpoint.a + self.share * (point.a - setpoint.a))
        following, output = super().step(state, estimate, blended, context)
        return following, Foreseen(**vars(output), x_soon=point.x, v_soon=point.v, a_soon=point.a)


@dataclass(frozen=True)
class ForeseenTensions(CoordinationOutput):
    """Beside the torques, what was seen."""

    v_then: Annotated[Scalar, Quantity("m/s", "reference speed a second ahead")] = 0.0


@dataclass(frozen=True)
class ForesightfulTension(DifferentialTension):
    """Shows the speed of the reference a second ahead."""

    kind: ClassVar = "foresightful-tension"

    @property
    def preview(self) -> tuple[float, ...]:
        return (1.0,)

    def step(
        self, state: TensionLoops, force: Scalar, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[TensionLoops, ForeseenTensions]:
        following, output = super().step(state, force, estimate, setpoint, context)
        return following, ForeseenTensions(**vars(output), v_then=setpoint.ahead(1.0).v)
