"""Every operation that CasADi's SX expressions can hold, each as a function, and numbers to try it on."""

import casadi as ca
import numpy as np

EXPONENT = 3.5
"""What a constant power is tried with."""

INTERESTING = [0.0, 0.3, 0.5, 0.99, 1.0, 2.0, 2.5, 3.5, 7.0, 1e-3, 1e-8, 20.0, 1e4]
NUMBERS = np.array([sign * value for sign in (1.0, -1.0) for value in INTERESTING])
SPECIAL = np.array([np.inf, -np.inf, np.nan, 5e-324, 1e300, -1e300, 1e-300])
"""Beside the numbers: what is none, and what lies at the ends of the range of doubles."""


def functions() -> dict[int, ca.Function]:
    """Operation → ``op_NAME(x, y) -> z``; what SX does not know, CasADi makes a constant or an operand of."""
    found = {}
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    for name in dir(ca):
        if name.startswith("OP_"):
            operation = getattr(ca, name)
            z = x**EXPONENT if operation == ca.OP_CONSTPOW else ca.SX.binary(operation, x, y)
            function = ca.Function(f"op_{name.removeprefix('OP_').lower()}", [x, y], [z], ["x", "y"], ["z"])
            if operation in {function.instruction_id(index) for index in range(1, function.n_instructions() - 1)}:
                found[operation] = function
    return found


def pairs(*values: np.ndarray) -> np.ndarray:
    """Every number beside every other one, (n, 2)."""
    together = np.concatenate(values)
    return np.stack(np.meshgrid(together, together), axis=-1).reshape(-1, 2)


def interpreted(function: ca.Function, at: np.ndarray) -> np.ndarray:
    """A function at pairs (n, 2), by CasADi's interpreter."""
    return np.array(function.map(len(at))(at[:, :1].T, at[:, 1:].T)).ravel()
