"""A wide loop is the closed loop with a delay that is a number."""

from dataclasses import replace

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import initial_state_of
from dualwinch.simulation.loop.engine import interpreter
from dualwinch.simulation.loop.structure import parameters_of
from dualwinch.toolboxes.lab.wasm.settings import LAGS, OFF_AT_ZERO, SHORTEST_LAG, wide, wide_loop

SAMPLES = 300


@pytest.mark.parametrize("delay", [0, 1])
def test_the_delay_is_a_number(delay: int) -> None:
    plain = dw.case(4)
    late = dw.override(plain, {"simulation.delay_samples": delay})
    broad = wide(plain)
    without = dict.fromkeys(OFF_AT_ZERO, 0.0) | dict.fromkeys(LAGS, SHORTEST_LAG) | {"simulation.jitter": 0.0}
    values = parameters_of(broad) | without
    loop = wide_loop(broad)
    parameters = np.array([*values.values(), float(delay)])
    state = np.array(list(initial_state_of(broad).values()))
    _, _, rows = interpreter(loop)(parameters, exogenous_signals(plain)[:SAMPLES], state, 1)
    found = dict(zip(loop.closed.columns, rows.T, strict=True))
    expected = dw.simulate(cut_short(late))
    for name, column in expected.columns.items():
        np.testing.assert_allclose(found[name], column, rtol=1e-9, atol=1e-9 * max(np.abs(column).max(), 1e-3))


def cut_short(experiment: Experiment) -> Experiment:
    return replace(experiment, simulation=replace(experiment.simulation, duration=SAMPLES * 1e-3))
