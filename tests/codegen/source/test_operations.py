"""Every operation of SX expressions in C, in both precisions and in lanes, against CasADi's interpreter."""

import ctypes
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.special import erfinv

from dualwinch.codegen.compiler import NON_FINITE, Compiler, find_compiler
from dualwinch.codegen.drivers.unit import unit
from dualwinch.codegen.errors import CodegenWarning
from dualwinch.codegen.native import compile as compiled
from dualwinch.codegen.source.c_source import LANES, LaneLayout, c_source, lane_flags, lane_sizes
from dualwinch.codegen.source.operations import FUNCTIONS_OF_ONE, FUNCTIONS_OF_TWO, INLINED, Style, name_of, patterns
from tests.codegen.operations import NUMBERS, SPECIAL, functions, interpreted, pairs

Evaluate = Callable[[ca.Function, np.ndarray], np.ndarray]

KNOWN = functions()
WRITTEN = {operation: function for operation, function in KNOWN.items() if operation != ca.OP_PRINTME}
OPERATIONS = pytest.mark.parametrize("operation", WRITTEN, ids=name_of)
EXPORT = '__attribute__((visibility("default")))'


def expected(operation: int, at: np.ndarray) -> np.ndarray:
    """What an operation gives at pairs (n, 2); CasADi's own inverse of erf errs by up to 3e-11."""
    with np.errstate(all="ignore"):
        return erfinv(at[:, 0]) if operation == ca.OP_ERFINV else interpreted(WRITTEN[operation], at)


def library(path: Path, source: str, flags: tuple[str, ...], compiler: Compiler) -> ctypes.CDLL:
    compiler.build(source, path, flags)
    return ctypes.CDLL(str(path))


def caller(loaded: ctypes.CDLL, kind: type[np.floating]) -> Evaluate:
    def evaluate(function: ca.Function, at: np.ndarray) -> np.ndarray:
        x, y = np.ascontiguousarray(at.T.astype(kind))
        z = np.empty_like(x)
        call = getattr(loaded, f"every_{function.name()}")
        call.argtypes, call.restype = [ctypes.c_void_p] * 3 + [ctypes.c_int], None
        call(x.ctypes.data, y.ctypes.data, z.ctypes.data, len(x))
        return z.astype(float)

    return evaluate


@pytest.fixture(scope="module")
def in_float(tmp_path_factory: pytest.TempPathFactory) -> Evaluate:
    loops = [
        f"{EXPORT} void every_{name}(const float *x, const float *y, float *z, int n) "
        f"{{ for (int i = 0; i < n; ++i) {name}(x + i, y + i, z + i); }}"
        for name in (function.name() for function in WRITTEN.values())
    ]
    source = "\n".join([c_source(list(WRITTEN.values()), Style("float")), *loops])
    path = tmp_path_factory.mktemp("float") / "operations.so"
    return caller(library(path, source, (*NON_FINITE, "-Wdouble-promotion", "-Werror"), find_compiler()), np.float32)


