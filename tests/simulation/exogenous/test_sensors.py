"""Sensors, delay, speed filter and a wrong nominal model: what separates the controller from the plant."""

from dataclasses import replace
from math import pi

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.estimators.low_pass import LowPass
from dualwinch.controllers.laws.nftsm import Nftsm
from dualwinch.controllers.nominal import Nominal
from dualwinch.model.plant import Plant, PlantState
from dualwinch.model.vehicle import Vehicle
from dualwinch.simulation.experiment import Simulation
from dualwinch.simulation.paper import case
from dualwinch.simulation.sensors import LoadCells, Noise, Readings, Sensors, encoder_step, measure, quantise
from dualwinch.simulation.simulate import simulate
from tests.tolerances import close

STATE = PlantState(12.3456, 1.7, 15.1, 2.1, -15.2, -2.2)
SHORT = Simulation(duration=1.0)


@given(st.floats(-100, 100), st.floats(1e-6, 1))
def test_a_reading_is_the_nearest_multiple_of_the_step(value: float, step: float) -> None:
    reading = quantise(value, step)
    assert abs(reading - value) <= step / 2 + 1e-12
    assert reading / step == pytest.approx(round(reading / step), abs=1e-6)


@given(st.floats(-100, 100))
def test_a_step_of_zero_reads_exactly(value: float) -> None:
    assert quantise(value, 0.0) == value


@given(st.floats(-100, 100), st.sampled_from([0.0, 1e-3, 0.5]))
def test_quantisation_is_the_same_on_symbols(value: float, step: float) -> None:
    x, d = ca.SX.sym("x"), ca.SX.sym("d")
    function = ca.Function("quantise", [x, d], [quantise(x, d)])
    assert float(function(value, step)) == quantise(value, step)


def test_perfect_sensors_show_the_truth() -> None:
    _, seen = measure(STATE, (1500.0, 900.0), Noise(), Readings(), Plant(), Sensors(), 1e-3)
    assert (seen.x, seen.v, seen.F1, seen.F2) == (12.3456, 1.7, 1500, 900)
    assert (seen.omega_1, seen.omega_2) == (2.1, -2.2)


def test_noise_is_the_draw_times_its_standard_deviation() -> None:
    noise = Noise(position=1.0, speed=-2.0, tension_1=0.5, tension_2=3.0)
    sensors = Sensors(position_noise=0.01, speed_noise=0.1, tension_noise=10.0)
    _, seen = measure(STATE, (1500.0, 900.0), noise, Readings(), Plant(), sensors, 1e-3)
    assert (seen.x, seen.v, seen.F1, seen.F2) == pytest.approx((12.3556, 1.5, 1505, 930))


@pytest.mark.parametrize("hertz", [20.0, 50.0, 500.0])
@pytest.mark.parametrize("rise", [0.0, 3e4])
def test_load_cells_lag_as_a_first_order_low_pass_does(hertz: float, rise: float) -> None:
    """After a step by 500 N that takes a sample, and on a ramp: the textbook's responses, whatever the sample time."""
    lag, start, step, h = 1 / (2 * pi * hertz), 1000.0, 500.0, 1e-3
    sensors = Sensors(load_cell_time_constant=lag, load_cell_error_2=0.1)
    last = Readings(load_cells=LoadCells(start, start))
    t = h * np.arange(41)
    pulls = start + step * np.minimum(t / h, 1.0) + rise * t
    seen = []
    for pull in pulls:
        last, reading = measure(STATE, (pull, pull), Noise(), last, Plant(), sensors, h)
        seen.append((reading.F1, reading.F2 / 1.1))

    def ramp(t: np.ndarray) -> np.ndarray:
        """Response to the ramp max(t, 0)."""
        t = np.maximum(t, 0.0)
        return t - lag * (1 - np.exp(-t / lag))

    expected = start + step / h * (ramp(t) - ramp(t - h)) + rise * ramp(t)
    assert np.array(seen) == pytest.approx(np.array([expected, expected]).T, rel=1e-12)


def test_noise_comes_before_quantisation() -> None:
    sensors = Sensors(position_noise=0.01, position_resolution=0.1)
    _, seen = measure(STATE, (0.0, 0.0), Noise(position=1.0), Readings(), Plant(), sensors, 1e-3)
    assert seen.x == pytest.approx(12.4)


def test_encoder_counts_motor_turns() -> None:
    """1024 counts a motor turn are 36 * 1024 a drum turn."""
    assert encoder_step(36.0, Sensors(encoder_counts=1024)) == pytest.approx(2 * pi / 36 / 1024)


