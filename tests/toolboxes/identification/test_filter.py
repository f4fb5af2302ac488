"""The filter in C: beside one in NumPy, and its slopes beside differences."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest

from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.structure import parameters_of, zeros_of
from dualwinch.toolboxes.identification.filter import LogFilters
from dualwinch.toolboxes.identification.noise import initial_measurement_noise
from dualwinch.toolboxes.identification.options import DEFAULTS
from dualwinch.toolboxes.identification.prediction import FilterCovariances, FilterData, compile_predictor
from dualwinch.toolboxes.identification.predictor import (
    NoiseCovariances,
    described_disturbances,
    parameter_names,
    predicted_system,
    predictor_structure,
)
from dualwinch.toolboxes.identification.resample import sections_of
from tests.toolboxes.identification.conftest import logged, machine

FITTED = ("plant.vehicle.mass", "plant.rope_2.modulus", "sensors.encoder_zero_1", "plant.vehicle.friction_coefficient")
MACHINE = machine()
IN_PARTS = machine(simulation__integrator="rk4", simulation__substeps=4)
WINDOW = slice(5000, 5400)
"""Samples that are looked at: under way, with both ropes taut."""

START = slice(0, 160)
"""Samples of which some do not go in one step."""

NOISE = replace(DEFAULTS.noise, resolution=1e-5)
"""Noise above the round-off of the textbook's covariances, of which it takes differences."""


def filters(
    experiment: Experiment = MACHINE, fitted: Sequence[str] = FITTED, window: slice = WINDOW
) -> tuple[LogFilters, NoiseCovariances]:
    structure = predictor_structure(experiment)
    (section,) = sections_of([logged(MACHINE)], MACHINE)
    section = replace(section, inputs=section.inputs[window].copy(), readings=section.readings[window].copy())
    noise = NoiseCovariances(
        initial_measurement_noise(section.readings, MACHINE, NOISE),
        described_disturbances(MACHINE, NOISE),
        MACHINE.plant.vehicle,
    )
    return LogFilters(
        compile_predictor(predicted_system(structure, tuple(fitted))), structure, [section], DEFAULTS
    ), noise


@dataclass
class Textbook:
    """States and covariances after readings; slopes to the next and what is expected there; minus the likelihood."""

    states: list[np.ndarray]
    covariances: list[np.ndarray]
    slopes: list[np.ndarray]
    ahead: list[np.ndarray]
    negative_log_likelihood: float


def in_numpy(experiment: Experiment, vector: np.ndarray, data: FilterData, spread: FilterCovariances) -> Textbook:
    """An extended Kalman filter as in a textbook, all sensors at once.

    The covariance is corrected in Joseph's form (Bucy and Joseph, *Filtering for Stochastic Processes*, 1968): where
    readings know far more than the state before, P − K S Kᵀ is a difference of nearly equal numbers. With it deviations
    are off by 1e-6, as a filter in extended precision shows, by how much being up to compiler and processor.
    """
    system = predicted_system(predictor_structure(experiment), FITTED)
    n, motion = len(data.start), system.move.size1_in("motion")
    x, P = data.start.copy(), spread.initial.copy()
    found = Textbook([], [], [], [], 0.0)

    jacobians = cache(ca.Function.jacobian)

    def called(function: ca.Function, *given: Any) -> dict[str, np.ndarray]:
        """Outputs by name, and all slopes as CasADi names them, such as ``jac_reading_state``."""
        values, jacobian = function.call(list(given)), jacobians(function)
        slopes = dict(zip(jacobian.name_out(), jacobian.call([*given, *values]), strict=True))
        return {name: np.array(value).ravel() for name, value in zip(function.name_out(), values, strict=True)} | {
            name: np.array(ca.DM(value)) for name, value in slopes.items()
        }

    for given, read in zip(data.inputs, data.readings, strict=True):
        seen = called(system.sense, x, given, vector)
        there = np.isfinite(read)
        H = seen["jac_reading_state"][there]
        surprise, R = (read - seen["reading"])[there], np.diag(spread.measurement[there])
        S = H @ P @ H.T + R
        K = np.linalg.solve(S, H @ P).T
        x, I_KH = x + K @ surprise, np.eye(n) - K @ H
        P = I_KH @ P @ I_KH.T + K @ R @ K.T
        found.negative_log_likelihood += (surprise @ np.linalg.solve(S, surprise) + np.linalg.slogdet(S)[1]) / 2
        found.states.append(x)
        found.covariances.append(P)
        held = called(system.prepare, x, given, vector)
        parts = [called(system.one_step, x[:motion], held["hold"], vector)] if system.one_step else []
        if not parts or parts[0]["valid"] <= 0:
            parts, now = [], x[:motion]
            for part in range(system.parts):
                parts.append(called(system.move, now, held["hold"], part, vector))
                now = parts[-1]["next_motion"]
        A = np.eye(motion, n)
        for moved in parts:
            A = moved["jac_next_motion_motion"] @ A + moved["jac_next_motion_hold"] @ held["jac_hold_state"]
        A = np.vstack([A, held["jac_rest_state"]])
        found.slopes.append(A)
        x, P = np.concatenate([parts[-1]["next_motion"], held["rest"]]), A @ P @ A.T + np.diag(spread.process)
        found.ahead.append(x)
    return found


