"""Operations of a sample: counted where they are, and not where they are worked out beforehand."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.parts import Context, Estimate, PositionLaw, PositionOutput
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import exp
from dualwinch.simulation.experiment import Experiment
from dualwinch.toolboxes.race.race import operations


@dataclass(frozen=True)
class Nothing:
    """No state."""


@dataclass(frozen=True)
class Proportional(PositionLaw):
    gain: Annotated[float, Quantity("N/m", "gain", "by hand")] = 3.0
    further: ClassVar[bool] = False
    kind: ClassVar = "proportional"

    def initial_state(self) -> Nothing:
        return Nothing()

    def step(
        self, state: Nothing, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[Nothing, PositionOutput]:
        beforehand = exp(-self.gain * context.sample_time) * context.nominal.vehicle.mass
        u = beforehand * (setpoint.x - estimate.x)
        if self.further:
            u = u + exp(setpoint.v)
        return state, PositionOutput(u, u)


class Further(Proportional):
    further = True
    kind = "further"


def of(law: PositionLaw) -> int:
    return operations(replace(Experiment(), controller=Controller(law=law)))


def test_an_exponential_and_a_sum_are_two_operations() -> None:
    assert of(Further()) == of(Proportional()) + 2


def test_what_follows_from_gains_alone_is_not_counted() -> None:
    filtered = replace(Experiment(), controller=Controller())
    assert operations(filtered) < 400, "a Kalman filter's gains would be thousands"
    assert of(Proportional(5.0)) == of(Proportional())
