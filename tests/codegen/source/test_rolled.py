"""Functions that repeat themselves, as loops in C: bit for bit what the same statements give one after the other."""

import ctypes
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.source.loops import loops, rolled_statements
from dualwinch.codegen.source.operations import Style
from dualwinch.codegen.source.statements import statements
from tests.tiers import examples

BUILD = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1", "-ffp-contract=off", "-shared", "-fPIC")


def values_in_c(folder: Path, function: ca.Function, lines: list[str], at: np.ndarray) -> np.ndarray:
    """The result of a function's statements."""
    text = "\n".join(["#include <math.h>", "void call(const double *x, double *y) {", *lines, "}", ""])
    (folder / "unit.c").write_text(text)
    library = folder / f"unit{abs(hash(text))}.so"
    subprocess.run([*find_compiler().command, *BUILD, "unit.c", "-o", library, "-lm"], cwd=folder, check=True)
    y = np.empty(function.numel_out(0))
    ctypes.CDLL(str(library))["call"](ctypes.c_void_p(at.ctypes.data), ctypes.c_void_p(y.ctypes.data))
    return y


def recurrence(body: list[tuple[int, int, int]], rounds: int, taken: list[int]) -> ca.Function:
    """Rounds of operations on what the last two rounds gave, on this one's own values and on constants of the run.

    Args:
        body: operation and operands of each position; an operand counts back from the values there are.
        rounds: how many.
        taken: which of all values are results.
    """
    x = ca.SX.sym("x", 4)
    fixed, values = [x[0] * x[1], ca.sin(x[2]), x[3]], [x[0], x[1], x[2], x[3]] * len(body)
    for _ in range(rounds):
        for operation, left, right in body:
            first = values[-1 - left % (2 * len(body))]
            second = fixed[right % 3] if right % 4 == 0 else values[-1 - right % (2 * len(body))]
            values.append([first + second, first * second, ca.cos(first) - second][operation])
    results = [values[-1 - back % (2 * len(body))] for back in taken]
    return ca.Function("recurrence", [x], [ca.vertcat(values[-1], *results)], ["x"], ["y"])


@examples(25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(st.tuples(st.integers(0, 2), st.integers(0, 99), st.integers(0, 99)), min_size=12, max_size=30),
    st.integers(3, 40),
    st.lists(st.integers(0, 99), max_size=5),
)
def test_a_loop_gives_the_bits_of_its_statements(
    tmp_path: Path, body: list[tuple[int, int, int]], rounds: int, taken: list[int]
) -> None:
    function, style = recurrence(body, rounds, taken), Style()
    at = np.array([0.3, -0.7, 1.1, 0.9])
    with np.errstate(all="ignore"):
        plain = values_in_c(tmp_path, function, statements(function, style), at)
        rolled = values_in_c(tmp_path, function, rolled_statements(function, style), at)
    np.testing.assert_array_equal(rolled, plain)


@pytest.mark.parametrize("rounds", [30, 31])
def test_what_repeats_itself_is_written_once(tmp_path: Path, rounds: int) -> None:
    """Newton's method on a matrix' inverse: every round reads the last one and the matrix."""
    x = ca.SX.sym("x", 4)
    matrix = ca.reshape(x, 2, 2)
    inverse = ca.SX.eye(2) / 2
    for _ in range(rounds):
        inverse = ca.mtimes(inverse, 2 * ca.SX.eye(2) - ca.mtimes(matrix, inverse))
    function = ca.Function("inverse", [x], [ca.vec(ca.cse(inverse))], ["x"], ["y"])
    at = np.array([0.9, 0.2, -0.1, 1.2])
    plain, rolled = statements(function, Style()), rolled_statements(function, Style())
    assert len(rolled) < 0.25 * len(plain)
    found = values_in_c(tmp_path, function, rolled, at)
    np.testing.assert_array_equal(found, values_in_c(tmp_path, function, plain, at))
    np.testing.assert_allclose(found.reshape(2, 2).T @ at.reshape(2, 2).T, np.eye(2), atol=1e-12)


def test_what_does_not_repeat_itself_is_left_alone() -> None:
    x = ca.SX.sym("x", 300)
    function = ca.Function("sines", [x], [ca.sin(x)], ["x"], ["y"])
    assert loops(function) == []
    assert rolled_statements(function, Style()) == statements(function, Style())
