"""A sample with its derivatives by the chain rule over its parts, beside CasADi's Jacobian of the whole step."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import dualwinch as dw
from dualwinch.analysis.differentiated_sample import DifferentiatedSample
from dualwinch.simulation.loop.closed_loop import ClosedLoop, closed_loop
from dualwinch.simulation.loop.structure import structure_of
from dualwinch.simulation.prepare import prepare


def results_of(loop: ClosedLoop) -> ca.Function:
    """The discrete states and the zero-order hold of a loop's sample."""
    arguments = [ca.SX.sym(name, loop.sample.size1_in(name)) for name in loop.sample.name_in()]
    discrete, hold = loop.sample(*arguments)
    return ca.Function("results", arguments, [discrete, hold], loop.sample.name_in(), ["values", "hold"])


@pytest.mark.parametrize(
    ("changes", "slack"),
    [
        ({"simulation.integrator": "rk4", "simulation.substeps": 3}, False),
        ({"simulation.integrator": "adaptive"}, False),  # in one step
        ({"simulation.integrator": "adaptive"}, True),  # in all parts
    ],
)
@pytest.mark.parametrize("compiled", [False, True])
def test_derivatives_are_those_of_the_whole_step(changes: dict[str, object], slack: bool, compiled: bool) -> None:
    prepared = prepare(dw.override(dw.case(4), changes))
    loop = closed_loop(prepared.structure)
    state, outside = prepared.state, np.zeros(len(loop.exogenous))
    state[loop.states.index("motion.plant.v")] = 0.3
    if slack:
        state[loop.states.index("motion.plant.theta_1")] -= 1.0
    vectors = state, outside, loop.vector(prepared.parameters)
    columns = [("state", index) for index in range(0, len(state), 9)] + [("exogenous", 0)]
    sample = DifferentiatedSample(loop, results_of(loop), columns, compiled=compiled)
    moved, at_sample = sample(*(np.array([vector, vector]) for vector in vectors))

    symbols = [ca.SX.sym(name, loop.step.size1_in(name)) for name in loop.step.name_in()]
    following = loop.step(*symbols)[0]
    by = ca.vertcat(*(symbols[name == "exogenous"][index] for name, index in columns))
    whole = ca.Function("whole", symbols, [following, ca.jacobian(following, by)])
    values, slopes = (result.full() for result in whole(*vectors))
    for row in range(2):
        np.testing.assert_allclose(np.append(moved.values[row], at_sample.values[row]), values[:, 0], rtol=1e-12)
        chained = np.concatenate([moved.slopes[row], at_sample.slopes[row]])
        np.testing.assert_allclose(chained, slopes, rtol=1e-9, atol=1e-12 * np.abs(slopes).max())


def test_the_code_is_as_long_for_many_parts_as_for_one(monkeypatch: pytest.MonkeyPatch) -> None:
    lengths = list[int]()
    monkeypatch.setattr(
        "dualwinch.analysis.differentiated_sample.repeated",
        lambda function, *_: lengths.append(function.n_instructions()),
    )
    case = dw.override(dw.case(4), {"simulation.integrator": "rk4"})
    for parts in (4, 64):
        loop = closed_loop(structure_of(replace(case, simulation=replace(case.simulation, substeps=parts))))
        DifferentiatedSample(loop, results_of(loop), [("state", 0)], compiled=False)
    assert lengths[1] == pytest.approx(lengths[0], abs=3)
