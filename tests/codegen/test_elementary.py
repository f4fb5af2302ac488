"""The elementary functions of the vector lanes, against the C library's by way of NumPy."""

import ctypes
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.drivers.unit import c_file

FUNCTIONS = {"exp": np.exp, "tanh": np.tanh, "sin": np.sin, "log": np.log}
FORM = '__attribute__((visibility("default"))) double call_{0}(double x) {{ return inline_{0}(x); }}\n'


@pytest.fixture(scope="module")
def lanes(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    header = c_file("driver.h") + c_file("elementary.h")
    power = '__attribute__((visibility("default"))) double call_pow(double x, double y) { return inline_pow(x, y); }\n'
    target: Path = tmp_path_factory.mktemp("elementary") / "elementary.so"
    find_compiler().build(header + "".join(FORM.format(name) for name in FUNCTIONS) + power, target)
    library = ctypes.CDLL(str(target))
    for name in (*FUNCTIONS, "pow"):
        function = getattr(library, f"call_{name}")
        function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double] * (2 if name == "pow" else 1)
    return library


@pytest.mark.parametrize(
    ("name", "lower", "upper"),
    [
        ("exp", -700, 700),
        ("exp", -1e-3, 1e-3),
        ("tanh", -30, 30),
        ("tanh", -1e-3, 1e-3),
        ("sin", -1.5, 1.5),
        ("log", 1e-300, 1e-10),
        ("log", 0.5, 2.0),
    ],
)
def test_relative_error(name: str, lower: float, upper: float, lanes: ctypes.CDLL) -> None:
    call = getattr(lanes, f"call_{name}")
    for x in np.random.default_rng(1).uniform(lower, upper, 20_000).tolist():
        assert call(x) == pytest.approx(float(FUNCTIONS[name](x)), rel=1e-9, abs=0), x


@pytest.mark.parametrize("reach", [1.0, 1e3, 1e6])
def test_sine_of_a_large_angle_errs_by_the_spacing_of_numbers_there(reach: float, lanes: ctypes.CDLL) -> None:
    for x in np.random.default_rng(1).uniform(-reach, reach, 20_000).tolist():
        assert lanes.call_sin(x) == pytest.approx(np.sin(x), rel=0, abs=3e-11 + 2 * float(np.spacing(reach))), x


@given(x=st.floats(1e-20, 1e10), y=st.floats(-2, 2))
def test_power(x: float, y: float, lanes: ctypes.CDLL) -> None:
    assert lanes.call_pow(x, y) == pytest.approx(x**y, rel=1e-9)


@pytest.mark.parametrize("x", [0.0, -0.0, 1.0, -1.0, 1e-310, 1e300, -1e300])
def test_odd_functions_at_their_edges(x: float, lanes: ctypes.CDLL) -> None:
    assert lanes.call_tanh(x) == pytest.approx(np.tanh(x), rel=1e-9)
    assert abs(lanes.call_sin(x)) <= 1
    assert np.isfinite(lanes.call_exp(x))
