"""Machines without load cells: tensions from torques and drum speeds."""

import numpy as np

import dualwinch as dw
from dualwinch.controllers.tension_observer import DrumMomentum, observed_tension
from dualwinch.simulation.blocks import block

T = 1e-3
WITHOUT = {"sensors.tension": "none", "controller.tension_observer.bandwidth": 40.0}


def test_the_estimate_is_the_tension_behind_a_low_pass() -> None:
    """A drum turned by a motor against a rope whose tension is given, by the equation of motion in fine steps."""
    side, bandwidth, fine = dw.Plant().sides[0], 40.0, 20
    winch = side.winch
    drum, omega, low_passed, estimates, expected = DrumMomentum(500.0, 0.0), 0.0, 500.0, [], []
    for number in range(1000):
        torque = 10.0 + 3.0 * np.sin(0.02 * number)
        for step in range(fine):
            t = T * (number + step / fine)
            tension = 600.0 + 200.0 * np.sin(7.0 * t) + 80.0 * t
            omega += T / fine * (winch.gear_ratio * torque - winch.drum_radius * tension) / winch.inertia
            low_passed += T / fine * bandwidth * (tension - low_passed)
        estimate, momentum = observed_tension(DrumMomentum(drum.momentum, torque), omega, side, bandwidth, T)
        drum = DrumMomentum(momentum, torque)
        estimates.append(float(estimate))
        expected.append(low_passed)
    assert np.abs(np.array(estimates) - expected)[200:].max() < 10.0


def test_a_run_without_load_cells_tracks_and_keeps_its_ropes_taut() -> None:
    base = dw.override(dw.case(4), {"simulation.duration": 12.0, "simulation.readings": True})
    measured, estimated = dw.simulate(base), dw.simulate(dw.override(base, WITHOUT))
    assert estimated.outcome == "completed"
    assert np.isnan(estimated["F1_read"]).all()
    assert estimated.metrics.min_tension > 0.5 * measured.metrics.min_tension
    assert estimated.metrics.mse < 4 * measured.metrics.mse


def test_exported_controllers_have_no_inputs_for_them() -> None:
    inputs = {variable.name for variable in block("controller", dw.override(dw.case(4), WITHOUT)).inputs}
    assert {"x", "omega_1", "omega_2"} <= inputs
    assert inputs.isdisjoint({"F1", "F2"})
