"""Which integrator solves an experiment."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.ropes import Rope, RopeLaw, Track
from dualwinch.model.scalar import Scalar
from dualwinch.model.winch import Winch
from dualwinch.simulation.experiment import IntegratorName
from dualwinch.simulation.integrators.problem import fastest_rate, swing_rate
from dualwinch.simulation.loop.structure import Solver, solver_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.settings import override
from tests.own_ropes import Bedding, Stiffening


@pytest.mark.parametrize("integrator", ["adaptive", "exponential", "rk4"])
def test_kelvin_voigt_ropes_take_the_integrator_that_is_asked_for(integrator: IntegratorName) -> None:
    asked = override(case(4), {"simulation.integrator": integrator, "simulation.substeps": 3})
    assert solver_of(asked) == Solver(integrator, 3)


@pytest.mark.parametrize("integrator", ["adaptive", "exponential", "rk4"])
def test_any_other_rope_takes_rk4(integrator: str) -> None:
    assert solver_of(override(case(4, rope=Stiffening()), {"simulation.integrator": integrator})).integrator == "rk4"
    mixed = override(case(4), {"simulation.integrator": integrator})
    assert solver_of(replace(mixed, plant=replace(mixed.plant, rope_2=Bedding()))).integrator == "rk4"


def test_its_sub_steps_keep_up_with_the_stiffest_spring() -> None:
    soft, stiff = case(4, rope=Stiffening()), case(4, rope=Stiffening(soft=4e8))
    assert solver_of(soft).substeps < solver_of(stiff).substeps
    assert solver_of(stiff).substeps & (solver_of(stiff).substeps - 1) == 0
    assert solver_of(override(stiff, {"simulation.substeps": 100})).substeps == 100
    assert (
        solver_of(override(stiff, {"controller.coordination.tension_max": 6e4})).substeps >= solver_of(stiff).substeps
    )


def test_the_fastest_swing_is_that_of_the_shortest_rope() -> None:
    rope, winch, track = Rope(damping=0.0), Winch(), Track()
    assert fastest_rate(rope, winch, track, (1000.0,)) == pytest.approx(swing_rate(rope, winch, track))
    overdamped = Rope(damping=1e6)
    decay = 0.8**2 / 1.8 * 1e6
    assert fastest_rate(overdamped, winch, track, (1000.0,)) == pytest.approx(decay, rel=0.01)


def test_a_rope_too_stiff_for_the_sample_time_is_an_error() -> None:
    with pytest.raises(ConfigurationError) as caught:
        prepare(case(4, rope=Stiffening(soft=1e12)))
    message = str(caught.value)
    assert message.startswith("simulation.sample_time = 0.001: must be <= ")
    assert 'for plant.rope_1.kind = "stiffening", which oscillates at ' in message


@dataclass(frozen=True)
class Weak(RopeLaw):
    """A rope that never pulls more than 3 kN."""

    kind: ClassVar = "weak"

    def tension(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar) -> Scalar:  # noqa: ARG002
        strain = stretch / length
        return 3000 * strain / (strain + 1e-3)


@dataclass(frozen=True)
class Backwards(RopeLaw):
    """A rope that pushes."""

    kind: ClassVar = "backwards"

    def tension(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar) -> Scalar:  # noqa: ARG002
        return -1e6 * stretch


@pytest.mark.parametrize("rope", [Weak(), Backwards()], ids=["weak", "backwards"])
def test_a_rope_that_cannot_hold_the_tensions_is_an_error(rope: Any) -> None:
    with pytest.raises(ConfigurationError) as caught:
        prepare(case(4, rope=rope))
    message = f"plant.rope_1: the tension of '{rope.kind}' must grow with the stretch, at 200 to 9000 N too"
    assert str(caught.value) == message
