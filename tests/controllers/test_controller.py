"""The whole controller: on floats, as a CasADi function, and against the independent laws over a random run."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dualwinch.controllers.controller import (
    POSITION_LAWS,
    Controller,
    controller_function,
    controller_step,
    initial_controller_state,
)
from dualwinch.controllers.coordinations.winch_pid import WinchGains
from dualwinch.controllers.laws.auxiliary import AuxiliaryGains
from dualwinch.controllers.laws.observer import ObserverGains
from dualwinch.controllers.laws.pid_cascade import PidCascadeGains
from dualwinch.controllers.nominal import Nominal, nominal_plant
from dualwinch.controllers.signals import Measurement
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Setpoint
from dualwinch.model.tree import leaves
from tests.oracle.laws import LAWS, Seen, WinchPid, tension_commands
from tests.oracle.values import DEFAULTS

SAMPLE_TIME = 1e-3
GAINS = Controller(
    nominal=Nominal(mass=1.2e4, drag_coefficient=0.35, friction_coefficient=0.13),
    auxiliary=AuxiliaryGains(gamma=2e-5, gamma_force=0.05, k_a=3.0),
    observer=ObserverGains(l0=3.0, kf=8.0, filter_time=0.05),
    pid_cascade=PidCascadeGains(kd1=0.4, kd2=0.02),
    winch_1=WinchGains(kd=1e-6),
    winch_2=WinchGains(kp=1e-3, ki=0.05),
)
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
NOMINAL = nominal_plant(GAINS.nominal, Plant())


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


@pytest.mark.parametrize("kind", LAWS)
def test_every_sample_equals_the_independent_laws(kind: Any) -> None:
    controller = replace(GAINS, kind=kind)
    state = initial_controller_state(controller)
    law, winch_1, winch_2 = LAWS[kind](VALUES), WinchPid(VALUES, 1), WinchPid(VALUES, 2)
    saturated = 0
    for measured, point in random_samples(400):
        state, ours = controller_step(state, measured, point, controller, NOMINAL, SAMPLE_TIME)
        theirs = law.step(Seen(measured.x, measured.v, measured.F1, measured.F2, point.x, point.v, point.a))
        commands = tension_commands(theirs.u_sat, 2000.0, 200.0, 6000.0)
        torques = (
            winch_1.step(commands[0], measured.F1, point.a / 0.8),
            winch_2.step(commands[1], measured.F2, -point.a / 0.8),
        )
        said = {key: value for key, value in leaves(ours.position).items() if value is not None}
        assert said == pytest.approx({key: getattr(theirs, key) for key in said}, rel=1e-9, abs=1e-9)
        assert (ours.F1_cmd, ours.F2_cmd) == pytest.approx(commands, rel=1e-12)
        assert (ours.tau1, ours.tau2) == pytest.approx(torques, rel=1e-9)
        assert ours.saturated == (theirs.u != theirs.u_sat)
        saturated += bool(ours.saturated)
    assert 0 < saturated < 400


@pytest.mark.parametrize("kind", POSITION_LAWS)
def test_symbols_and_floats_give_the_same(kind: Any) -> None:
    controller = replace(GAINS, kind=kind)
    state = initial_controller_state(controller)
    function = controller_function(controller, NOMINAL)
    for measured, point in random_samples(100):
        inputs = [np.array(list(leaves(group).values()), float) for group in (state, measured, point)]
        found = [np.array(output).ravel() for output in function(*inputs, SAMPLE_TIME)]
        state, said = controller_step(state, measured, point, controller, NOMINAL, SAMPLE_TIME)
        expected = [list(leaves(state).values()), [said.tau1, said.tau2], [said.F1_cmd, said.F2_cmd]]
        for ours, theirs in zip(found, expected, strict=True):
            assert ours == pytest.approx(np.array(theirs, float), rel=1e-12, abs=1e-12)


def test_default_gains_are_the_papers() -> None:
    ours = leaves(Controller(), "controller.")
    theirs = {key: value for key, value in DEFAULTS.items() if key.startswith("controller.")}
    assert {key: ours[key] for key in theirs} == theirs


@pytest.mark.parametrize("kind", POSITION_LAWS)
def test_the_function_is_named_after_its_law_and_has_jacobians(kind: Any) -> None:
    function = controller_function(replace(Controller(), kind=kind), Plant())
    assert function.name() == kind.replace("-", "_")
    state = np.array(list(leaves(initial_controller_state(replace(Controller(), kind=kind))).values()), float)
    jacobian = function.factory("jacobian", function.name_in(), ["jac:torques:measurement"])
    slopes = np.array(jacobian(state, [0.1, 0.2, 1500.0, 900.0, 0.1, -0.1, 0.3, -0.3], [0.1, 0.2, 0.0], SAMPLE_TIME))
    assert np.isfinite(slopes).all()
    assert (slopes[:, 4:] == 0).all(), "drum speeds would close an algebraic loop (E9)"
