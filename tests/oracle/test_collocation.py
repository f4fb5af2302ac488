import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.oracle.collocation import Collocation, collocation_matrix, radau_nodes
from tests.oracle.plant import Hold, Plant
from tests.oracle.sampled import Scenario, run
from tests.oracle.scipy_solver import SciPySolver
from tests.oracle.values import DEFAULTS

PLANT = Plant(DEFAULTS)


def test_two_nodes_give_the_textbook_tableau() -> None:
    nodes = radau_nodes(2)
    assert nodes == pytest.approx([1 / 3, 1])
    assert collocation_matrix(nodes) == pytest.approx(np.array([[5 / 12, -1 / 12], [3 / 4, 1 / 4]]))


@settings(max_examples=10)
@given(
    x=st.floats(1, 49),
    v=st.floats(-2, 2),
    pulls=st.tuples(st.floats(-500, 6000), st.floats(-500, 6000)),
    torques=st.tuples(st.floats(4, 130), st.floats(4, 130)),
)
def test_a_sample_agrees_with_scipys_radau(
    x: float, v: float, pulls: tuple[float, float], torques: tuple[float, float]
) -> None:
    k_1, k_2 = PLANT.stiffnesses(x)
    position = (x, (pulls[0] / k_1 + x) / 0.8, (pulls[1] / k_2 - x) / 0.8)
    speed = (v, v / 0.8, -v / 0.8)
    hold = Hold(*torques)
    ours = Collocation(PLANT, swing=0.5).advance(3.0, 1e-3, position, speed, hold)
    theirs = SciPySolver(PLANT).advance(3.0, 1e-3, position, speed, hold)
    assert np.ravel(ours) == pytest.approx(np.ravel(theirs), rel=1e-9, abs=1e-8)


def test_start_up_through_slack_agrees_with_scipys_radau() -> None:
    start_up = Scenario("fando-nftsm", 1)
    ours, theirs = run(start_up, 20), run(start_up, 20, SciPySolver(PLANT))
    assert (theirs["F2"] == 0).any()
    assert np.abs(ours["x"] - theirs["x"]).max() < 1e-10
    assert np.abs(ours["F2"] - theirs["F2"]).max() < 0.1


@pytest.mark.slow
def test_shorter_steps_change_nothing() -> None:
    start_up = Scenario("fando-nftsm", 1)
    usual, fine = run(start_up, 1000), run(start_up, 1000, Collocation(PLANT, swing=0.7))
    assert np.abs(usual["x"] - fine["x"]).max() < 1e-8
