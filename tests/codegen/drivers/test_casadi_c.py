"""A system with a function that only CasADi has C for: a table. Every driver runs it."""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from dualwinch.codegen.drivers.batch import LANES, compile_batch
from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.rollout import compile_rollout
from dualwinch.codegen.drivers.signals.signals import Signals
from dualwinch.codegen.drivers.stepping import Commanded, SteppedRuns, compile_stepping
from dualwinch.codegen.errors import CodegenWarning
from dualwinch.codegen.sampled import Sampled
from tests.codegen.toy import oscillator

SAMPLES = 200
START = [0.3, -0.2, 0.0]
TABLE = ca.interpolant("table", "bspline", [[-3, -1, 0, 1, 3]], [-2, -0.5, 0, 0.5, 2])


def tabled(*, one_step: bool) -> Sampled:
    """The oscillator, its force read from a table: what it holds is the table's value of the force outside."""
    plain = oscillator(one_step=one_step)
    inputs = plain.sample.sx_in()
    discrete, hold = plain.sample.call(inputs)
    results = [discrete, TABLE(hold)]
    names = plain.sample.name_in(), plain.sample.name_out()
    return replace(plain, sample=ca.Function("sample", inputs, results, *names))


def forces() -> np.ndarray:
    return 3 * np.sin(np.arange(SAMPLES) / 9)


def expected(one_step: bool, parameters: list[float]) -> np.ndarray:
    """The rows, by the plain oscillator under the table's values."""
    held = np.array([float(TABLE(force)) for force in forces()])[:, np.newaxis]
    rows = compile_rollout(oscillator(one_step=one_step))(np.array(parameters), held, np.array(START))[2]
    return rows[:, 0]


@pytest.mark.parametrize("one_step", [False, True])
@pytest.mark.parametrize("generator", ["dualwinch", "casadi"])
def test_a_rollout(generator: Any, one_step: bool, recwarn: pytest.WarningsRecorder) -> None:
    parameters = [4.0, 0.5, 0.02]
    if generator == "dualwinch":
        with pytest.warns(CodegenWarning, match="no C of our own for sample: there is none for its 'call'"):
            run = compile_rollout(tabled(one_step=one_step))
    else:
        run = compile_rollout(tabled(one_step=one_step), generator="casadi")
        assert not recwarn.list
    outcome, done, rows = run(np.array(parameters), forces()[:, np.newaxis], np.array(START))
    assert (outcome, done) == (Outcome.COMPLETED, SAMPLES)
    np.testing.assert_allclose(rows[:, 0], expected(one_step, parameters), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("one_step", [False, True])
def test_lanes_each_with_its_own_parameters(one_step: bool) -> None:
    with pytest.warns(CodegenWarning, match="CasADi's is used, without vector lanes"):
        batch = compile_batch(tabled(one_step=one_step), rows=True)
    parameters = np.array([[4.0 + lane / 4, 0.5, 0.02] for lane in range(LANES)])
    signals = Signals([None])
    signals.give([forces()])
    outcomes, _, rows = batch(parameters, [signals] * LANES, np.tile(START, (LANES, 1)), SAMPLES, stride=1)
    assert (outcomes == Outcome.COMPLETED).all()
    for lane in range(LANES):
        wanted = expected(one_step, parameters[lane].tolist())
        np.testing.assert_allclose(rows[lane, :, 0], wanted, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("exact", [False, True])
def test_steps_under_commands(exact: bool) -> None:
    """Lanes and single runs end in the same state."""
    system = tabled(one_step=True)
    inputs = system.sample.sx_in()
    sense = ca.Function("sense", inputs, inputs[:1], system.sample.name_in(), ["observation"])
    with pytest.warns(CodegenWarning, match="no C of our own for sample"):
        code = compile_stepping(Commanded(system, sense, ((2,),)), exact=exact)
    count = 20
    runs = SteppedRuns(code, count, SAMPLES, shared=True)
    table = np.append(forces(), 0.0)[:, np.newaxis].copy()
    runs.start(np.arange(count), np.tile(START, (count, 1)), np.tile([4.0, 0.5, 0.02], (count, 1)))
    runs.read(np.arange(count), np.full(count, table.ctypes.data, np.uint64))
    runs.step(SAMPLES)
    held = np.array([float(TABLE(force)) for force in forces()])[:, np.newaxis]
    state = np.array(START)
    compile_rollout(oscillator(one_step=True))(np.array([4.0, 0.5, 0.02]), held, state, 0)
    np.testing.assert_allclose(runs.states(np.arange(count))[:, :2], np.tile(state[:2], (count, 1)), rtol=1e-7)
