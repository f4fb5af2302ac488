import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from scipy.io import loadmat
from scipy.signal import cont2discrete

from dualwinch.model.errors import ConfigurationError, MissingExtraError
from dualwinch.model.linear.system import LinearSystem

OSCILLATOR = LinearSystem(
    A=np.array([[0.0, 1.0], [-4.0, -0.4]]),
    B=np.array([[0.0, 0.0], [1.0, 2.0]]),
    C=np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]),
    D=np.array([[0.0, 0.0], [0.0, 0.5], [0.0, 0.0]]),
    dt=None,
    states=("motion.x", "motion.v"),
    inputs=("tau", "force"),
    outputs=("x", "v", "sum"),
    units={"motion.x": "m", "motion.v": "m/s", "tau": "N m", "force": "N", "x": "m", "v": "m/s", "sum": "1"},
    operating_point={"x": 25.0, "v": 0.1},
)


def test_zero_order_hold_is_scipys() -> None:
    sampled = OSCILLATOR.discretised(0.05)
    system = (OSCILLATOR.A, OSCILLATOR.B, OSCILLATOR.C, OSCILLATOR.D)
    theirs: Any = cont2discrete(system, 0.05)
    A, B, C, D, dt = theirs
    for mine, expected in ((sampled.A, A), (sampled.B, B), (sampled.C, C), (sampled.D, D)):
        np.testing.assert_allclose(mine, expected, rtol=1e-13)
    assert sampled.dt == dt
    np.testing.assert_allclose(np.sort(sampled.poles()), np.sort(np.exp(0.05 * OSCILLATOR.poles())), rtol=1e-13)


@pytest.mark.parametrize("dt", [0.0, -1.0, float("nan"), float("inf")])
def test_a_sample_time_must_be_positive(dt: float) -> None:
    with pytest.raises(ConfigurationError, match=r"^dt = .*: must be a finite number > 0 s$"):
        OSCILLATOR.discretised(dt)


def test_a_discrete_system_is_not_sampled_again() -> None:
    with pytest.raises(ConfigurationError, match=r"discrete already.*0\.05 s"):
        OSCILLATOR.discretised(0.05).discretised(0.01)


@pytest.mark.parametrize("system", [OSCILLATOR, OSCILLATOR.discretised(0.05)], ids=["continuous", "discrete"])
def test_python_control_gets_the_same_system(system: LinearSystem) -> None:
    theirs = system.to_control()
    assert theirs.state_labels == ["motion_x", "motion_v"]
    assert theirs.input_labels == ["tau", "force"]
    assert theirs.output_labels == ["x", "v", "sum"]
    assert theirs.dt == (0 if system.dt is None else 0.05)
    omega = np.array([0.1, 2.0, 9.0])
    response: Any = control.frequency_response(theirs, omega)
    np.testing.assert_allclose(np.moveaxis(system.response(omega), 0, -1), response.complex, rtol=1e-12)


def test_without_python_control_the_error_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'dualwinch\[control\]'"):
        OSCILLATOR.to_control()


def test_inputs_and_outputs_are_chosen_by_name() -> None:
    part = OSCILLATOR.between(["force"], ["sum", "v"])
    np.testing.assert_array_equal(part.B, [[0.0], [2.0]])
    np.testing.assert_array_equal(part.C, [[1.0, 1.0], [0.0, 1.0]])
    np.testing.assert_array_equal(part.D, [[0.0], [0.5]])
    with pytest.raises(ConfigurationError, match="unknown input 'forse'; did you mean 'force'"):
        OSCILLATOR.between(["forse"], ["v"])


def test_names_must_fit_the_matrices_and_have_units() -> None:
    with pytest.raises(ConfigurationError, match=r"B has the shape \(2, 2\): must be \(2, 1\) for these names"):
        replace(OSCILLATOR, inputs=("force",))
    with pytest.raises(ConfigurationError, match="no unit for 'force'"):
        replace(OSCILLATOR, units={name: unit for name, unit in OSCILLATOR.units.items() if name != "force"})


@pytest.mark.parametrize("system", [OSCILLATOR, OSCILLATOR.discretised(0.05)], ids=["continuous", "discrete"])
def test_files_hold_everything(system: LinearSystem, tmp_path: Path) -> None:
    for suffix in ("json", "npz", "mat"):
        system.save(f"{tmp_path}/system.{suffix}")
    text = json.loads((tmp_path / "system.json").read_text())
    assert list(text) == ["A", "B", "C", "D", "dt", "states", "inputs", "outputs", "units", "operating_point"]
    assert text["dt"] == system.dt
    assert text["units"] == system.units
    assert text["operating_point"] == system.operating_point
    archive = np.load(tmp_path / "system.npz")
    matlab = loadmat(tmp_path / "system.mat", simplify_cells=True)
    for held in (text, archive, matlab):
        np.testing.assert_array_equal(np.array(held["A"]), system.A)
        np.testing.assert_array_equal(np.array(held["D"]), system.D)
        assert list(held["states"]) == list(system.states)
        assert list(held["outputs"]) == list(system.outputs)
    assert archive["dt"] == matlab["dt"] == (system.dt or 0.0)
    assert json.loads(str(archive["units"])) == system.units
    assert matlab["units"]["motion_v"] == "m/s"
    assert matlab["operating_point"] == system.operating_point


def test_response_is_infinite_at_a_pole_and_only_where_that_shows() -> None:
    """A mass on which a force acts, and an oscillator of 2 rad/s beside it: 1/s and 1/s^2 at 0, 1/(4 - w^2) at 2."""
    A = np.zeros((4, 4))
    A[0, 1], A[2, 3], A[3, 2] = 1.0, 1.0, -4.0
    B, C = np.zeros((4, 2)), np.eye(4)[[0, 1, 2]]
    B[1, 0] = B[3, 1] = 1.0
    names: tuple[str, ...] = ("position", "speed", "swing", "swinging")
    units: dict[str, str] = dict.fromkeys((*names, "force", "push", "x", "v", "a"), "1")
    system = LinearSystem(A, B, C, np.zeros((3, 2)), None, names, ("force", "push"), ("x", "v", "a"), units)
    response = system.response([0.0, 1.0, 2.0])
    assert np.isinf(response).tolist() == [
        [[True, False], [True, False], [False, False]],
        [[False, False]] * 3,
        [[False, False], [False, False], [False, True]],
    ]
    assert response[0, 2, 1] == pytest.approx(1 / 4)
    assert response[2, :2, 0] == pytest.approx([-1 / 4, -0.5j])
