"""A user's observer whose state is one vector: told what its elements are, it starts where the vehicle is."""

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import annotated_types as at
import casadi as ca
import numpy as np
import pytest

from dualwinch.analysis.linear_loop import linear_closed_loop
from dualwinch.analysis.operating_points import loop_operating_point
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.nominal import nominal_forces
from dualwinch.controllers.parts import Context, Estimate, Estimator, Measurement
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Elements, Mark, Quantity
from dualwinch.model.reference import Setpoint
from dualwinch.simulation.experiment import Experiment

POSITION, SPEED = Quantity("m", "expected position"), Quantity("m/s", "expected speed")
DRIFT = Quantity("m/s^2", "expected disturbance")


@dataclass(frozen=True)
class Expected:
    z: Annotated[Any, Elements((POSITION, Mark.POSITION), (SPEED, Mark.SPEED), DRIFT)] = field(
        default_factory=lambda: np.zeros(3)
    )


@dataclass(frozen=True)
class Unmarked:
    z: Annotated[Any, Quantity("m", "position, speed and disturbance")] = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Observed(Estimate):
    z: Annotated[Any, Elements(POSITION, SPEED, DRIFT)] = 0.0


@dataclass(frozen=True)
class Observer(Estimator):
    """Luenberger's observer of position, speed and disturbance, driven by the tensions."""

    bandwidth: Annotated[float, at.Gt(0), Quantity("rad/s", "its poles")] = 20.0

    kind: ClassVar = "observer-of-a-vector"
    state: ClassVar = Expected

    def initial_state(self) -> Any:
        return self.state()

    def step(
        self,
        state: Any,
        measurement: Measurement,
        setpoint: Setpoint,  # noqa: ARG002
        context: Context,
    ) -> tuple[Any, Observed]:
        T, w, z = context.sample_time, self.bandwidth, state.z
        forces = nominal_forces(z[1], 0.0, context.nominal)
        a = (measurement.F1 - measurement.F2 - forces.resistance) / forces.mass + z[2]
        e = measurement.x - z[0]
        following = [z[0] + T * (z[1] + 3 * w * e), z[1] + T * (a + 3 * w**2 * e), z[2] + T * w**3 * e]
        better = vars(measurement) | {"x": z[0], "v": z[1], "z": ca.vertcat(z[0], z[1], z[2])}
        return type(state)(ca.vertcat(*following)), Observed(**better)


@dataclass(frozen=True)
class Guessing(Observer):
    """The same, which does not say what its elements are."""

    kind: ClassVar = "guessing"
    state: ClassVar = Unmarked


def experiment(estimator: Estimator) -> Experiment:
    return Experiment(controller=Controller(estimator=estimator))


@pytest.mark.parametrize("v", [0.0, 0.5, -1.2])
def test_the_cruise_is_found_from_where_the_vehicle_is(v: float) -> None:
    cruise = loop_operating_point(experiment(Observer()), 25.0, v)
    z = [cruise.state[cruise.loop.states.index(f"controller.estimator.z.{index}")] for index in range(3)]
    assert z == pytest.approx([25.0, v, 0.0], abs=1e-3)
    assert cruise.row["z.0"] == pytest.approx(25.0, abs=1e-3)


def test_without_marks_a_vector_that_moves_on_repeats_nowhere() -> None:
    with pytest.raises(ConfigurationError, match="reaches no steady motion"):
        loop_operating_point(experiment(Guessing()), 25.0, 0.5)


def test_every_element_has_its_own_unit_wherever_it_goes() -> None:
    linear = linear_closed_loop(experiment(Observer()), 25.0, 0.5)
    assert [linear.units[f"estimator.z.{index}"] for index in range(3)] == ["m", "m/s", "m/s^2"]
    assert [linear.units[f"z.{index}"] for index in range(3)] == ["m", "m/s", "m/s^2"]
    assert np.abs(np.linalg.eigvals(linear.A)).max() < 1 + 1e-9