def test_drives_measure_drum_speeds_at_the_sample_itself() -> None:
    """Rounded to their resolution, whatever the encoders' counts say of the sample before."""
    sensors = Sensors(encoder_counts=1024, drum_speed_resolution=0.25)
    _, seen = measure(STATE, (0.0, 0.0), Noise(), Readings(theta_1=99.0), Plant(), sensors, 1e-3)
    assert seen.omega_1 == pytest.approx(0.25 * round(STATE.omega_1 / 0.25))
    assert seen.omega_2 == pytest.approx(0.25 * round(STATE.omega_2 / 0.25))


def test_drum_speed_is_the_difference_of_two_encoder_readings() -> None:
    sensors, step = Sensors(encoder_counts=1024), 2 * pi / 36 / 1024
    last, _ = measure(STATE, (0.0, 0.0), Noise(), Readings(), Plant(), sensors, 1e-3)
    moved = replace(STATE, theta_1=STATE.theta_1 + 20 * step, theta_2=STATE.theta_2 - 3 * step)
    _, seen = measure(moved, (0.0, 0.0), Noise(), last, Plant(), sensors, 1e-3)
    assert (seen.omega_1, seen.omega_2) == pytest.approx((20 * step / 1e-3, -3 * step / 1e-3))


def test_noise_of_the_position_sensor_reaches_the_controller_not_the_columns() -> None:
    quiet = simulate(replace(case(4), simulation=SHORT))
    noisy = simulate(replace(case(4), simulation=SHORT, sensors=Sensors(position_noise=1e-3)))
    assert close(noisy["e"], noisy["x"] - noisy["x_ref"], abs=1e-15)
    assert np.abs(np.diff(noisy["x"])).max() < 1e-3
    assert np.std(np.diff(noisy["s"])) == pytest.approx(1e-3 * np.sqrt(2), rel=0.1)
    assert np.std(np.diff(quiet["s"])) < 1e-4


@pytest.mark.parametrize("delay", [1, 3])
def test_a_torque_reaches_the_motor_late(delay: int) -> None:
    """Until the first command arrives, the equilibrium torque holds the plant at rest."""
    late = simulate(replace(case(1), simulation=Simulation(duration=0.02, delay_samples=delay)))
    prompt = simulate(replace(case(1), simulation=Simulation(duration=0.02)))
    assert np.abs(late["x"][: delay + 1]).max() < 1e-15
    assert late["x"][delay + 1] == pytest.approx(prompt["x"][1], rel=1e-9)
    assert prompt["x"][1] > 1e-9


def test_the_speed_filter_delays_what_the_controller_sees() -> None:
    slow = replace(case(4, "nftsm"), simulation=SHORT, controller=Controller(law=Nftsm(), estimator=LowPass(0.05)))
    result = simulate(slow)
    filtered, v = 0.0, []
    for speed in result["v"]:
        filtered += 1e-3 / 0.051 * (speed - filtered)
        v.append(filtered)
    z = np.array(v) - result["v_ref"] + 1e-5 * result["Z_a"]
    expected = result["e"] + z * (z**2 + 1e-10) ** (1 / 3) / 0.05
    assert result["s"] == pytest.approx(expected, abs=1e-12)


def test_a_wrong_nominal_mass_is_a_disturbance_to_the_controller() -> None:
    """In the acceleration phase the nominal mass is 1 t short: the ropes' pull explains too much acceleration."""
    right = case(2)
    wrong = replace(right, controller=Controller(nominal=Nominal(mass=9e3)))
    windows = [(result["t"] > 5) & (result["t"] < 17) for result in (simulate(right), simulate(wrong))]
    right_d, wrong_d = (simulate(run)["d_true"][window] for run, window in zip((right, wrong), windows, strict=True))
    assert np.abs(right_d).max() < 1e-9
    assert wrong_d.mean() == pytest.approx(0.1 - 0.1 * 1e4 / 9e3, rel=0.05)


def test_the_plant_does_not_know_what_the_controller_assumes() -> None:
    """A heavier plant behaves the same to a controller that assumes the old one, whichever way it is said."""
    heavy = Plant(vehicle=Vehicle(mass=1.2e4))
    added = Plant(vehicle=Vehicle(mass=1e4, added_mass=2e3))
    designed = Controller(nominal=Nominal(mass=1e4))
    first, second = (
        simulate(replace(case(4), plant=plant, controller=designed, simulation=SHORT)) for plant in (heavy, added)
    )
    assert first["x"] == pytest.approx(second["x"], abs=1e-15)