def smoothed(found: Textbook, walk: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rauch, Tung and Striebel: states and deviations by all readings."""
    x, P = found.states[-1], found.covariances[-1]
    states, deviations = [x], [np.sqrt(np.diag(P))]
    for k in reversed(range(len(found.states) - 1)):
        A, before = found.slopes[k], found.covariances[k]
        ahead = A @ before @ A.T + np.diag(walk)
        by = np.sqrt(np.diag(ahead))
        gain = (np.linalg.solve(ahead / np.outer(by, by), (A @ before) / by[:, np.newaxis]) / by[:, np.newaxis]).T
        x = found.states[k] + gain @ (x - found.ahead[k])
        P = before + gain @ (P - ahead) @ gain.T
        states.append(x)
        deviations.append(np.sqrt(np.diag(P).clip(0)))
    return np.array(states[::-1]), np.array(deviations[::-1])


@pytest.mark.parametrize(("experiment", "window"), [(MACHINE, WINDOW), (MACHINE, START), (IN_PARTS, WINDOW)])
def test_the_filter_is_the_textbooks(experiment: Experiment, window: slice) -> None:
    found, noise = filters(experiment, window=window)
    (section,) = found.sections
    (filtered,) = found.run(experiment, noise, rows=True, robust=False)
    data, covariance = found.data(experiment, noise, section)
    spread = FilterCovariances(covariance, found.process_variances(experiment, noise), noise.measurement)
    textbook = in_numpy(experiment, found.parameters(experiment, noise), data, spread)
    states, deviations = np.array(textbook.states), np.sqrt([np.diag(each) for each in textbook.covariances])
    assert filtered.states is not None
    assert filtered.deviations is not None
    assert (np.abs(filtered.states - states) <= 1e-7 * deviations + 1e-9).all()
    np.testing.assert_allclose(filtered.deviations[:, :6], deviations[:, :6], rtol=1e-7)
    assert filtered.negative_log_likelihood == pytest.approx(textbook.negative_log_likelihood, rel=1e-9)


def test_the_smoother_is_the_textbooks() -> None:
    found, noise = filters()
    (section,) = found.sections
    data, covariance = found.data(MACHINE, noise, section)
    walk = found.process_variances(MACHINE, noise)
    textbook = in_numpy(
        MACHINE, found.parameters(MACHINE, noise), data, FilterCovariances(covariance, walk, noise.measurement)
    )
    states, deviations = smoothed(textbook, walk)
    ((_, means, covariances),) = found.smooth(MACHINE, noise)
    spreads = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    acting = slice(-means.shape[1], None)
    np.testing.assert_allclose(spreads, deviations[:, acting], rtol=1e-3)
    assert (np.abs(means - states[:, acting]) <= 1e-3 * spreads).all()
    by_then = np.sqrt([P[acting, acting][0, 0] for P in textbook.covariances[:200]])
    assert spreads[:200, 0].mean() < 0.999 * by_then.mean(), "what comes later says more"


def test_gains_written_in_the_place_of_others_are_the_same() -> None:
    found, noise = filters()
    off = replace(MACHINE, plant=machine(plant__vehicle__mass=1.03e4).plant)
    (fresh,), (other,) = found.run(MACHINE, noise, robust=False), found.run(off, noise, robust=False)
    (again,) = found.run(MACHINE, noise, into=[other], robust=False)
    assert again.gains is other.gains
    np.testing.assert_array_equal(again.gains, fresh.gains)
    np.testing.assert_array_equal(again.whitening, fresh.whitening)
    assert again.negative_log_likelihood == fresh.negative_log_likelihood


def test_with_its_own_gains_a_prediction_is_the_filters() -> None:
    found, noise = filters()
    (filtered,) = found.run(MACHINE, noise, robust=False)
    (prediction,) = found.predict(found.parameters(MACHINE, noise), MACHINE, noise, [filtered], rows=True)
    assert prediction.innovations is not None
    squares = np.nansum(prediction.innovations**2, axis=0)
    np.testing.assert_allclose(squares, filtered.squares, rtol=1e-9)
    assert prediction.normal[-1, -1] == pytest.approx(filtered.squares.sum(), rel=1e-9)


@pytest.mark.parametrize("experiment", [MACHINE, IN_PARTS])
@pytest.mark.parametrize(("key", "share"), [*zip(FITTED, (1e-4, 3e-7, 1e-4, 1e-4), strict=True)])
def test_slopes_are_those_of_differences(key: str, share: float, experiment: Experiment) -> None:
    """Of the whole sum of squares, gains as they are: its gradient is twice the last column of the products.

    A rope's modulus decides which samples take one step; a small change changes none.
    """
    found, noise = filters(experiment)
    off = replace(experiment, plant=machine(plant__vehicle__mass=1.03e4).plant)  # where the gradient is no noise
    filtered = found.run(off, noise, robust=False)
    base = found.parameters(off, noise)
    column, index = parameter_names(predictor_structure(experiment)).index(key), FITTED.index(key)
    step = share * (abs(base[column]) or 1e-3)

    def squares(change: float) -> np.ndarray:
        vector = base.copy()
        vector[column] += change
        (prediction,) = found.predict(vector, off, noise, filtered)
        return prediction.normal

    slope = (squares(step)[-1, -1] - squares(-step)[-1, -1]) / (2 * step)
    assert 2 * squares(0.0)[index, -1] == pytest.approx(slope, rel=2e-4)


def test_in_parts_or_in_one_step_slopes_are_those_of_differences() -> None:
    """Where samples of both kinds take turns."""
    found, noise = filters(window=START)
    off = machine(plant__vehicle__mass=1.03e4)
    filtered, base = found.run(off, noise, robust=False), found.parameters(off, noise)
    column = parameter_names(predictor_structure(MACHINE)).index("plant.vehicle.mass")

    def squares(change: float) -> np.ndarray:
        vector = base.copy()
        vector[column] += change
        (prediction,) = found.predict(vector, off, noise, filtered)
        return prediction.normal

    slope = (squares(1e-3)[-1, -1] - squares(-1e-3)[-1, -1]) / 2e-3
    assert 2 * squares(0.0)[FITTED.index("plant.vehicle.mass"), -1] == pytest.approx(slope, rel=1e-3)


def test_numbers_that_are_zero_may_be_left_out() -> None:
    structure, keys = predictor_structure(MACHINE), FITTED
    zeros = zeros_of(structure, parameters_of(MACHINE), varying=keys)
    found, noise = filters()
    without = LogFilters(
        compile_predictor(predicted_system(structure, keys, zeros)), structure, found.sections, DEFAULTS
    )
    assert (
        predicted_system(structure, keys, zeros).sense.n_instructions()
        < predicted_system(structure, keys).sense.n_instructions()
    )
    (filtered,), (same,) = (each.run(MACHINE, noise, robust=False) for each in (found, without))
    np.testing.assert_allclose(same.squares, filtered.squares, rtol=1e-6)
    (liked,) = without.run(MACHINE, noise, gains=False, robust=False)
    assert liked.gains.size == 0
    assert liked.negative_log_likelihood == pytest.approx(same.negative_log_likelihood, rel=1e-12)


def test_missing_sensors_are_never_looked_at() -> None:
    """A log without load cells and with one encoder: what is not there has no influence."""
    found, noise = filters()
    (section,) = found.sections
    section.readings[:, [2, 3, 5]] = np.nan
    (filtered,) = found.run(MACHINE, noise, robust=False)
    assert filtered.outcome == 0
    np.testing.assert_array_equal(filtered.counts[[2, 3, 5]], 0)
    assert np.isnan(filtered.noise[[2, 3, 5]]).all()
