"""Noise and scatter that logs tell, beside what was simulated."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.model.signals import Signal
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.identification.estimate import PredictionErrorMethod
from dualwinch.toolboxes.identification.identify import identify
from dualwinch.toolboxes.identification.log import log_of
from dualwinch.toolboxes.identification.noise import DESCRIBED, NoiseEstimator, minimum_nearby
from dualwinch.toolboxes.identification.options import NoiseOptions
from dualwinch.toolboxes.identification.predictor import GaussMarkov
from dualwinch.toolboxes.identification.resample import sections_of
from dualwinch.toolboxes.identification.unknowns import estimable_keys, unknown_parameters
from tests.tiers import all_but
from tests.toolboxes.identification.conftest import SEA, logged, machine

T = np.linspace(0, 20, 2001)


def search(right: Experiment, nominal: Experiment) -> tuple[NoiseEstimator, PredictionErrorMethod]:
    unknowns = unknown_parameters(estimable_keys(["plant.vehicle.mass"], nominal), nominal, {})
    fitting = PredictionErrorMethod(sections_of([logged(right)], nominal), nominal, unknowns)
    return NoiseEstimator(fitting.filters, nominal, NoiseOptions()), fitting


def test_a_force_that_nobody_describes_is_found() -> None:
    """First-order noise of 300 N that lasts a second, as the filter takes it for."""
    calm = machine()
    drawn, kept = np.random.default_rng(2).normal(size=len(T)), np.exp(-(T[1] - T[0]))
    gust = np.zeros(len(T))
    for k in range(1, len(T)):
        gust[k] = kept * gust[k - 1] + 300 * np.sqrt(1 - kept**2) * drawn[k]
    force = Signal.from_arrays(T, gust, unit="N")
    estimator, fitting = search(replace(calm, disturbance=replace(calm.disturbance, force=force)), calm)
    found = estimator.with_process_noise(calm, fitting.initial_noise(), anywhere=True)
    assert found.process["force"].deviation == pytest.approx(300, rel=0.35)
    assert found.process["torque_1"].deviation < 0.1
    quiet, calmly = search(calm, calm)
    assert quiet.with_process_noise(calm, calmly.initial_noise(), anywhere=True).process["force"].deviation < 30


def test_torques_that_were_not_recorded_right_are_found_without_a_further_force() -> None:
    right = machine(simulation__duration=10.0)
    log, draw, kept = logged(right), np.random.default_rng(3), np.exp(-0.001 / 0.05)
    columns = dict(log.columns)
    for name in ("tau_1", "tau_2"):
        off = np.zeros(len(log.t))
        for k, normal in enumerate(draw.normal(size=len(off) - 1), 1):
            off[k] = kept * off[k - 1] + 3.0 * np.sqrt(1 - kept**2) * normal
        columns[name] = columns[name] - off
    unknowns = unknown_parameters(["plant.vehicle.mass"], right, {})
    fitting = PredictionErrorMethod(sections_of([replace(log, columns=columns)], right), right, unknowns)
    noise = fitting.initial_noise()
    found = NoiseEstimator(fitting.filters, right, NoiseOptions()).with_torque_noise(right, noise)
    assert 1.5 < found.process["torque_1"].deviation < 6, "roughly, from a thousandth of it"
    assert found.process["force"] == noise.process["force"]


def test_noise_is_found_from_far_off() -> None:
    right = machine()
    estimator, fitting = search(right, override(right, {"sensors.tension_noise": 60.0, "sensors.speed_noise": 1e-3}))
    noise = fitting.initial_noise()
    filtered = fitting.filters.run(right, noise, gains=False)
    found = estimator.with_measurement_noise(right, noise, filtered)
    assert np.sqrt(found.measurement[1]) == pytest.approx(2e-3, rel=0.05)
    np.testing.assert_allclose(np.sqrt(found.measurement[2:4]), 10, rtol=0.1)
    for _ in range(4):  # where steps are of the last bit, nothing is extrapolated from them
        again = estimator.with_measurement_noise(right, found, fitting.filters.run(right, found, gains=False))
        np.testing.assert_allclose(again.measurement, found.measurement, rtol=0.05)
        found = again


@pytest.mark.parametrize(("minimum", "most"), [(0.0, 3), (0.1, 4), (-0.3, 5), (1.2, 6), (-9.0, 4)])
def test_a_search_for_a_minimum_ends_soon_where_it_is_near(minimum: float, most: int) -> None:
    asked = []

    def cost(at: float) -> float:
        asked.append(at)
        return 500 * np.cosh(at - minimum)

    at, least = minimum_nearby(cost, (0.0, 500 * np.cosh(minimum)), 0.35, (-1.4, 1.4), 0.1, 7)
    assert at == pytest.approx(np.clip(minimum, -1.4, 1.4), abs=0.02)
    assert least == 500 * np.cosh(at - minimum)
    assert len(asked) <= most
    assert max(np.abs(asked)) <= 1.4


def test_a_minimum_is_never_worse_than_the_start() -> None:
    """Of a cost that rises steeply to one side, a parabola's minimum is none."""

    def cost(at: float) -> float:
        return 10 * at + 100 * abs(at - 0.5) if at > 0 else -200 * at + 50

    _, least = minimum_nearby(cost, (0.0, 50.0), 0.85, (-3.4, 3.4), 0.3, 5)
    assert least <= 50
    crooked, least = minimum_nearby(lambda at: -20 * at if at < 0 else 200 * at, (0.0, 0.0), 0.85, (-3.4, 3.4), 0.3, 5)
    assert (crooked, least) == (0.0, 0.0)


