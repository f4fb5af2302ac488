"""A small sampled system that knows nothing of winches: a damped oscillator with a limit on its position."""

from functools import cache

import casadi as ca

from dualwinch.codegen.sampled import Sampled


@cache
def oscillator(*, one_step: bool = False) -> Sampled:
    """Position and speed under a force in zero-order hold, and the number of samples; it leaves beyond |x| = 1."""
    state, exogenous, parameters = ca.SX.sym("state", 3), ca.SX.sym("exogenous", 1), ca.SX.sym("parameters", 3)
    motion, hold, part = ca.SX.sym("motion", 2), ca.SX.sym("hold", 1), ca.SX.sym("part")
    stiffness, mass, dt = ca.vertsplit(parameters)

    def acceleration(x: ca.SX, force: ca.SX) -> ca.SX:
        return (force - stiffness * x) / (2 * mass)

    def function(name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX]) -> ca.Function:
        return ca.Function(name, list(inputs.values()), list(outputs.values()), list(inputs), list(outputs))

    at_sample = {"state": state, "exogenous": exogenous, "parameters": parameters}
    between = {"motion": motion, "hold": hold, "parameters": parameters}
    x, v = ca.vertsplit(motion)
    following = ca.vertcat(x + dt * v, v + dt * acceleration(x, hold))
    moved = {"next_motion": following, "margin": 1 - ca.fabs(following[0])}
    return Sampled(
        sample=function("sample", at_sample, {"discrete": state[2] + 1, "hold": exogenous}),
        observe=function("observe", at_sample, {"row": ca.vertcat(state[0], acceleration(state[0], exogenous))}),
        move=function("move", {"motion": motion, "hold": hold, "part": part, "parameters": parameters}, moved),
        parts=1,
        one_step=function("one_step", between, moved | {"valid": ca.if_else(x > 0, 1, -1)}) if one_step else None,
    )
