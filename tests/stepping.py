"""Steps of a block from many states: where to begin, and what CasADi's interpreter says of them."""

import casadi as ca
import numpy as np

from dualwinch.codegen.block import Block


def values(variables) -> np.ndarray:
    return np.array([variable.start for variable in variables])


def interpreted(made: Block, states: np.ndarray, inputs: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """Next states and outputs (n, states + outputs) by CasADi's interpreter."""
    following, outputs = made.step.map(len(states))(states.T, inputs.T, ca.repmat(ca.DM(parameters), 1, len(states)))
    return np.hstack([np.array(following).T, np.array(outputs).T])


def plausible(made: Block, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Random states and inputs around those of a run."""
    random = np.random.default_rng(5)
    spread = {"m": 20.0, "rad": 25.0, "m/s": 1.0, "rad/s": 2.0, "N": 2000.0, "N m": 40.0, "N s": 500.0, "1": 1.0}

    def draws(variables) -> np.ndarray:
        scale = np.array([spread.get(variable.unit, 0.1) for variable in variables])
        return values(variables) + scale * random.standard_normal((samples, len(variables)))

    return draws(made.states), draws(made.inputs)
