import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.model.plant import (
    DisturbanceInputs,
    Plant,
    PlantState,
    Torques,
    derivative,
    holding_torques,
    plant,
    resting_state,
    tensions,
)
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.quantities.tree import leaves, numbers
from tests.oracle.plant import Hold
from tests.oracle.plant import Plant as OraclePlant
from tests.oracle.values import DEFAULTS

PLANT, ORACLE = Plant(), OraclePlant(DEFAULTS)
environments = st.builds(
    DisturbanceInputs,
    force=st.just(0.0),
    current=st.floats(-0.154, 0.154),
    normal_force_variation=st.floats(-1000, 1000),
)


@st.composite
def states(draw: st.DrawFn) -> PlantState:
    """On the track, with ropes between loose and 8 kN and drums that turn about as fast as the vehicle."""
    x, v = draw(st.floats(-0.2, 50.2)), draw(st.floats(-3, 3))
    k_1, k_2 = ORACLE.stiffnesses(x)
    stretch_1, stretch_2 = draw(st.floats(-1000, 8000)) / k_1, draw(st.floats(-1000, 8000)) / k_2
    slip_1, slip_2 = draw(st.floats(-0.5, 0.5)), draw(st.floats(-0.5, 0.5))
    return PlantState(x, v, (stretch_1 + x) / 0.8, (v + slip_1) / 0.8, (stretch_2 - x) / 0.8, (slip_2 - v) / 0.8)


torques = st.builds(Torques, st.floats(0, 140), st.floats(0, 140))


def oracle_derivative(state: PlantState, motors: Torques, around: DisturbanceInputs) -> list[float]:
    position, speed = (state.x, state.theta_1, state.theta_2), (state.v, state.omega_1, state.omega_2)
    hold = Hold(motors.tau_1, motors.tau_2, around.current, around.normal_force_variation)
    rates, _ = ORACLE.motion(0.0, position, speed, hold, ORACLE.taut(position, speed))
    return [speed[0], rates[0], speed[1], rates[1], speed[2], rates[2]]


@given(states(), torques, environments)
def test_equations_of_motion_equal_the_independent_ones(
    state: PlantState, motors: Torques, around: DisturbanceInputs
) -> None:
    ours = list(leaves(derivative(state, motors, around, PLANT)).values())
    assert ours == pytest.approx(oracle_derivative(state, motors, around), rel=1e-9, abs=1e-5)


@given(states())
def test_tensions_equal_the_independent_ones(state: PlantState) -> None:
    theirs = ORACLE.tensions((state.x, state.theta_1, state.theta_2), (state.v, state.omega_1, state.omega_2))
    assert tensions(state, PLANT) == pytest.approx(theirs, rel=1e-9, abs=1e-5)


@given(states(), torques, environments)
def test_the_named_function_equals_the_law_on_floats(
    state: PlantState, motors: Torques, around: DisturbanceInputs
) -> None:
    inputs = {
        name: np.array(list(leaves(group).values())) for name, group in zip("xuw", (state, motors, around), strict=True)
    }
    fixed = plant(PLANT)(**inputs)
    open_parameters = plant()(**inputs, p=np.array(list(numbers(PLANT).values())))
    expected = list(leaves(derivative(state, motors, around, PLANT)).values())
    for found in (fixed, open_parameters):
        assert np.array(found["dx"]).ravel() == pytest.approx(expected, rel=1e-12, abs=1e-9)
        assert np.array(found["F"]).ravel() == pytest.approx(tensions(state, PLANT), rel=1e-12, abs=1e-9)


@given(st.floats(0, 50), st.floats(500, 11000))
def test_at_rest_the_holding_torques_keep_it_at_rest(x: float, preload: float) -> None:
    state = resting_state(preload, PLANT, x)
    assert tensions(state, PLANT) == pytest.approx((preload / 2, preload / 2), rel=1e-6)
    moved = derivative(state, holding_torques(preload, PLANT), DisturbanceInputs(), PLANT)
    assert list(leaves(moved).values()) == pytest.approx([0] * 6, abs=0.02)


def test_default_parameters_are_the_papers() -> None:
    ours = leaves(PLANT, "plant.")
    theirs = {key: value for key, value in DEFAULTS.items() if key.startswith("plant.")}
    assert {key: ours[key] for key in theirs} == theirs


def test_what_the_paper_leaves_out_is_off() -> None:
    """Mass, weight and drag of ropes, rotors, gearboxes: zero, unless it only says how what is off would be."""
    described = describe_parts(PLANT, "plant.")
    beyond = {
        key: value
        for key, value in leaves(PLANT, "plant.").items()
        if key not in DEFAULTS and described[key].is_number and Mark.SHAPE_PARAMETER not in described[key].marks
    }
    assert {key.rpartition(".")[2] for key, value in beyond.items() if value} == {"diameter"}


def test_two_sided_rope_pushes() -> None:
    loose = PlantState(25.0, 0.0, (25 - 1e-3) / 0.8, 0.0, (-25 - 1e-3) / 0.8, 0.0)
    assert tensions(loose, PLANT) == (0, 0)
    assert max(tensions(loose, Plant(rope_slack=False))) < -1000
