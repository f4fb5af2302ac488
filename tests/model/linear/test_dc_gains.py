import numpy as np
import pytest

from dualwinch.model.linear.properties import dc_gains
from dualwinch.model.linear.system import LinearSystem
from tests.plant_points import linearise


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
