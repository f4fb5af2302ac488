"""The whole controller: on floats, as a CasADi function, and against the independent laws over a random run."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pytest

from dualwinch.controllers.controller import (
    Controller,
    ControllerOutput,
    controller_function,
    controller_step,
    initial_controller_state,
    own_signals,
)
from dualwinch.controllers.coordinations.differential_tension import DifferentialTension
from dualwinch.controllers.coordinations.winch_pid import WinchGains
from dualwinch.controllers.laws.adrc import Adrc
from dualwinch.controllers.laws.auxiliary import AuxiliaryGains
from dualwinch.controllers.laws.equivalent_input_disturbance import Eid
from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.laws.lqi import Lqi
from dualwinch.controllers.laws.nftsm import Nftsm
from dualwinch.controllers.laws.observer import ObserverGains
from dualwinch.controllers.laws.pid_cascade import PidCascade
from dualwinch.controllers.laws.predictive.mpc import Mpc
from dualwinch.controllers.laws.rbf_sliding_mode import RbfSlidingMode
from dualwinch.controllers.laws.super_twisting import SuperTwisting
from dualwinch.controllers.nominal import Nominal, nominal_plant
from dualwinch.controllers.parts import (
    CoordinationOutput,
    Estimate,
    Measurement,
    PositionLaw,
    PositionOutput,
)
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar
from tests.oracle.laws import LAWS, Measured, WinchPid, tension_commands
from tests.oracle.values import DEFAULTS
from tests.tiers import each_choice

SAMPLE_TIME = 1e-3
AUXILIARY = AuxiliaryGains(gamma=2e-5, gamma_force=0.05, k_a=3.0)
TUNED: tuple[PositionLaw, ...] = (
    FandoNftsm(observer=ObserverGains(l0=3.0, kf=8.0, filter_time=0.05), auxiliary=AUXILIARY),
    Nftsm(auxiliary=AUXILIARY),
    PidCascade(kd1=0.4, kd2=0.02),
    SuperTwisting(auxiliary=AUXILIARY),
    Adrc(),
    Lqi(),
    Eid(),
    RbfSlidingMode(),
    Mpc(),
)
CONTROLLERS = {
    law.kind: Controller(
        law=law,
        coordination=DifferentialTension(winch_1=WinchGains(kd=1e-6), winch_2=WinchGains(kp=1e-3, ki=0.05)),
        nominal=Nominal(mass=1.2e4, drag_coefficient=0.35, friction_coefficient=0.13),
    )
    for law in TUNED
}
VALUES = {
    **DEFAULTS,
    "controller.nominal.mass": 1.2e4,
    "controller.nominal.drag_coefficient": 0.35,
    "controller.nominal.friction_coefficient": 0.13,
    "controller.auxiliary.gamma": 2e-5,
    "controller.auxiliary.gamma_force": 0.05,
    "controller.auxiliary.k_a": 3.0,
    "controller.observer.l0": 3.0,
    "controller.observer.kf": 8.0,
    "controller.observer.filter_time": 0.05,
    "controller.pid_cascade.kd1": 0.4,
    "controller.pid_cascade.kd2": 0.02,
    "controller.winch_1.kd": 1e-6,
    "controller.winch_2.kp": 1e-3,
    "controller.winch_2.ki": 0.05,
}
NOMINAL = nominal_plant(Nominal(1.2e4, 0.35, 0.13), Plant())


def random_samples(count: int) -> list[tuple[Measurement, Setpoint]]:
    """A wandering run that saturates now and then."""
    draws = np.random.default_rng(7)
    t = SAMPLE_TIME * np.arange(count)
    e1 = 0.3 * np.sin(20 * t) + 1e-4 * draws.standard_normal(count)
    e2 = 0.4 * np.cos(20 * t + 1) + 1e-3 * draws.standard_normal(count)
    tensions = 3000 + 2500 * np.sin(np.outer((31, 43), t)) + 20 * draws.standard_normal((2, count))
    a = 0.2 * np.sin(5 * t)
    return [
        (
            Measurement(2 + e1[k], 1.2 + e2[k], tensions[0, k], tensions[1, k], 0.0, 0.0, 0.0, 0.0),
            Setpoint(2.0, 1.2, a[k]),
        )
        for k in range(count)
    ]


def ahead(point: Setpoint, controller: Controller) -> list[np.ndarray]:
    """The input of a controller that looks ahead, where it does: the setpoint goes on as it is."""
    columns = [list(leaves(point.ahead(time)).values()) for time in controller.preview]
    return [np.array(columns).T] if columns else []


@pytest.mark.parametrize("kind", LAWS)
def test_every_sample_equals_the_independent_laws(kind: str) -> None:
    controller = CONTROLLERS[kind]
    state = initial_controller_state(controller)
    law, winch_1, winch_2 = LAWS[kind](VALUES), WinchPid(VALUES, 1), WinchPid(VALUES, 2)
    saturated = 0
    for measured, point in random_samples(400):
        state, ours = controller_step(state, measured, point, controller, NOMINAL, SAMPLE_TIME)
        theirs = law.step(Measured(measured.x, measured.v, measured.F1, measured.F2, point.x, point.v, point.a))
        commands = tension_commands(theirs.u_sat, 2000.0, 200.0, 6000.0)
        torques = (
            winch_1.step(commands[0], measured.F1, point.a / 0.8),
            winch_2.step(commands[1], measured.F2, -point.a / 0.8),
        )
        expected = {key: value for key, value in vars(theirs).items() if not np.isnan(value)}
        assert leaves(ours.position) == pytest.approx(expected, rel=1e-9, abs=1e-9)
        assert (ours.winches.F1_cmd, ours.winches.F2_cmd) == pytest.approx(commands, rel=1e-12)
        assert (ours.winches.tau_1, ours.winches.tau_2) == pytest.approx(torques, rel=1e-9)
        assert ours.saturated == (theirs.u != theirs.u_sat)
        saturated += bool(ours.saturated)
    assert 0 < saturated < 400


@pytest.mark.parametrize("kind", POSITION_LAWS)
def test_symbols_and_floats_give_the_same(kind: str) -> None:
    controller = CONTROLLERS[kind]
    state = initial_controller_state(controller)
    function = controller_function(controller, NOMINAL)
    for measured, point in random_samples(100):
        inputs = [np.array(list(leaves(group).values()), float) for group in (state, measured, point)]
        found = [np.array(output).ravel() for output in function(*inputs, SAMPLE_TIME, *ahead(point, controller))]
        state, output = controller_step(state, measured, point, controller, NOMINAL, SAMPLE_TIME)
        winches = output.winches
        expected = [
            list(leaves(state).values()),
            [winches.tau_1, winches.tau_2],
            [winches.F1_cmd, winches.F2_cmd],
        ]
        for ours, theirs in zip(found, expected, strict=True):
            assert ours == pytest.approx(np.array(theirs, float), rel=1e-12, abs=1e-12)


def test_default_gains_are_the_papers() -> None:
    ours: dict[str, float] = {}
    for law in POSITION_LAWS.values():
        ours |= leaves(Controller(law=law()), "controller.")
    theirs = {key: value for key, value in DEFAULTS.items() if key.startswith("controller.")}
    assert {key: ours[key] for key in theirs} == theirs


@pytest.mark.parametrize("kind", POSITION_LAWS)
def test_the_function_is_named_after_its_law_and_has_jacobians(kind: str) -> None:
    controller = Controller(law=POSITION_LAWS[kind]())
    function = controller_function(controller, Plant())
    assert function.name() == kind.replace("-", "_")
    state = np.array(list(leaves(initial_controller_state(controller)).values()), float)
    jacobian = function.factory("jacobian", function.name_in(), ["jac:torques:measurement"])
    sensed, point = [0.1, 0.2, 1500.0, 900.0, 0.1, -0.1, 0.3, -0.3], Setpoint(0.1, 0.2, 0.0)
    seen = ahead(point, controller)
    slopes = np.array(jacobian(state, sensed, list(leaves(point).values()), SAMPLE_TIME, *seen))
    assert np.isfinite(slopes).all()
    assert (slopes[:, 4:] == 0).all(), "drum speeds would close an algebraic loop (E9)"


@pytest.mark.parametrize(("estimator", "coordination"), each_choice(ESTIMATORS, COORDINATIONS))
def test_every_estimator_goes_with_every_coordination(estimator: str, coordination: str) -> None:
    """Symbols and floats, over a run; the laws come in turn."""
    law = list(POSITION_LAWS.values())[list(ESTIMATORS).index(estimator)]
    controller = Controller(ESTIMATORS[estimator](), law(), coordination=COORDINATIONS[coordination]())
    state, function = initial_controller_state(controller), controller_function(controller, Plant())
    for measured, point in random_samples(50):
        inputs = [np.array(list(leaves(group).values()), float) for group in (state, measured, point)]
        given = *inputs, SAMPLE_TIME, *ahead(point, controller)
        following, torques, _ = (np.array(output).ravel() for output in function(*given))
        state, output = controller_step(state, measured, point, controller, Plant(), SAMPLE_TIME)
        assert following == pytest.approx(np.array(list(leaves(state).values()), float), rel=1e-9, abs=1e-9)
        assert torques == pytest.approx([output.winches.tau_1, output.winches.tau_2], rel=1e-9)


def test_a_force_from_outside_stands_in_place_of_the_laws() -> None:
    controller, (measured, point) = Controller(), random_samples(1)[0]
    state = initial_controller_state(controller)
    _, output = controller_step(state, measured, point, controller, Plant(), SAMPLE_TIME, shared_force=1234.0)
    _, usual = controller_step(state, measured, point, controller, Plant(), SAMPLE_TIME)
    assert output.winches.F1_cmd - output.winches.F2_cmd == pytest.approx(1234)
    assert output.position == usual.position


@dataclass(frozen=True)
class TwoSignals(PositionOutput):
    s: Annotated[Scalar, Quantity("m", "sliding variable")] = 0.0
    rate: Annotated[Scalar, Quantity("m/s", "its rate")] = 0.0


@dataclass(frozen=True)
class OneSignal(Estimate):
    bias: Annotated[Scalar, Quantity("m", "offset of the sensor")] = 0.0


@dataclass(frozen=True)
class SameSignal(CoordinationOutput):
    s: Annotated[Scalar, Quantity("N", "slackness")] = 0.0


ESTIMATE = OneSignal(*[0.0] * 8, bias=0.25)
WINCHES = CoordinationOutput(1e3, 1e3, 20.0, 20.0, 0.0)


def test_own_signals_are_what_parts_give_beyond_what_they_pass_on() -> None:
    """The position law's first, then the estimator's and the coordination's."""
    signals = own_signals(ControllerOutput(ESTIMATE, TwoSignals(1.0, 1.0, 0.5, 0.7), WINCHES))
    assert list(signals) == ["s", "rate", "bias"]
    assert signals["rate"] == (0.7, Quantity("m/s", "its rate"))
    assert signals["bias"] == (0.25, Quantity("m", "offset of the sensor"))


def test_two_parts_may_not_give_signals_of_one_name() -> None:
    output = ControllerOutput(ESTIMATE, TwoSignals(1.0, 1.0), SameSignal(*leaves(WINCHES).values()))
    with pytest.raises(ConfigurationError, match=r"^signal 's': two parts of the controller give it; rename one of"):
        own_signals(output)