@pytest.fixture(scope="module", params=[True, False], ids=["paired", "unpaired"])
def in_lanes(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Evaluate:
    compiler = find_compiler()
    lanes = {function.name(): LaneLayout(paired=request.param) for function in WRITTEN.values()}
    loops = [
        f"{EXPORT} void every_{name}(const double *restrict x, const double *restrict y, double *restrict z, int n) "
        f"{{ for (; n > 0; n -= LANES, x += LANES, y += LANES, z += LANES) EACH_CALL {name}(x + l, y + l, z + l); }}"
        for name in lanes
    ]
    sizes = lane_sizes(paired=bool(request.param))
    definitions = c_source(list(WRITTEN.values()), lanes=lanes)
    source = unit(sizes, [], "elementary.h", "lanes.h", definitions, "\n".join(loops))
    path = tmp_path_factory.mktemp("lanes") / "operations.so"
    return caller(library(path, source, lane_flags(compiler), compiler), np.float64)


def test_every_operation_that_casadi_knows_is_known() -> None:
    """Where this fails, CasADi has learnt an operation: write its C in `codegen.source.operations`."""
    assert {name_of(operation) for operation in KNOWN} == {name_of(operation) for operation in patterns(Style())} | {
        "printme"
    }


@OPERATIONS
def test_in_double_precision_it_gives_what_the_interpreter_gives(operation: int) -> None:
    at = pairs(NUMBERS, SPECIAL)
    got = compiled(WRITTEN[operation])(at[:, 0], at[:, 1])
    if operation == ca.OP_ERFINV:
        np.testing.assert_allclose(got, expected(operation, at), rtol=1e-15)
    else:
        np.testing.assert_array_equal(got, expected(operation, at))


@OPERATIONS
def test_in_single_precision_it_errs_as_single_precision_does(operation: int, in_float: Evaluate) -> None:
    at = pairs(NUMBERS, np.array([np.inf, -np.inf, np.nan])).astype(np.float32).astype(float)
    with np.errstate(over="ignore"):
        wanted = expected(operation, at).astype(np.float32)
    np.testing.assert_allclose(in_float(WRITTEN[operation], at), wanted, rtol=1e-6)


def lane_numbers(operation: int) -> np.ndarray:
    """Pairs (n LANES, 2) an operation in lanes is for: of elementary functions, within what `elementary.h` says."""
    name = (FUNCTIONS_OF_ONE | FUNCTIONS_OF_TWO).get(operation)
    if name not in INLINED:
        at = pairs(NUMBERS, SPECIAL)
    else:
        at = pairs(np.abs(NUMBERS[NUMBERS != 0]) if name in {"log", "pow"} else NUMBERS)
    if operation in {ca.OP_FMIN, ca.OP_FMAX}:
        at = at[~np.isnan(at[:, 0])]  # of two with a NaN the second is taken
        at = at[~np.isnan(at[:, 1])]
    with np.errstate(all="ignore"):
        whole = at[np.abs(expected(operation, at)) < 1e300] if name in INLINED else at
    return np.resize(whole, (-(-len(whole) // LANES) * LANES, 2))


@OPERATIONS
def test_in_lanes_it_gives_what_the_interpreter_gives(operation: int, in_lanes: Evaluate) -> None:
    at = lane_numbers(operation)
    name = (FUNCTIONS_OF_ONE | FUNCTIONS_OF_TWO).get(operation)
    tolerance = 1e-8 if name in INLINED else 1e-15
    absolute = 1e-10 if name in {"sin", "cos", "pow", "exp"} else 0.0
    np.testing.assert_allclose(in_lanes(WRITTEN[operation], at), expected(operation, at), rtol=tolerance, atol=absolute)


def test_the_smaller_and_the_larger_of_a_number_and_none_are_the_second_in_lanes(in_lanes: Evaluate) -> None:
    at = np.resize([[np.nan, 2.0], [2.0, np.nan]], (LANES, 2))
    for operation in (ca.OP_FMIN, ca.OP_FMAX):
        np.testing.assert_array_equal(in_lanes(WRITTEN[operation], at), at[:, 1])


def test_what_has_no_c_of_ours_is_named_and_casadi_s() -> None:
    with pytest.warns(CodegenWarning, match=r"^no C of our own for op_printme: there is none for its 'printme'"):
        assert "casadi_printme" in c_source([KNOWN[ca.OP_PRINTME]])


def test_numbers_that_are_none_are_constants_too() -> None:
    x = ca.SX.sym("x")
    function = ca.Function("constants", [x], [ca.vertcat(ca.fmin(x, ca.inf), -ca.inf, np.nan, x + 1e300)])
    np.testing.assert_array_equal(compiled(function)(3.0), [3.0, -np.inf, np.nan, 1e300])
