"""A machine that is not what its data sheets say: against the independent implementation, and what follows from it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from dualwinch.model.plant import Plant
from dualwinch.simulation.blocks import block
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import closed_loop
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from tests.oracle.plant import Hold
from tests.oracle.plant import Plant as Judge
from tests.oracle.sampled import Scenario, run
from tests.tiers import each_choice

METRE = 1e-8

DRUMS = {
    "plant.winch_1.radius_error": 2e-3,
    "plant.winch_2.radius_error": -1e-3,
    "plant.winch_1.eccentricity": 2e-3,
    "plant.winch_1.eccentricity_angle": 1.0,
    "plant.winch_2.eccentricity": 1e-3,
    "plant.winch_2.eccentricity_angle": -2.0,
    "plant.winch_1.layer_thickness": 0.02,
    "plant.winch_2.layer_thickness": 0.024,
    "plant.winch_2.layer_laps": 5.0,
}
MOTORS = {
    "plant.winch_1.torque_error": 0.02,
    "plant.winch_2.torque_error": -0.02,
    "plant.winch_1.torque_ripple": 0.01,
    "plant.winch_1.ripple_angle": 0.5,
    "plant.winch_2.torque_ripple": 0.02,
    "plant.winch_2.ripple_waves": 4.0,
}
ROPES = {"plant.creep_1.elongation": 1e-3, "plant.creep_1.time": 20.0, "plant.creep_2.elongation": 5e-4}
SENSORS = {
    "sensors.position_bias": 2e-3,
    "sensors.load_cell_error_1": 0.01,
    "sensors.load_cell_error_2": -0.01,
    "sensors.load_cell_zero_1": 30.0,
    "sensors.load_cell_zero_2": -20.0,
}
ALL = DRUMS | MOTORS | ROPES | SENSORS
VALUES = {"drums": DRUMS, "motors": MOTORS, "ropes": ROPES, "sensors": SENSORS, "all": ALL}
SOLVERS = {"exponential": (16, True), "rk4": (32, False)}
"""Integrator → its sub-steps, and whether ropes go slack."""

NUMBER, DURATION = 3, 1.5
FINE = {"integrator": "exponential", "substeps": 16}


def imperfect(values: Mapping[str, Any], **simulation: Any) -> Experiment:
    settings = {f"simulation.{name}": value for name, value in simulation.items()}
    return override(case(NUMBER), {"simulation.duration": DURATION, **values, **settings})


def drawn(experiment: Experiment, name: str) -> np.ndarray:
    """A signal from outside, and one sample more of silence."""
    names = closed_loop(structure_of(experiment)).exogenous
    return np.append(exogenous_signals(experiment)[:, names.index(name)], 0.0)


def judged(experiment: Experiment, values: Mapping[str, float], **signals: np.ndarray) -> dict[str, np.ndarray]:
    return run(Scenario("fando-nftsm", NUMBER, values, signals), experiment.samples)


@pytest.mark.parametrize(("imperfect_parts", "integrator"), each_choice(VALUES, SOLVERS))
def test_positions_agree(imperfect_parts: str, integrator: str) -> None:
    """With a hard start that throws a rope slack; Runge–Kutta, which finds no such moment, with ropes that push."""
    substeps, slack = SOLVERS[integrator]
    values = {**VALUES[imperfect_parts], "plant.rope_slack": slack}
    experiment = imperfect(values, integrator=integrator, substeps=substeps)
    ours, theirs = simulate(experiment), judged(experiment, values)
    assert np.abs(ours["x"] - theirs["x"]).max() <= METRE
    assert np.abs(ours["theta_1"] - theirs["theta_1"]).max() <= METRE
    assert np.abs(ours["e"] - theirs["e"]).max() <= METRE


def test_late_samples_agree() -> None:
    experiment = imperfect(ALL, jitter=2e-4, **FINE)
    late = np.roll(2e-4 * drawn(experiment, "noise.lateness"), 1)
    assert 1e-4 < np.abs(late).max() <= 2e-4
    ours, theirs = simulate(experiment), judged(experiment, ALL, late=late)
    assert ours["t"] == pytest.approx(theirs["t"], abs=1e-12)
    assert np.abs(ours["x"] - theirs["x"]).max() <= METRE
    assert np.abs(ours["e"] - theirs["e"]).max() <= METRE


def test_a_drifting_sensor_agrees() -> None:
    experiment = imperfect({"sensors.position_drift": 1e-3, "sensors.position_drift_time": 0.5}, **FINE)
    drift = 1e-3 * drawn(experiment, "noise.drift")
    ours, theirs = simulate(experiment), judged(experiment, {}, x=drift)
    assert np.ptp(drift) > 1e-3
    assert np.abs(ours["x"] - theirs["x"]).max() <= METRE


def test_a_silent_sensor_holds_its_last_reading() -> None:
    values = {"sensors.outage_length": 0.1, "sensors.outage_period": 0.7, "sensors.position_noise": 1e-4}
    experiment = imperfect(values, **FINE)
    silent, noise = drawn(experiment, "noise.silent"), 1e-4 * drawn(experiment, "noise.position")
    result = simulate(experiment)
    x = result["x"]
    read = x + noise[:-1]
    for k in range(1, len(x)):
        if silent[k]:
            read[k] = read[k - 1]
    assert 0.08 < silent.sum() * 1e-3 < 0.32
    theirs = judged(experiment, {}, x=read - x)
    assert np.abs(x - theirs["x"]).max() <= METRE


def test_no_number_ends_a_controller_that_does_not_ask_for_one() -> None:
    values = {"sensors.outage_length": 0.1, "sensors.outage_period": 0.7}
    assert simulate(imperfect(values)).outcome == "completed"
    lost = simulate(imperfect(values | {"sensors.outage": "missing"}))
    first = int(np.flatnonzero(drawn(lost.experiment, "noise.silent"))[0])
    assert lost.outcome == "diverged"
    assert round(lost.end_time / 1e-3) == first + 1


def test_no_controller_knows_what_is_unknown() -> None:
    known, unknown = parameters_of(case(4)), parameters_of(imperfect(ALL))
    layers = {f"nominal.winch_{i}.layer_{what}" for i in (1, 2) for what in ("thickness", "laps")}
    nominal = {key for key in known if key.startswith("nominal.") and known[key] != unknown[key]}
    assert nominal == {
        "nominal.winch_1.layer_thickness",
        "nominal.winch_2.layer_thickness",
        "nominal.winch_2.layer_laps",
    }
    assert nominal < layers
    assert not [key for key in known if key.startswith("nominal.") and ("error" in key or "creep" in key)]


def test_no_controllers_block_knows_what_is_unknown() -> None:
    filtered = {"controller.estimator": "self-calibrating-kalman"}
    plain, drawn = (block("controller", imperfect(values | filtered), Plant()) for values in ({}, ALL))
    at = [[0.1 * (k + 1) for k in range(len(each))] for each in (plain.states, plain.inputs)]
    parameters = [parameter.start for parameter in plain.parameters]
    assert parameters == [parameter.start for parameter in drawn.parameters]
    for known, unknown in zip(plain.step(*at, parameters), drawn.step(*at, parameters), strict=True):
        assert np.array_equal(np.array(known), np.array(unknown), equal_nan=True)


def test_a_bias_of_the_sensor_moves_the_frame_and_nothing_else() -> None:
    biased, true = simulate(imperfect({"sensors.position_bias": 0.01})), simulate(imperfect({}))
    assert biased["x"][0] == -0.01
    assert biased["e"][0] == 0
    assert biased.metrics["mse"] == pytest.approx(true.metrics["mse"], rel=1e-3)
    assert np.abs(biased["x"] + 0.01 - true["x"]).max() < 1e-5


def test_the_plants_block_has_the_same_slopes() -> None:
    made, judge = block("plant", imperfect(ALL)), Judge(Scenario("fando-nftsm", NUMBER, ALL).values)
    assert made.derivative is not None
    position, speed, torques, t = judge.at_rest(5000.0, 20.0)[0], (1.2, 1.5, -1.5), (30.0, 20.0), 3.0
    state = dict.fromkeys((variable.name for variable in made.states), 0.0)
    for k, name in enumerate(("x", "theta_1", "theta_2")):
        state[name] = position[k]
    for k, name in enumerate(("v", "omega_1", "omega_2")):
        state[name] = speed[k]
    state["sample"] = t / 1e-3
    given = dict.fromkeys((variable.name for variable in made.inputs), 0.0) | dict(
        zip(("tau_1", "tau_2"), torques, strict=True)
    )
    parameters = [parameter.start for parameter in made.parameters]
    slopes, _ = made.derivative(list(state.values()), list(given.values()), parameters)
    found = dict(zip((variable.name for variable in made.continuous), np.array(slopes).ravel(), strict=True))
    assert judge.taut(position, speed, t) == (True, True)
    hold = Hold(*judge.given(torques, position, speed, 0.0))
    (a, alpha_1, alpha_2), _ = judge.motion(t, position, speed, hold, (True, True))
    assert [found[name] for name in ("v", "omega_1", "omega_2")] == pytest.approx([a, alpha_1, alpha_2], rel=1e-9)
