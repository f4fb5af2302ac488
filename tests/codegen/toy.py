"""A small sampled system that knows nothing of winches: a damped oscillator with a limit on its position."""

import casadi as ca


def oscillator(*, shortcut: bool = False) -> ca.Function:
    """``step(state, exogenous, parameters) -> (next_state, row, margin[, valid])``; leaves beyond |x| = 1."""
    state, exogenous, parameters = ca.SX.sym("state", 2), ca.SX.sym("exogenous", 1), ca.SX.sym("parameters", 3)
    x, v = ca.vertsplit(state)
    stiffness, mass, dt = ca.vertsplit(parameters)
    # written so that a shortcut and the step it stands for share every operation
    acceleration = (exogenous - stiffness * x) / (2 * mass)
    following = ca.vertcat(x + dt * v, v + dt * acceleration)
    outputs = {"next_state": following, "row": ca.vertcat(x, acceleration), "margin": 1 - ca.fabs(following[0])}
    if shortcut:
        outputs["valid"] = ca.if_else(x > 0, 1, -1)
    inputs = {"state": state, "exogenous": exogenous, "parameters": parameters}
    name = "shortcut" if shortcut else "step"
    return ca.Function(name, list(inputs.values()), list(outputs.values()), list(inputs), list(outputs))
