"""The contract of every coordination."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, CoordinationOutput, Estimate
from dualwinch.controllers.registry import COORDINATIONS
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Setpoint
from dualwinch.simulation.loop.structure import structure_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.simulate import simulate

kinds = st.sampled_from(list(COORDINATIONS))
AT_REST = Estimate(0.0, 0.0, 1000.0, 1000.0, 0.0, 0.0, 0.0, 0.0)


def first_output(kind: str, u_sat: float, estimate: Estimate = AT_REST) -> CoordinationOutput:
    coordination, context = COORDINATIONS[kind](), Context(Plant(), Limits(), 1e-3)
    return coordination.step(coordination.initial_state(), u_sat, estimate, Setpoint(0.0, 0.0, 0.0), context)[1]


@given(kinds, st.floats(-5800, 5800))
def test_commands_are_within_the_limits_and_their_difference_is_the_force(kind: str, u_sat: float) -> None:
    output = first_output(kind, u_sat)
    assert min(output.F1_cmd, output.F2_cmd) >= 200
    assert max(output.F1_cmd, output.F2_cmd) <= 6000
    assert output.F1_cmd - output.F2_cmd == pytest.approx(u_sat, abs=1e-9)


@given(kinds, st.floats(-5800, 5800), st.floats(0, 9000), st.floats(-5, 5), st.floats(-1, 1))
def test_torques_are_within_what_the_tension_limits_allow(
    kind: str, u_sat: float, tension: float, omega: float, x: float
) -> None:
    output = first_output(kind, u_sat, replace(AT_REST, x=x, F1=tension, F2=tension / 2, omega_1=omega, omega_2=omega))
    for torque in (output.tau_1, output.tau_2):
        assert 0.8 / 36 * 200 <= torque <= 0.8 / 36 * 6000


@pytest.mark.parametrize("kind", COORDINATIONS)
def test_at_rest_without_a_force_the_preload_is_held(kind: str) -> None:
    output = first_output(kind, 0.0)
    assert (output.F1_cmd, output.F2_cmd) == (1000, 1000)
    assert (output.tau_1, output.tau_2) == pytest.approx((0.8 / 36 * 1000,) * 2)
    assert not output.torque_saturated


COSTS = {
    "differential-tension": (4800, 151e3),
    "proportional-tension": (4800, 151e3),
    "scheduled-preload": (5080, 176e3),
    "master-slave": (5600, 215e3),
    "force-position": (5600, 215e3),
}
"""Kind → largest tension in N and energy in J in Case 4."""


@pytest.mark.parametrize("kind", COORDINATIONS)
def test_each_tracks_case_4_and_keeps_both_ropes_taut(kind: str) -> None:
    """What they cost apart."""
    experiment = case(4)
    controller = replace(experiment.controller, coordination=COORDINATIONS[kind]())
    metrics = simulate(replace(experiment, controller=controller)).metrics
    assert metrics.steady_mae == pytest.approx(3.7e-3, rel=0.03)
    assert metrics.slack_share == 0
    assert metrics.peak_tension == pytest.approx(COSTS[kind][0], rel=0.01)
    assert metrics.energy == pytest.approx(COSTS[kind][1], rel=0.02)


def test_the_coordination_shapes_the_compiled_code() -> None:
    structures = {
        structure_of(replace(case(4), controller=Controller(coordination=coordination())))
        for coordination in COORDINATIONS.values()
    }
    assert len(structures) == len(COORDINATIONS)
