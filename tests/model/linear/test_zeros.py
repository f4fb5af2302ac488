import control
import numpy as np
import pytest

from dualwinch.model.linear.properties import dc_gains, zeros
from dualwinch.model.linear.system import LinearSystem
from tests.plant_points import linearise


@pytest.mark.parametrize("x", [1.0, 25.0, 49.0])
@pytest.mark.parametrize(
    ("inputs", "outputs"),
    [
        (["tau_1"], ["F1"]),
        (["tau_1"], ["x"]),
        (["D"], ["x"]),
        (["tau_1", "tau_2"], ["F1", "F2"]),
        (["tau_1", "tau_2"], ["x", "F1"]),
    ],
)
def test_zeros_are_python_controls(x: float, inputs: list[str], outputs: list[str]) -> None:
    system = linearise(x=x, v=1.8).between(inputs, outputs)
    mine, theirs = zeros(system), control.zeros(system.to_control())
    assert len(mine) == len(theirs)
    for zero in mine:
        assert min(abs(theirs - zero)) < 1e-7 * max(abs(zero), 1)


def test_drums_swinging_on_their_ropes_take_up_a_force_on_the_vehicle() -> None:
    """The vehicle stands still while each drum swings on its rope alone: the zeros from the force D to x."""
    found = zeros(linearise(x=10.0).between(["D"], ["x"]))
    for length in (40.5, 10.5):
        drum = np.roots([1.8, 1000 * 0.8**2, 80e9 * 4.52e-4 / length * 0.8**2])
        for zero in drum:
            assert min(abs(found - zero)) < 1e-8 * abs(zero)
    assert len(found) == 4


def test_more_outputs_than_inputs_and_hidden_modes() -> None:
    names, units = ("a", "b"), dict.fromkeys("abuyz", "1")
    A, B = np.diag([-1.0, -2.0]), np.array([[1.0], [1.0]])
    both = LinearSystem(
        A, B, np.eye(2), np.zeros((2, 1)), dt=None, states=names, inputs=("u",), outputs=("y", "z"), units=units
    )
    assert zeros(both).size == 0
    np.testing.assert_allclose(zeros(both.between(["u"], ["y"])), [-2.0])  # y does not show the second mode
    fed = LinearSystem(
        A, B, np.ones((1, 2)), np.full((1, 1), 0.5), dt=None, states=names, inputs=("u",), outputs=("y",), units=units
    )
    np.testing.assert_allclose(np.sort(zeros(fed).real), np.sort(np.roots([0.5, 3.5, 4.0])))


@pytest.mark.parametrize("dt", [None, 1e-3])
def test_dc_gains_are_the_physics(dt: float | None) -> None:
    system = linearise(x=10.0, v=1.8, dt=dt)
    gains = dict(zip(system.outputs, dc_gains(system), strict=True))
    # rounding errors: eps ‖A‖ ‖A⁻¹‖ without the integrator, times the motion, is 1e-7 in the units of F over D
    assert gains["F1"] == pytest.approx([36 / 0.8, 0, 0, 0], abs=1e-6)
    assert gains["F2"] == pytest.approx([0, 36 / 0.8, 0, 0], abs=1e-6)
    slope = 0.3 * 1000 * 6 * 1.8
    assert gains["v"] == pytest.approx([45 / slope, -45 / slope, 1 / slope, 1.0], rel=1e-6)
    assert list(gains["x"]) == [np.inf, -np.inf, np.inf, np.inf]


def test_a_double_integrator_has_no_dc_gain() -> None:
    units = dict.fromkeys("xvuyw", "1")
    A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [-2.0]])
    system = LinearSystem(
        A,
        B,
        np.eye(2),
        np.array([[0.0], [1.0]]),
        dt=None,
        states=("x", "v"),
        inputs=("u",),
        outputs=("y", "w"),
        units=units,
    )
    assert dc_gains(system).tolist() == [[-np.inf], [-np.inf]]
