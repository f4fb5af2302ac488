"""The Kalman filter: its gain against SciPy's Riccati solver, its steps by hand, its worth in the noisy closed loop."""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from dualwinch.codegen.source.hoist import hoisted
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.estimators.innovation_gate import GateGains
from dualwinch.controllers.estimators.kalman import Kalman, KalmanEstimate, KalmanGains, KalmanState, kalman_gain
from dualwinch.controllers.estimators.low_pass import LowPass
from dualwinch.controllers.estimators.unfiltered import Unfiltered
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, Estimator, Measurement
from dualwinch.model.plant import Plant, PlantState, resting_state, tensions
from dualwinch.model.reference import Setpoint
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.loop.closed_loop import closed_loop, initial_state_of
from dualwinch.simulation.loop.engine import engine_of
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.sensors import Sensors
from dualwinch.simulation.simulate import simulate
from tests.tolerances import close

T = 1e-3
SEA = Sensors(position_noise=5e-4, position_resolution=1e-3, speed_noise=2e-3, tension_noise=10.0, encoder_counts=4096)


def riccati_gain(gains: KalmanGains, sample_time: float) -> NDArray[np.float64]:
    """The gain in SI units with all four sensors, each a row of its own, merged into two columns at the end."""
    variances = np.array([gains.position_noise, gains.encoder_noise, gains.encoder_noise, gains.speed_noise]) ** 2
    merged = 1 / sum(1 / variances[:3])
    n = sample_time
    A = np.array([[1, n, n**2 / 2], [0, 1, n], [0, 0, 1]])
    C = np.array([[1, 0, 0], [1, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    walk = gains.bandwidth**6 * merged * n
    Q = walk * np.array([[n**5 / 20, n**4 / 8, n**3 / 6], [n**4 / 8, n**3 / 3, n**2 / 2], [n**3 / 6, n**2 / 2, n]])
    unit = 1 / merged
    P = solve_discrete_are(A.T, C.T, unit * Q, unit * np.diag(variances))
    K = P @ C.T @ np.linalg.inv(C @ P @ C.T + unit * np.diag(variances))
    return np.column_stack([K[:, :3].sum(axis=1), K[:, 3]])


@given(
    bandwidth=st.floats(8, 200),
    position=st.floats(1e-4, 1e-2),
    encoder=st.floats(1e-5, 1e-2),
    speed=st.floats(3e-4, 1e-1),
    sample_time=st.sampled_from([1e-3, 2e-3]),
)
def test_gain_solves_the_riccati_equation(
    bandwidth: float, position: float, encoder: float, speed: float, sample_time: float
) -> None:
    gains = KalmanGains(position, speed, encoder, bandwidth)
    assert np.array(kalman_gain(gains, sample_time)) == pytest.approx(riccati_gain(gains, sample_time), rel=1e-5)


def test_without_a_speed_sensor_the_poles_are_a_butterworth_filters() -> None:
    gains = KalmanGains(speed_noise=1e3, bandwidth=20.0)
    A, C = np.array([[1, T, T**2 / 2], [0, 1, T], [0, 0, 1]]), np.array([[1, 0, 0], [0, 1, 0]])
    poles = np.log(np.linalg.eigvals((np.eye(3) - np.array(kalman_gain(gains, T)) @ C) @ A)) / T
    assert np.sort_complex(poles) == pytest.approx(20 * np.exp(1j * np.pi * np.array([3, -2, 2]) / 3), rel=0.02)


def error_poles(gains: KalmanGains, sample_time: float) -> NDArray[np.complex128]:
    """Poles in z of the estimation error of x, v, d and the rate r."""
    n, K = sample_time, np.zeros((4, 2))
    K[:3] = kalman_gain(gains, n)
    K[3] = gains.ramp * gains.bandwidth * K[2]
    A = np.array([[1, n, n**2 / 2, 0], [0, 1, n, 0], [0, 0, 1, n], [0, 0, 0, 1]])
    C = np.array([[1, 0, 0, 0], [0, 1, 0, 0]])
    return np.linalg.eigvals(A @ (np.eye(4) - K @ C)).astype(complex)


def test_with_a_ramp_the_poles_are_the_roots_of_its_polynomial() -> None:
    gains = KalmanGains(speed_noise=1e3, bandwidth=20.0, ramp=0.3)
    poles = np.log(error_poles(gains, T)) / T
    assert np.sort_complex(poles) == pytest.approx(20 * np.sort_complex(np.roots([1, 2, 2, 1, 0.3])), rel=0.05)


@given(
    bandwidth=st.floats(1, 200),
    position=st.floats(5e-5, 5e-3),
    encoder=st.floats(1e-6, 1e-2),
    speed=st.floats(1e-4, 5e-2),
    ramp=st.floats(0.01, 0.7),
)
def test_within_its_bounds_the_ramp_keeps_the_filter_stable(
    bandwidth: float, position: float, encoder: float, speed: float, ramp: float
) -> None:
    assert np.abs(error_poles(KalmanGains(position, speed, encoder, bandwidth, ramp), T)).max() < 1


@pytest.mark.parametrize(("ramp", "late"), [(0.0, True), (0.3, False)])
def test_a_disturbance_that_ramps_is_followed_without_delay(
    ramp: float, late: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "dualwinch.controllers.estimators.kalman.kalman_gain", cache(kalman_gain)
    )  # the same throughout
    vehicle = replace(Plant().vehicle, friction_coefficient=0.0, drag_coefficient=0.0)
    plant, growth = replace(Plant(), vehicle=vehicle), 0.01  # m/s³
    kalman = Kalman(KalmanGains(ramp=ramp, compensation=0.5))
    state, estimate = KalmanState(), None
    for t in T * np.arange(4000):
        measured = replace(measured_at(resting_state(2000.0, plant, growth * t**3 / 6)), v=growth * t**2 / 2)
        state, estimate = step(state, measured, kalman, plant)
    assert estimate is not None
    behind = growth * 4.0 - estimate.d / 0.5
    assert (behind > 0.5 * growth / 20.0) == late
    assert behind < 2 * growth / 20.0


def test_gain_has_derivatives() -> None:
    bandwidth = ca.SX.sym("bandwidth")
    gain = ca.vertcat(*(value for row in kalman_gain(replace(KalmanGains(), bandwidth=bandwidth), T) for value in row))
    slope = np.array(ca.Function("slope", [bandwidth], [ca.jacobian(gain, bandwidth)])(20.0)).ravel()
    above, below = (np.ravel(kalman_gain(KalmanGains(bandwidth=20.0 + step), T)) for step in (1e-3, -1e-3))
    assert slope == pytest.approx((above - below) / 2e-3, rel=1e-5)


def test_the_gain_is_computed_once_a_run() -> None:
    """The step of the loop grows by the filter's few lines, not by the doubling steps."""

    def sizes(estimator: Estimator) -> list[int]:
        return [function.n_instructions() for function in hoisted(closed_loop(structure_of(noisy(estimator))).step)]

    with_it, without = sizes(Kalman(trust=GateGains(false_alarm=0.0))), sizes(Unfiltered())
    assert with_it[0] - without[0] > 1000
    assert with_it[1] - without[1] < 100


def measured_at(state: PlantState) -> Measurement:
    F1, F2 = tensions(state, Plant())
    return Measurement(state.x, state.v, F1, F2, state.omega_1, state.omega_2, state.theta_1, state.theta_2)


def step(
    state: KalmanState, measurement: Measurement, kalman: Kalman | None = None, plant: Plant | None = None
) -> tuple[KalmanState, KalmanEstimate]:
    context = Context(plant or Plant(), Limits(), T)
    return (kalman or Kalman()).step(state, measurement, Setpoint(0.0, 0.0, 0.0), context)


@given(st.floats(0, 46), st.floats(500, 8000))
def test_a_plant_at_rest_holds_no_surprise(x: float, preload: float) -> None:
    """Encoders, corrected by the stretch of the ropes, show the vehicle's position."""
    after, estimate = step(KalmanState(x), measured_at(resting_state(preload, Plant(), x)))
    assert (after.x, after.v, after.d) == pytest.approx((x, 0, 0), abs=1e-9)
    assert (estimate.x, estimate.v) == pytest.approx((x, 0), abs=1e-9)


def test_the_encoder_of_a_slack_rope_is_left_out() -> None:
    at_rest = resting_state(2000.0, Plant(), 10.0)
    loose = measured_at(replace(at_rest, theta_2=at_rest.theta_2 - 0.5))
    assert loose.F2 == 0
    _, estimate = step(KalmanState(10.0), loose)
    assert estimate.x == pytest.approx(10.0, abs=1e-9)


def test_the_measured_pull_is_expected_to_accelerate() -> None:
    pulled = replace(measured_at(resting_state(2000.0, Plant(), 10.0)), F1=1000.0, F2=500.0)
    after, estimate = step(KalmanState(10.0, 0.0, 0.02), pulled)
    assert after.v - estimate.v == pytest.approx(T * (500 / 1e4 + after.d), rel=0.05)


def noisy(estimator: Estimator) -> Experiment:
    controller = Controller(estimator=estimator)
    return replace(case(4), controller=controller, sensors=SEA, simulation=Simulation(delay_samples=1))


def speed_errors(experiment: Experiment) -> NDArray[np.float64]:
    """Difference in m/s of the estimator's speed and the true one, 5 s to the end."""
    loop = closed_loop(structure_of(experiment))
    run = engine_of(loop)
    parameters = np.array(list(parameters_of(experiment).values()))
    state = np.array(list(initial_state_of(experiment).values()))
    estimate, truth = loop.states.index("controller.estimator.v"), loop.states.index("motion.plant.v")
    errors = []
    for now in exogenous_signals(experiment):
        run(parameters, now[np.newaxis], state, 0)
        errors.append(state[estimate] - state[truth])
    return np.array(errors[5000:])


def test_what_the_filter_knows_of_vortices_need_not_be_learnt_by_the_observer() -> None:
    plain, knowing = noisy(Kalman()), noisy(Kalman(KalmanGains(ramp=0.4, compensation=1.0)))
    assert simulate(knowing).metrics.steady_mae < 0.2 * simulate(plain).metrics.steady_mae


@pytest.mark.slow
def test_with_a_seas_sensors_it_beats_raw_and_lowpassed_speeds() -> None:
    """Case 4 with FANDO-NFTSM and one sample of delay, as measured.

    ================ ================ ============== ======== =========
    speed            RMS speed error  chatter        mean |e| max |e|
    ================ ================ ============== ======== =========
    as measured      2.0 mm/s         74.3 N/sample  0.26 mm  1.1 mm
    low-pass 5 ms    0.84 mm/s        14.2 N/sample  1.5 mm   4.0 mm
    low-pass 50 ms   4.8 mm/s         3.3 N/sample   6.4 mm   14.4 mm
    Kalman           0.21 mm/s        1.8 N/sample   1.3 mm   5.9 mm
    ================ ================ ============== ======== =========
    """
    choices = {"raw": Unfiltered(), "5 ms": LowPass(0.005), "50 ms": LowPass(0.05), "kalman": Kalman()}
    runs = {name: simulate(noisy(estimator)).metrics for name, estimator in choices.items()}
    rms = {name: np.sqrt(np.mean(speed_errors(noisy(choices[name])) ** 2)) for name in ("5 ms", "50 ms", "kalman")}
    assert rms["kalman"] < 0.2 * SEA.speed_noise
    assert rms["kalman"] < 0.4 * min(rms["5 ms"], rms["50 ms"])
    assert runs["kalman"].chatter < 0.05 * runs["raw"].chatter
    assert runs["kalman"].chatter < 0.2 * runs["5 ms"].chatter
    assert runs["kalman"].chatter < 0.7 * runs["50 ms"].chatter
    assert runs["kalman"].mae < 0.3 * runs["50 ms"].mae


def test_what_the_filter_estimates_is_in_the_result() -> None:
    """Position and speed are those the law sees; the disturbance is whole, compensated or not."""
    plain, half = (simulate(noisy(Kalman(KalmanGains(compensation=share)))) for share in (0.0, 0.5))
    for result in (plain, half):
        late = result["t"] > 5
        assert {name: result.units[name] for name in ("x_est", "v_est", "d_est")} == {
            "x_est": "m",
            "v_est": "m/s",
            "d_est": "m/s^2",
        }
        assert np.std((result["x_est"] - result["x"])[late]) < 0.2 * SEA.position_noise
        assert np.std((result["v_est"] - result["v"])[late]) < 0.2 * SEA.speed_noise
        assert np.corrcoef(result["d_est"][late], result["d_true"][late])[0, 1] > 0.9
        law_sees = result["s"] - (result["x_est"] - result["x_ref"])
        e2 = result["v_est"] - result["v_ref"] + 1e-5 * result["Z_a"]
        assert close(law_sees, e2 * (e2**2 + 1e-10) ** (1 / 3) / 0.05, abs=1e-12)


def test_without_a_filter_there_are_no_such_columns() -> None:
    columns = simulate(replace(noisy(LowPass()), simulation=Simulation(duration=0.01))).columns
    assert not {"x_est", "v_est", "d_est", "excess_1"} & columns.keys()