def test_scatter_that_filters_bear_is_not_widened() -> None:
    right = machine()
    estimator, fitting = search(right, right)
    noise = fitting.initial_noise()
    assert estimator.tolerable(right, noise).process["torque_1"] == noise.process["torque_1"]


def test_the_size_of_a_disturbance_is_no_information_on_its_coefficient() -> None:
    right = machine(disturbance__current_sigma=0.05)
    _, fitting = search(right, right)
    noise, more = fitting.initial_noise(), override(right, {"plant.vehicle.drag_coefficient": 0.6})
    assert noise.process_of(right.plant.vehicle)["current"].deviation == pytest.approx(0.05)
    assert noise.process_of(more.plant.vehicle)["current"].deviation == pytest.approx(0.05 * 0.3 / 0.6)


@pytest.mark.parametrize("factor", all_but([3.0], [1 / 3, 3.0]))
def test_the_size_of_the_sea_is_found_where_another_is_described(factor: float) -> None:
    right = machine(simulation__duration=40.0)
    other = {key: factor * size for key, size in SEA.items()}
    found, expected = (_with_sea(right, override(right, sea)) for sea in (other, SEA))
    for name in ("current", "normal_force_variation"):
        assert found[name].deviation == pytest.approx(expected[name].deviation, rel=0.3), name
    assert found["normal_force_variation"].deviation == pytest.approx(0.1 * 4900, rel=0.5)


def _with_sea(right: Experiment, nominal: Experiment) -> dict[str, GaussMarkov]:
    estimator, fitting = search(right, nominal)
    noise = fitting.initial_noise()
    for _ in range(2):
        noise = estimator.with_sea(right, noise)
    return noise.process_of(right.plant.vehicle)


def test_a_sea_whose_size_is_known_stays_as_it_is() -> None:
    right = machine()
    _, fitting = search(right, right)
    known = NoiseEstimator(fitting.filters, right, NoiseOptions(described_factor=1.0))
    noise = fitting.initial_noise()
    assert known.with_sea(right, noise) is noise


@pytest.mark.nightly
@pytest.mark.slow
def test_what_disturbances_did_is_no_noise_of_nearly_perfect_sensors() -> None:
    """The mass is right at the start, so that it hardly moves while the process noise is at its least."""
    right = override(case(4), {"simulation.readings": True, "simulation.duration": 12.0, "sensors.tension_noise": 10.0})
    found = identify(log_of(simulate(right)), "plant.vehicle.mass", case(4))
    assert abs(found.values[0] - right.plant.vehicle.mass) < 4 * found.deviations[0]
    assert found.noise["v"] < 1e-4


@pytest.mark.slow
def test_a_search_that_begins_with_a_far_larger_sea_ends_where_others_do(monkeypatch: pytest.MonkeyPatch) -> None:
    right = machine(simulation__duration=6.0)
    _, fitting = search(right, right)
    start = np.array([unknown.start for unknown in fitting.unknowns])
    usual, noise = fitting.run(start), fitting.initial_noise()
    sea = {name: replace(noise.process[name], deviation=20 * noise.process[name].deviation) for name in DESCRIBED}
    monkeypatch.setattr(fitting, "initial_noise", lambda: replace(noise, process={**noise.process, **sea}))
    found = fitting.run(start)
    assert usual.converged
    assert found.converged
    assert found.deviance == pytest.approx(usual.deviance, abs=1.0)
