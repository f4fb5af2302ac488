"""Sensitivities against central differences of the same runs, and against each other."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.codegen.source.c_source import LANES
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.batch.sensitivities import Sensitivities, sensitivities
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override

GAINS = {
    "controller.nftsm.beta": 0.05,
    "controller.nftsm.eta": 0.05,
    "controller.nftsm.k": 0.5,
    "controller.nftsm.phi": 0.5,
    "controller.observer.l0": 5.0,
    "controller.observer.kf": 5.0,
    "controller.observer.error_scale": 0.1,
    "controller.winch_1.kp": 5e-4,
    "controller.winch_1.ki": 2e-2,
    "controller.winch_2.ki": 2e-2,
    "nominal.vehicle.mass": 1e4,
    "nominal.vehicle.drag_coefficient": 0.3,
}
NAMES, VALUES = list(GAINS), np.array([list(GAINS.values())])
SMOOTH = ("mse", "mae", "max_abs_error", "energy", "continuous_load", "peak_tension")
"""Figures of merit without kinks in the experiment below."""


def short(number: int, duration: float = 20.0) -> Experiment:
    """A case without kinks: so much preload that no torque is limited, one way to integrate all along."""
    changes = {"controller.coordination.preload": 5000.0, "simulation.integrator": "exponential"}
    return override(case(number), changes | {"simulation.duration": duration})


STEPS = 3e-5, 3e-4, 3e-3
"""Relative steps of central differences. Rounding spoils the small ones, kinks of the fuzzy rules the large ones."""


def quotients(name: str, experiment: Experiment) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Central differences of the figures of merit (steps,) and of the error (steps, samples)."""
    steps = np.array(STEPS) * GAINS[name]
    result = rollout([name], (GAINS[name] + np.concatenate([-steps, steps]))[:, None], [experiment], stride=1)

    def quotient(table: np.ndarray) -> np.ndarray:
        return ((table[len(steps) :] - table[: len(steps)]).T / (2 * steps)).T

    return {key: quotient(table[:, 0]) for key, table in result.metrics.items()}, quotient(result.columns["e"][:, 0])


def nearest(ours: float, quotients: np.ndarray) -> float:
    """Of the quotients, the one most like a derivative."""
    return float(quotients[np.argmin(np.abs(quotients - ours))])


@pytest.fixture(scope="module")
def whole() -> Sensitivities:
    return sensitivities(NAMES, VALUES, [short(4)])


@pytest.mark.parametrize("name", NAMES)
def test_gradients_are_those_of_central_differences(name: str, whole: Sensitivities) -> None:
    expected, errors = quotients(name, short(4))
    place = NAMES.index(name)
    for metric in SMOOTH:
        ours, size = whole.gradients[metric][0, 0, place], whole.metrics[metric][0, 0] / GAINS[name]
        assert ours == pytest.approx(nearest(ours, expected[metric]), rel=3e-5, abs=1e-6 * size), metric
    slopes = whole.slopes[0, 0, :, place]
    assert np.abs(slopes - errors).max(axis=1).min() <= 1e-3 * np.abs(slopes).max() + 1e-12


def test_gradients_in_the_paper_s_case() -> None:
    """With one-step updates, limited torques and the vortex, over all of Case 4."""
    names, values = NAMES[:7], VALUES[:, :7]
    ours = sensitivities(names, values, [case(4)], stride=0)
    moved = [values * (1 + sign * 1e-4 * np.eye(7)[k]) for k in range(7) for sign in (1, -1)]
    mse = rollout(names, np.vstack(moved), [case(4)]).metrics["mse"][:, 0].reshape(7, 2)
    assert ours.gradients["mse"][0, 0] == pytest.approx((mse[:, 0] - mse[:, 1]) / (2e-4 * values[0]), rel=1e-5)


def test_the_run_is_the_run(whole: Sensitivities) -> None:
    plain = rollout(NAMES, VALUES, [short(4)], stride=1)
    assert whole.outcomes.tolist() == plain.outcomes.tolist()
    assert whole.end_times.tolist() == plain.end_times.tolist()
    assert np.abs(whole.errors[0, 0] - plain.columns["e"][0, 0]).max() < 1e-12
    for name, table in plain.metrics.items():
        assert whole.metrics[name] == pytest.approx(table, rel=1e-9, nan_ok=True)


