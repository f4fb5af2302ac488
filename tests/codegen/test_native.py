import copy
import pickle
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from dualwinch.codegen import native
from dualwinch.codegen.errors import CodegenError, CodegenWarning
from dualwinch.codegen.native import BoundFunction
from dualwinch.codegen.native import compile as compiled

MATRIX, VECTOR, NUMBER = ca.MX.sym("A", 2, 3), ca.MX.sym("y", 3), ca.MX.sym("z")
AFFINE = ca.Function(
    "affine",
    [MATRIX, VECTOR, NUMBER],
    [ca.mtimes(MATRIX, VECTOR) * NUMBER, MATRIX.T + NUMBER],
    ["A", "y", "z"],
    ["p", "q"],
)


def test_batches_broadcast_and_give_what_the_interpreter_gives() -> None:
    random = np.random.default_rng(0)
    A, y, z = random.normal(size=(5, 2, 3)), random.normal(size=3), random.normal(size=(4, 1))
    p, q = compiled(AFFINE)(A, y, z=z)
    assert (p.shape, q.shape) == ((4, 5, 2), (4, 5, 3, 2))
    for i in range(4):
        for j in range(5):
            expected = AFFINE(A[j], y, z[i, 0])
            np.testing.assert_array_equal(p[i, j], np.array(expected[0]).ravel())
            np.testing.assert_array_equal(q[i, j], np.array(expected[1]))


def test_one_call_needs_no_batch_and_one_output_no_tuple() -> None:
    x = ca.SX.sym("x", 3)
    norm = compiled(ca.Function("norm", [x], [ca.sumsqr(x)]))
    assert norm([1, 2, 3]) == 14.0
    assert np.shape(norm(np.ones((2, 0, 3)))) == (2, 0)


def test_numbers_that_are_none_pass_through() -> None:
    x = ca.SX.sym("x")
    logarithm = compiled(ca.Function("logarithm", [x], [ca.log(x)]))
    np.testing.assert_array_equal(logarithm([0.0, np.nan, np.inf]), [-np.inf, np.nan, np.inf])


@pytest.mark.parametrize("part", [1, 7, 100])
def test_a_long_function_in_parts_gives_what_the_interpreter_gives(part: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native, "PART", part)
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y")
    value, past = ca.vertcat(x, y), ca.SX.zeros(4)
    for k in range(12):
        value, past = ca.sqrt(1 + value**2 + past * x[k % 3]), value / (1 + past**2)
    function = ca.Function("long_one", [x, y], [value, ca.jacobian(past, x), x], ["x", "y"], ["value", "slope", "same"])
    given, other = np.random.default_rng(3).normal(size=(5, 3)), 0.7
    found = compiled(function)(given, other)
    for row in range(5):
        for result, expected in zip(found, function(given[row], other), strict=True):
            np.testing.assert_array_equal(result[row], expected.full().reshape(result[row].shape))


