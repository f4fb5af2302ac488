"""Kalman filter that learns the ropes: it finds their compliance, and with it the position."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.estimators.calibrating_kalman import CalibrationGains, RopeKnowledge, learn
from dualwinch.controllers.parts import Measurement
from dualwinch.controllers.registry import ESTIMATORS
from dualwinch.model.plant import Plant, resting_state, tensions
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.loop.closed_loop import closed_loop, initial_state_of
from dualwinch.simulation.loop.engine import engine_of
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.sensors import Sensors
from dualwinch.simulation.simulate import simulate

T, SIGMA = 1e-3, 6e-4
SEA = Sensors(position_noise=5e-4, position_resolution=1e-3, speed_noise=2e-3, tension_noise=10.0, encoder_counts=4096)
TRUE = {"rope_1": 0.92, "rope_2": 1.07}
"""Share of the nominal modulus that each rope has."""


def test_the_excess_is_that_of_regularised_least_squares() -> None:
    random, gains = np.random.default_rng(1), CalibrationGains(deviation=0.06, memory=1e12)
    stretch = random.uniform(1e-3, 4e-3, 500)
    seen = 1.08 * stretch + SIGMA * random.standard_normal(500)
    known = RopeKnowledge()
    for nominal, shown in zip(stretch, seen, strict=True):
        known = learn(known, nominal, shown, 1.0, SIGMA, gains, T)
    batch = (stretch @ (seen - stretch)) / (stretch @ stretch + SIGMA**2 / gains.deviation**2)
    assert known.excess == pytest.approx(batch, rel=1e-9)


def test_a_slack_rope_teaches_nothing_and_old_samples_fade() -> None:
    known = RopeKnowledge(0.05, 1e4)
    after = learn(known, 1e-3, 1.0, 0.0, SIGMA, CalibrationGains(memory=2.0), T)
    assert after.excess == known.excess
    assert after.information == pytest.approx(1e4 * np.exp(-T / 2))


def stretchy(estimator: str) -> tuple[Experiment, Plant]:
    """25 s of Case 4 with ropes that are not those of the plant the controller was designed for."""
    experiment = replace(
        case(4),
        controller=Controller(estimator=ESTIMATORS[estimator]()),
        sensors=SEA,
        simulation=Simulation(delay_samples=1, duration=25.0, seed=1),
    )
    ropes = {name: replace(getattr(experiment.plant, name), modulus=80e9 * share) for name, share in TRUE.items()}
    return replace(experiment, plant=replace(experiment.plant, **ropes)), experiment.plant


def ran(estimator: str) -> tuple[np.ndarray, dict[str, float]]:
    """Position errors in m of the estimate after 10 s of 25 s, and the final state."""
    drawn, nominal = stretchy(estimator)
    loop = closed_loop(structure_of(drawn))
    run, parameters = engine_of(loop), np.array(list(parameters_of(drawn, nominal).values()))
    state = np.array(list(initial_state_of(drawn).values()))
    prefix = "controller.estimator." + ("motion." if estimator == "calibrating-kalman" else "")
    estimate, truth = loop.states.index(prefix + "x"), loop.states.index("motion.plant.x")
    errors = []
    for now in exogenous_signals(drawn):
        run(parameters, now[np.newaxis], state, 0)
        errors.append(state[estimate] - state[truth])
    return np.array(errors[10_000:]), dict(zip(loop.states, state.tolist(), strict=True))


def test_it_finds_the_ropes_and_with_them_the_position() -> None:
    plain, _ = ran("kalman")
    calibrated, final = ran("calibrating-kalman")
    assert final["controller.estimator.rope_1.excess"] == pytest.approx(1 / TRUE["rope_1"] - 1, abs=0.01)
    assert np.mean(calibrated**2) < np.mean(plain**2) / 20


def test_what_it_has_learnt_and_estimates_is_in_the_result() -> None:
    drawn, nominal = stretchy("calibrating-kalman")
    result = simulate(drawn, nominal=nominal)
    names = ["x_est", "v_est", "d_est", "position_used", "speed_used", "excess_1", "excess_2"]
    assert list(result.columns)[-len(names) :] == names
    assert [result.units[name] for name in names] == ["m", "m/s", "m/s^2", "1", "1", "1", "1"]
    for number in (1, 2):
        learnt = result[f"excess_{number}"]
        assert abs(learnt[0]) < 0.01
        assert learnt[-1] == result.final_state[f"controller.estimator.rope_{number}.excess"]
    assert result["excess_1"][-1] == pytest.approx(1 / TRUE["rope_1"] - 1, abs=0.01)
    late = result["t"] > 10
    assert np.sqrt(np.mean((result["x_est"] - result["x"])[late] ** 2)) < SIGMA / 20


def test_a_plant_at_rest_with_nominal_ropes_holds_no_surprise() -> None:
    state = resting_state(2000.0, Plant(), 20.0)
    F1, F2 = tensions(state, Plant())
    seen = Measurement(20.0, 0.0, F1, F2, 0.0, 0.0, state.theta_1, state.theta_2)
    known = learn(
        RopeKnowledge(), F1 * 30.5 / (80e9 * 4.52e-4), 0.8 * seen.theta_1 - seen.x, 1.0, SIGMA, CalibrationGains(), T
    )
    assert known.excess == pytest.approx(0, abs=1e-9)
