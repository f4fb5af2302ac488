"""Sensitivities of a small sampled system, against the derivative of the same loop taken by CasADi as a whole."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.rollout import compile_rollout
from dualwinch.codegen.drivers.sensitivity import Varied, compile_sensitivity
from dualwinch.codegen.sampled import Sampled
from dualwinch.codegen.source.c_source import LANES
from tests.codegen.toy import oscillator

SAMPLES, GAINS = 40, (3, 4)
TANH = 1e-8
"""Relative error allowed where slopes hold a tanh in lanes, good to 1e-9."""
PARAMETERS = np.array([40.0, 0.5, 0.01, 2.0, 0.7])


def controlled(*, one_step: bool) -> Sampled:
    """The oscillator under a proportional force with a limit, on the measured position; its gains are p[3], p[4]."""
    plant = oscillator(one_step=one_step)
    state, exogenous, parameters = ca.SX.sym("state", 3), ca.SX.sym("exogenous", 1), ca.SX.sym("parameters", 5)
    at_sample = {"state": state, "exogenous": exogenous, "parameters": parameters}
    wanted = parameters[3] * ca.tanh(exogenous - parameters[4] * state[0])
    outputs = {"discrete": state[2] + wanted**2, "hold": 3 * wanted}
    between = {"motion": ca.SX.sym("m", 2), "hold": ca.SX.sym("h"), "part": ca.SX.sym("i"), "parameters": parameters}

    def plain(function: ca.Function) -> ca.Function:
        given = [between[name] if name != "parameters" else parameters[:3] for name in function.name_in()]
        kept = [between[name] for name in function.name_in()]
        return ca.Function(function.name(), kept, function.call(given), function.name_in(), function.name_out())

    return replace(
        plant,
        sample=ca.Function("sample", list(at_sample.values()), list(outputs.values()), list(at_sample), list(outputs)),
        observe=ca.Function("observe", list(at_sample.values()), [state[:2]], list(at_sample), ["row"]),
        move=plain(plant.move),
        one_step=plain(plant.one_step) if plant.one_step else None,
    )


def by_casadi(system: Sampled, exogenous: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Final state and its Jacobian by the gains, of the loop unrolled."""
    gains = ca.SX.sym("gains", 2)
    parameters = ca.vertcat(ca.DM(PARAMETERS[:3]), gains)
    state = ca.SX(start)
    for outside in exogenous:
        discrete, hold = system.sample(state, outside, parameters)
        state = ca.vertcat(system.move(state[:2], hold, 0, parameters)[0], discrete)
    whole = ca.Function("whole", [gains], [state, ca.jacobian(state, gains)])
    final, slopes = whole(PARAMETERS[3:])
    return np.array(final).ravel(), np.array(slopes)


@pytest.mark.parametrize("one_step", [False, True])
@pytest.mark.parametrize("samples", [SAMPLES, LANES, 1])
def test_tangents_are_those_of_the_whole_loop(*, one_step: bool, samples: int) -> None:
    system = controlled(one_step=one_step)
    run = compile_sensitivity(system, system, Varied(GAINS))
    exogenous, start = np.sin(np.arange(samples))[:, None], np.array([0.3, 0.0, 0.0])
    directions, state, tangent = (
        np.zeros((2, run.varied.directions)),
        start.copy(),
        np.zeros((3, run.varied.directions)),
    )
    directions[:, :2], directions[:, 3] = np.eye(2), (1.0, -2.0)
    outcome, done, x, tangents, *_ = run(PARAMETERS, directions, exogenous, state, tangent)
    final, slopes = by_casadi(system, exogenous, start)
    assert (outcome, done) == (Outcome.COMPLETED, samples)
    assert state == pytest.approx(final, rel=1e-12)
    assert tangent[:, :2] == pytest.approx(slopes, rel=TANH, abs=1e-15)
    assert tangent[:, 3] == pytest.approx(slopes @ (1.0, -2.0), rel=TANH, abs=1e-15)
    plain = start.copy()
    rows = compile_rollout(system)(PARAMETERS, exogenous, plain)[2]
    assert x == pytest.approx(rows[:, 0], rel=1e-12)
    assert tangents.shape == (samples, run.varied.directions)


def test_more_gains_take_more_directions() -> None:
    assert Varied(tuple(range(8))).directions == 8
    assert Varied(tuple(range(6)), signals=(0, 1)).directions == 8
    assert Varied(tuple(range(8)), signals=(0,)).directions == 12
    assert Varied(tuple(range(17))).directions == 20
    assert Varied(tuple(range(32))).directions == 32


def test_numbers_beyond_what_a_call_takes_are_spread_evenly_over_calls() -> None:
    assert Varied(tuple(range(33))).directions == 20
    assert Varied(tuple(range(60))).directions == 32


def test_a_tangent_may_overflow_and_the_run_goes_on() -> None:
    system = controlled(one_step=False)
    run = compile_sensitivity(system, system, Varied(GAINS))
    directions, tangent = np.full((2, run.varied.directions), 1e308), np.full((3, run.varied.directions), 1e308)
    outcome, done, *_ = run(PARAMETERS, directions, np.zeros((20, 1)), np.array([0.3, 0.0, 0.0]), tangent, 0)
    assert (outcome, done) == (Outcome.COMPLETED, 20)


def test_plant_signals_and_columns() -> None:
    """Of what acts between the samples too, and of what comes from outside; rows come with their tangents."""
    for one_step in (False, True):
        system, samples = controlled(one_step=one_step), SAMPLES + 3
        run = compile_sensitivity(system, system, Varied((0, 2, 4), signals=(0,), columns=(1, 0)))
        exogenous, state = np.sin(np.arange(samples))[:, None], np.array([0.3, 0.1, 0.0])
        directions, tangent = np.zeros((3, run.varied.directions)), np.zeros((3, run.varied.directions))
        directions[:, :3], moved = np.eye(3), np.zeros((samples, 1, run.varied.directions))
        moved[:, 0, 3] = np.cos(np.arange(samples))  # of a signal whose phase is the fourth number
        numbers = np.array([*PARAMETERS[[0, 2, 4]], 0.0])
        start = state.copy()
        found = run(PARAMETERS, directions, exogenous, state, tangent, 3, moved)
        for number in range(4):
            ends = []
            for sign in (1, -1):
                at = numbers.copy()
                at[number] += sign * 1e-6 * (abs(at[number]) or 1.0)
                parameters = PARAMETERS.copy()
                parameters[[0, 2, 4]] = at[:3]
                outside, reached = np.sin(np.arange(samples) + at[3])[:, None], start.copy()
                ends.append(compile_rollout(system)(parameters, outside, reached, 3)[2])
            quotient = (ends[0] - ends[1]) / (2e-6 * (abs(numbers[number]) or 1.0))
            ours = found.row_tangents[:, ::-1, number]
            assert ours == pytest.approx(quotient, abs=1e-5 * np.abs(quotient).max()), number
        rows = compile_rollout(system)(PARAMETERS, exogenous, start.copy(), 3)[2]
        assert found.rows[:, ::-1] == pytest.approx(rows, rel=1e-9, abs=1e-12)
        assert found.row_tangents[:, 1] == pytest.approx(found.state_tangents, rel=1e-12)