@pytest.mark.parametrize(
    ("arguments", "named", "message"),
    [
        (([[1.0]], [1, 2, 3], 1), {}, r"A: shape \(1, 1\) must be \(..., 2, 3\)"),
        ((np.ones((2, 3)),), {"z": 1}, r"affine\(\) misses y"),
        ((np.ones((2, 3)),), {"A": 1}, r"takes twice the argument 'A'"),
        ((), {"b": 1}, r"no argument 'b'; its arguments are A, y, z"),
        ((1, 2, 3, 4), {}, r"takes 3 arguments \(A, y, z\), 4 given"),
    ],
)
def test_wrong_arguments_are_named(arguments, named, message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        compiled(AFFINE)(*arguments, **named)


def test_what_has_no_c_of_ours_is_casadi_s() -> None:
    """A solver of equations, a table, and a call that is not inlined."""
    x, y = ca.MX.sym("x"), ca.SX.sym("y")
    root = ca.rootfinder("root", "fast_newton", {"x": x, "g": x**2 - 2})
    table = ca.interpolant("table", "bspline", [[0, 1, 2, 3, 4]], [0, 1, 4, 9, 16])
    inner = ca.Function("inner", [y], [ca.sin(y), ca.cos(y)], {"never_inline": True})
    outer = ca.Function("outer", [y], [inner(y)[0] * 3 + inner(2 * y)[1]])
    solved = ca.Function("solved", [x], [root(x, ca.DM(0, 0))])
    for function in (solved, table, outer):
        with pytest.warns(CodegenWarning, match=f"^no C of our own for {function.name()}_: .*; CasADi's is used"):
            called = compiled(function)
        at = np.array([0.5, 1.0, 2.5])
        arguments = [at] * function.n_in()
        np.testing.assert_array_equal(called(*arguments), np.array(function(*arguments)).ravel())


def test_what_has_no_c_at_all_is_refused() -> None:
    x = ca.MX.sym("x")
    root = ca.rootfinder("root", "newton", {"x": x, "g": x**2 - 2})
    with (
        pytest.raises(CodegenError, match="no C for root_: Code generation not supported for Newton"),
        pytest.warns(CodegenWarning),
    ):
        compiled(root)
    with pytest.raises(CodegenError, match="must have an input and an output"):
        compiled(ca.Function("nothing", [], [ca.DM(1)]))


def test_a_bound_function_gives_what_a_call_gives_in_arrays_of_its_own() -> None:
    x, A = ca.SX.sym("x", 2), ca.SX.sym("A", 2, 3)
    function = ca.Function("f", [x, A], [A.T @ x, ca.exp(A)], ["x", "A"], ["y", "z"])
    made, rng = compiled(function), np.random.default_rng(1)
    given = {"x": rng.normal(size=(5, 2)), "A": rng.normal(size=(5, 2, 3))}
    bound = made.bind((5,))
    for name, array in bound.inputs.items():
        array[...] = given[name]
    bound()
    for mine, expected in zip(bound.outputs.values(), made(**given), strict=True):
        assert mine.tolist() == expected.tolist()
    fixed = made.bind(A=given["A"][0])
    fixed.inputs["x"][:] = given["x"][0]
    fixed()
    assert fixed.outputs["y"] == pytest.approx(made(given["x"][0], given["A"][0])[0], rel=1e-15)
    with pytest.raises(TypeError, match="no argument 'B'"):
        made.bind(B=1)
    with pytest.raises(ValueError, match="A: shape"):
        made.bind(A=np.zeros((3, 3)))


def test_a_compiled_function_pickles_by_being_compiled_again() -> None:
    x = ca.SX.sym("x", 2)
    made = compiled(ca.Function("f", [x], [2 * x]))
    for again in (pickle.loads(pickle.dumps(made)), copy.deepcopy(made)):  # noqa: S301
        assert np.array_equal(again([1.0, 2.0]), [2.0, 4.0])


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda bound: pickle.loads(pickle.dumps(bound))])  # noqa: S301
def test_a_copy_of_a_bound_function_has_arrays_of_its_own(again: Callable[[BoundFunction], BoundFunction]) -> None:
    x, A = ca.SX.sym("x"), ca.SX.sym("A", 2, 3)
    bound = compiled(ca.Function("f", [x, A], [x * A], ["x", "A"], ["y"])).bind((4,))
    bound.inputs["x"][:], bound.inputs["A"][...] = [1, 2, 3, 4], np.arange(6).reshape(2, 3)
    bound()
    other = again(bound)
    assert other.outputs["y"].tolist() == bound.outputs["y"].tolist()
    other.inputs["x"][:] = -1
    other()
    assert other.outputs["y"].tolist() == [(-np.arange(6).reshape(2, 3)).tolist()] * 4
    assert bound.inputs["x"].tolist() == [1, 2, 3, 4]
    assert bound.outputs["y"][3].tolist() == (4 * np.arange(6).reshape(2, 3)).tolist()