def test_the_runs_of_a_scenario_with_their_derivatives(whole: Sensitivities) -> None:
    part = whole.take(0, axis=1)
    assert (part.outcomes.shape, part.gradients["mse"].shape) == ((1,), (1, len(NAMES)))
    assert part.reshape([1, 1]).slopes.tolist() == whole.slopes.tolist()


def test_the_gradient_of_the_mean_square_is_that_of_the_residuals(whole: Sensitivities) -> None:
    """What a Gauss-Newton step is made of."""
    errors, slopes = whole.errors[0, 0], whole.slopes[0, 0]
    assert 2 * errors @ slopes / len(errors) == pytest.approx(whole.gradients["mse"][0, 0], rel=1e-10)


def test_through_slack_and_saturation() -> None:
    """Case 1 jerks one rope loose: the crossings are differentiated too."""
    name = "controller.observer.l0"
    ours = sensitivities([name], [[5.0]], [short(1, 2.0)])
    expected, _ = quotients(name, short(1, 2.0))
    assert ours.metrics["slack_share"][0, 0] > 0
    slope = ours.gradients["mse"][0, 0, 0]
    assert slope == pytest.approx(nearest(slope, expected["mse"]), rel=1e-3)


def test_the_preload_moves_the_start() -> None:
    name = "controller.coordination.preload"
    taut = override(short(2, 1.0), {"reference.jerk_limit": 0.5})
    ours = sensitivities([name], [[5000.0]], [taut])
    values = [[5000 * (1 + k * 1e-3)] for k in (-1, 1)]
    low, high = rollout([name], values, [taut]).metrics["peak_tension"][:, 0]
    assert ours.gradients["peak_tension"][0, 0, 0] == pytest.approx((high - low) / 10.0, rel=1e-4)


def test_more_gains_than_lanes_and_other_neighbours_change_nothing(whole: Sensitivities) -> None:
    more = {f"controller.{law}.{gain}": value for law, gain, value in EXTRA}
    names = [*NAMES, *more]
    assert len(names) > LANES
    many = sensitivities(names, [[*GAINS.values(), *more.values()]], [short(4)], stride=0)
    assert many.gradients["mse"][0, 0, : len(NAMES)] == pytest.approx(whole.gradients["mse"][0, 0], rel=1e-9)
    assert many.errors.shape == (1, 1, 0)


EXTRA = [
    ("auxiliary", "k_a", 1.0),
    ("auxiliary", "gamma", 1e-5),
    ("observer", "filter_time", 0.2),
    ("observer", "rate_scale", 0.5),
    ("winch_2", "kp", 5e-4),
]


@pytest.mark.slow
def test_sensors_that_read_in_steps_are_differentiated_as_if_they_did_not() -> None:
    """The derivative of a step is zero almost everywhere: along it, feedback would vanish."""
    sea = load_ensemble("sea")
    calm = {"simulation.duration": 2.0, "controller.estimator": "kalman", "sensors.position_resolution": 1e-6}
    fine = replace(sea, experiment=override(sea.experiment, calm | {"sensors.encoder_counts": 0}))
    stepped = replace(sea, experiment=override(sea.experiment, calm))
    reading, stepping = (
        sensitivities(["controller.observer.l0"], [[20.0]], [ensemble.scenario(index, 7) for index in range(8)]).slopes
        for ensemble in (fine, stepped)
    )
    assert np.linalg.norm(reading - stepping) < 0.2 * np.linalg.norm(reading)


def test_a_diverging_run_is_a_result() -> None:
    result = sensitivities(["controller.nftsm.eta"], [[1e300], [0.05]], [short(1, 1.0)])
    assert result.outcomes[:, 0].tolist() == ["diverged", "completed"]
    for name, table in result.metrics.items():
        assert np.isnan(table[0, 0])
        assert np.isnan(result.gradients[name][0, 0]).all()
        assert np.isnan(result.gradients[name][1, 0]).all() == np.isnan(table[1, 0])
    assert np.isfinite(result.gradients["mse"][1]).all()
