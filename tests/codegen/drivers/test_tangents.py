"""Products with the Jacobian of a function, carried out as their C statements say, against CasADi's Jacobian."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.codegen.drivers.tangents import (
    JacobianProduct,
    Tangents,
    accumulated_jacobian,
    jacobian_product,
)

ALONG = {"state": Tangents("state_tangent"), "gains": Tangents("direction", (0, 2))}
numbers = st.floats(0.1, 2.0)


def function() -> ca.Function:
    """Two outputs through one bottleneck; gains[1] is not differentiated by; the last output does not move."""
    state, gains = ca.SX.sym("state", 3), ca.SX.sym("gains", 3)
    bottleneck = ca.tanh(gains[0] * state[0] + gains[1] * state[1] * state[2] + ca.sqrt(state[2]) * gains[2])
    following = ca.vertcat(bottleneck**2, bottleneck / state[0], ca.fmax(bottleneck, 0.5) - state[1], gains[1])
    return ca.Function("law", [state, gains], [following, state[1]], ["state", "gains"], ["following", "unused"])


def carried_out(
    product: JacobianProduct, state: np.ndarray, gains: np.ndarray, along: np.ndarray, seeds: np.ndarray
) -> list:
    names = {
        "VECTORS": 1,
        "v": 0,
        "ZEROS": 0.0,
        "LANES": 1,
        "slopes": np.array(product.slopes(state, gains)).ravel(),
        "state_tangent": along,
        "direction": seeds,
        "following_tangent": [0.0] * 4,
    }
    declared, *statements = product.statements()
    assert declared == "Vector joint_0[TOGETHER];"
    names["joint_0"] = [0.0]
    for statement in statements:
        exec(statement.removeprefix("EACH_VECTOR ").rstrip(";"), names)  # noqa: S102 - what was just generated
    return names["following_tangent"]


@given(st.lists(numbers, min_size=11, max_size=11))
def test_the_statements_are_the_jacobian(drawn: list[float]) -> None:
    state, gains, along, seeds = np.array(drawn[:3]), np.array(drawn[3:6]), np.array(drawn[6:9]), np.array(drawn[9:])
    law = function()
    symbols = [ca.SX.sym("state", 3), ca.SX.sym("gains", 3)]
    following = law.call(symbols)[0]
    by = ca.vertcat(symbols[0], symbols[1][0], symbols[1][2])
    jacobian = np.array(ca.Function("jacobian", symbols, [ca.jacobian(following, by)])(state, gains))
    moved = carried_out(jacobian_product(law, ALONG, ["following"]), state, gains, along, seeds)
    assert moved == pytest.approx(jacobian @ np.concatenate([along, seeds]), rel=1e-11, abs=1e-14)


@given(st.lists(numbers, min_size=6, max_size=6))
def test_accumulated_partial_derivatives_are_the_jacobian(drawn: list[float]) -> None:
    law, symbols = function(), [ca.SX.sym("state", 3), ca.SX.sym("gains", 3)]
    columns = [("gains", 2), ("state", 0), ("state", 1), ("state", 2)]
    ours = accumulated_jacobian(law, dict(zip(law.name_in(), symbols, strict=True)), columns, "following")
    theirs = ca.jacobian(law.call(symbols)[0], ca.vertcat(symbols[1][2], symbols[0]))
    both = ca.Function("both", symbols, [ours, theirs])(drawn[:3], drawn[3:])
    assert np.array(both[0]) == pytest.approx(np.array(both[1]), rel=1e-12, abs=1e-14)


def test_what_does_not_move_is_named() -> None:
    product = jacobian_product(function(), ALONG, ["following"])
    assert product.still == {("following", 3)}
    assert product.statements()[-1] == "EACH_VECTOR following_tangent[3*VECTORS + v] = ZEROS;"
