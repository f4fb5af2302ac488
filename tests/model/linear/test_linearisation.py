from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from dualwinch.model.linear.linearisation import INPUTS, OUTPUTS, STATES, UNITS
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.tree import with_leaves
from tests.model.linear.test_operating_point import CHANGED
from tests.oracle.plant import Hold
from tests.oracle.plant import Plant as OraclePlant
from tests.oracle.values import DEFAULTS
from tests.plant_points import linearise, linearise_sweep

Array = NDArray[np.float64]

STEPS = {"x": 0.05, "v": 5e-4, "theta": 0.05, "omega": 5e-4, "tau": 5.0, "current": 0.01}


def difference(function: Callable[[Array], Array], point: Array, k: int, step: float) -> Array:
    """Derivative along the k-th argument by the central difference of eighth order."""
    total = np.zeros_like(function(point))
    for offset, weight in ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280)):
        ahead, behind = point.copy(), point.copy()
        ahead[k] += offset * step
        behind[k] -= offset * step
        total += weight * (function(ahead) - function(behind)) / step
    return total


def oracle_function(values: dict[str, float]) -> Callable[[Array], Array]:
    """(state, tau_1, tau_2, current) -> (rate of the state, outputs) of the independent plant, ropes taut."""
    oracle = OraclePlant(values)

    def function(point: Array) -> Array:
        x, v, theta_1, omega_1, theta_2, omega_2, tau_1, tau_2, current = point
        position, speed = (x, theta_1, theta_2), (v, omega_1, omega_2)
        hold = Hold(tau_1, tau_2, current=current)
        (dv, domega_1, domega_2), _ = oracle.motion(0.0, position, speed, hold, (True, True))
        force_1, force_2 = oracle.tensions(position, speed)
        rates = [v, dv, omega_1, domega_1, omega_2, domega_2]
        return np.array([*rates, x, v, force_1, force_2, omega_1, omega_2])

    return function


@pytest.mark.parametrize("values", [DEFAULTS, CHANGED], ids=["paper", "changed"])
@pytest.mark.parametrize(
    ("x", "v", "preload"), [(25.0, 0.0, 2000.0), (1.0, 1.8, 2000.0), (47.0, -1.2, 5000.0), (10.0, 0.02, 11000.0)]
)
def test_matrices_are_the_independent_plants(values: dict[str, float], x: float, v: float, preload: float) -> None:
    two_sided = values | {"plant.rope_slack": False}  # differences reach across the point where a rope goes slack
    system = linearise(x, v, preload, with_leaves(Plant(), values, "plant."), current=0.1)
    at = system.operating_point
    point = np.array([at[name] for name in (*STATES, "tau_1", "tau_2", "current")])
    function = oracle_function(two_sided)
    steps = [STEPS[name.partition("_")[0]] for name in (*STATES, "tau_1", "tau_2", "current")]
    jacobian = np.array([difference(function, point, k, step) for k, step in enumerate(steps)]).T
    chosen = [0, 1, 3]
    pairs = [
        (system.A, jacobian[:6, :6]),
        (system.C, jacobian[6:, :6]),
        (system.B[:, chosen], jacobian[:6, 6:]),
        (system.D[:, chosen], jacobian[6:, 6:]),
    ]
    for mine, theirs in pairs:
        zero = mine == 0
        np.testing.assert_allclose(mine[~zero], theirs[~zero], rtol=1e-7)
        np.testing.assert_allclose(theirs[zero], 0.0, atol=1e-9)
    mass = values["plant.vehicle.mass"] + values["plant.vehicle.added_mass"]
    np.testing.assert_array_equal(system.B[:, 2], [0, 1 / mass, 0, 0, 0, 0])
    assert not system.D.any()


def test_names_and_units() -> None:
    system = linearise()
    assert (system.states, system.inputs, system.outputs) == (STATES, INPUTS, OUTPUTS)
    assert [UNITS[name] for name in INPUTS] == ["N m", "N m", "N", "m/s"]
    assert [UNITS[name] for name in OUTPUTS] == ["m", "m/s", "N", "N", "rad/s", "rad/s"]
    assert {"x", "v", "preload", "tau_1", "F1", "residual"} <= set(system.operating_point)


def test_a_sweep_is_the_same_as_one_by_one() -> None:
    x = np.array([2.0, 30.0])
    for system, point in zip(linearise_sweep(x, 0.7, 3000.0, dt=1e-3), x, strict=True):
        alone = linearise(point, 0.7, 3000.0, dt=1e-3)
        np.testing.assert_array_equal(system.A, alone.A)
        np.testing.assert_array_equal(system.B, alone.B)
        assert system.dt == 1e-3
