"""What a controller costs a computer: the arithmetic operations of one sample."""

import casadi as ca

from dualwinch.codegen.source.instructions import instructions
from dualwinch.controllers.controller import controller_function
from dualwinch.simulation.experiment import Experiment

FREE = frozenset({ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, ca.OP_ASSIGN})
"""Instructions that compute nothing."""


def operations(experiment: Experiment) -> int:
    """Number of operations that the controller of an experiment takes a sample, an exponential counted like a sum.

    What follows from gains, nominal plant and sample time alone is worked out beforehand, as in exported controllers.
    """
    controller = controller_function(experiment.controller, experiment.plant)
    arguments = [ca.SX.sym(name, controller.size1_in(name)) for name in controller.name_in()[:-1]]
    results = controller.call([*arguments, ca.SX(experiment.simulation.sample_time)])
    found = instructions(ca.Function("sample", arguments, results))
    return sum(instruction.operation not in FREE for instruction in found)
