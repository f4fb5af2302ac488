import casadi as ca
import numpy as np
import pytest

from dualwinch.codegen.source.hoist import hoisted
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.loop.closed_loop import closed_loop, initial_state_of
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.paper import CONTROLLERS, case
from tests.codegen.toy import oscillator


def divisions(function: ca.Function) -> int:
    kinds = [function.instruction_id(index) for index in range(function.n_instructions())]
    return kinds.count(ca.OP_DIV) + kinds.count(ca.OP_INV)


def test_divisions_by_parameters_become_products() -> None:
    move = oscillator().move
    derive, lean = hoisted(move)
    assert divisions(move) == 1
    assert divisions(lean) == 0
    assert divisions(derive) == 1


def test_divisions_by_the_same_become_products_with_one_reciprocal() -> None:
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p")
    divisor = ca.sin(x[2]) + p
    function = ca.Function("thirds", [x, p], [ca.vertcat(x[0], x[1], x[2]) / divisor], ["x", "parameters"], ["y"])
    derive, lean = hoisted(function)
    assert (divisions(function), divisions(lean)) == (3, 1)
    expected = np.array([1.0, 2.0, 3.0]) / (np.sin(3.0) + 4.0)
    assert np.array(lean([1, 2, 3], 4, derive(4))).ravel() == pytest.approx(expected, rel=1e-15)


def test_factors_that_are_parameters_become_one() -> None:
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 3)
    product = -(2 * (x[0] * p[0]) * x[1] * p[1]) / p[2]
    function = ca.Function("product", [x, p], [product], ["x", "parameters"], ["y"])
    derive, lean = hoisted(function)
    kinds = [lean.instruction_id(index) for index in range(lean.n_instructions())]
    assert (kinds.count(ca.OP_MUL), kinds.count(ca.OP_NEG), kinds.count(ca.OP_TWICE)) == (2, 0, 0)
    assert float(lean([3, 4], [5, 6, 7], derive([5, 6, 7]))) == pytest.approx(-2 * 3 * 5 * 4 * 6 / 7, rel=1e-15)


def test_a_function_with_nothing_to_hoist_is_left_alone() -> None:
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    function = ca.Function("sum", [x, p], [x + p], ["x", "parameters"], ["y"])
    derive, lean = hoisted(function)
    assert derive.numel_out("derived") == 0
    assert float(lean(2.0, 3.0, derive(3.0))) == 5.0


def test_a_division_of_parameters_alone_happens_once() -> None:
    x, p = ca.SX.sym("x"), ca.SX.sym("p", 2)
    function = ca.Function("ratio", [x, p], [x + ca.sin(p[0] / p[1])], ["x", "parameters"], ["y"])
    derive, lean = hoisted(function)
    assert lean.n_instructions() < function.n_instructions()
    assert float(lean(1.0, [0, 0], derive([1.0, 2.0]))) == pytest.approx(1 + np.sin(0.5), rel=1e-15)


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_the_closed_loop_stays_what_it_was(kind: str) -> None:
    """From states all along a run, relative to the largest value of each state."""
    experiment = case(4, kind)
    loop = closed_loop(structure_of(experiment))
    derive, lean = hoisted(loop.step)
    parameters = np.array(list(parameters_of(experiment).values()))
    state, derived = np.array(list(initial_state_of(experiment).values())), derive(parameters)
    pairs = []
    for exogenous in exogenous_signals(experiment)[:400]:
        plain = np.array(loop.step(state, exogenous, parameters)[0]).ravel()
        pairs.append((plain, np.array(lean(state, exogenous, parameters, derived)[0]).ravel()))
        state = plain
    ours, theirs = np.array(pairs).swapaxes(0, 1)
    assert (np.abs(ours - theirs) <= 1e-11 * np.abs(ours).max(axis=0)).all()
