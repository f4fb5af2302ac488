"""Numbers found in logs: what they are, how well they are known, what cannot be told."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dualwinch.config.ensemble_file import ensemble_to_toml, loads_ensemble
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification.diagnostics import unidentifiable_directions
from dualwinch.toolboxes.identification.estimate import PredictionErrorMethod, covariance_of
from dualwinch.toolboxes.identification.identify import identify
from dualwinch.toolboxes.identification.log import Log
from dualwinch.toolboxes.identification.options import DEFAULTS
from dualwinch.toolboxes.identification.resample import sections_of
from dualwinch.toolboxes.identification.unknowns import (
    Prior,
    UnknownParameter,
    estimable_keys,
    prior_of,
    problem_of,
    unknown_parameters,
)
from tests.toolboxes.identification.conftest import logged, machine

KEYS = ("plant.vehicle.mass", "plant.vehicle.drag_coefficient", "plant.rope_*.modulus", "plant.winch_1.inertia")
NOMINAL = {
    "plant.vehicle.mass": 1.1e4,
    "plant.vehicle.drag_coefficient": 0.25,
    "plant.rope_1.modulus": 7.4e10,
    "plant.rope_2.modulus": 8.5e10,
    "plant.winch_1.inertia": 2.0,
}
"""What is wrong by some 10 %."""


def truth(experiment: Experiment, keys: tuple[str, ...]) -> np.ndarray:
    values = leaves(experiment)
    return np.array([values[key] for key in keys])


@pytest.mark.slow
def test_numbers_are_found_and_known_as_well_as_is_said() -> None:
    right = machine()
    found = identify([logged(right)], KEYS, override(right, NOMINAL))
    off = (found.values - truth(right, found.keys)) / found.deviations
    assert found.converged
    assert np.abs(off).max() < 4
    assert np.sqrt((off**2).mean()) < 2
    share = dict(zip(found.keys, found.deviations / found.values, strict=True))
    assert share["plant.rope_1.modulus"] < 1e-3
    assert share["plant.vehicle.mass"] < 0.02
    assert found.unidentifiable == ()
    assert all(test.variance == pytest.approx(1, abs=0.03) for test in found.whiteness)
    assert found.noise["F1"] == pytest.approx(10, rel=0.03)
    assert found.noise["x"] == pytest.approx(np.hypot(5e-4, 1e-3 / np.sqrt(12)), rel=0.05)
    assert found.at_bounds == ()
    mass = found.unknowns[0]
    bounded = replace(found, unknowns=(replace(mass, upper=float(found.values[0])), *found.unknowns[1:]))
    assert bounded.at_bounds == (mass.key,)
    assert bounded.tables[0][1][0][3:6] == ["–"] * 3
    assert bounded.to_record()["parameters"][0]["deviation"] is None
    assert bounded.to_record()["parameters"][1]["deviation"] == found.deviations[1]
    assert any(note.startswith(f"{mass.key}: estimated at a bound of its range") for note in bounded.notes)
    assert leaves(found.experiment)["plant.vehicle.mass"] == pytest.approx(found.values[0])


@pytest.mark.slow
def test_noise_that_is_known_need_not_be_found_out() -> None:
    right = machine(sensors__speed_noise=5e-4)  # ropes stay taut: where one is slack, likelihoods have steps
    nominal = override(right, NOMINAL)
    unknowns = unknown_parameters(estimable_keys(KEYS, nominal), nominal, {})
    start = np.array([unknown.start for unknown in unknowns])
    fitting = PredictionErrorMethod(sections_of([logged(right)], nominal), nominal, unknowns)
    fit = fitting.run(start)
    passes = fitting.passes
    again = fitting.run(start, noise=fit.noise)
    assert again.converged
    assert again.noise is fit.noise
    assert fitting.passes - passes < passes
    deviations = np.sqrt(np.diag(covariance_of(fit.information, unknowns)))
    # a search ends where the deviance falls by less than 0.1, which a third of a deviation more does not change
    np.testing.assert_array_less(np.abs(again.values - fit.values), 0.1 * deviations)


@pytest.mark.nightly
@pytest.mark.slow
def test_several_logs_know_more_than_one() -> None:
    logs = [logged(machine(simulation__seed=seed)) for seed in (1, 2)]
    right, key = machine(), "plant.vehicle.mass"
    alone = identify(logs[:1], [key], right)
    both = identify(logs, [key], right)
    assert both.deviations[0] == pytest.approx(alone.deviations[0] / np.sqrt(2), rel=0.1)
    assert both.logs == ("run", "run")


def test_what_the_log_cannot_tell_is_named() -> None:
    """Where the vehicle stands still nothing tells its mass; position and encoder zeros shift together."""
    right = machine(reference__kind="uniform", reference__speed=1e-3, disturbance__vortex=False)
    found = identify([logged(right)], ["plant.vehicle.drag_coefficient", "plant.rope_1.modulus"], right)
    assert [each.keys for each in found.unidentifiable] == [("plant.vehicle.drag_coefficient",)]
    assert "next to no information" in found.unidentifiable[0].words
    assert found.values[0] == pytest.approx(0.3, rel=1), "it stays where it was"


def test_directions_are_told_in_words() -> None:
    unknowns = [UnknownParameter(key, "", 1.0, 0.0, 9.0, 1.0) for key in ("a", "b", "c")]
    ways = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    information = 1e4 * ways.T @ ways  # a + b and c are known, a - b is not
    (direction,) = unidentifiable_directions(information, unknowns)
    assert sorted(direction.keys) == ["a", "b"]
    assert direction.deviation > 1e3
    assert "only together with" in direction.words


@pytest.mark.slow
def test_what_is_known_beforehand_counts() -> None:
    right, key = machine(), "plant.vehicle.mass"
    prior = {key: Prior(1.2e4, 10.0)}
    found = identify([logged(right)], [key], right, priors=prior)
    assert found.values[0] > 1.15e4, "what is known to 10 kg is hardly moved by what says less"
    assert found.deviations[0] < 10


def test_what_is_held_out_is_predicted() -> None:
    right = machine()
    found = identify([logged(right)], ["plant.vehicle.mass"], right, hold_out=0.25)
    counts = {test.name: test.count for test in found.held_out}
    assert counts["x"] == pytest.approx(5000, abs=2)
    assert {test.name: test.count for test in found.whiteness}["x"] == pytest.approx(15000, abs=4)
    assert next(test for test in found.held_out if test.name == "F1").variance == pytest.approx(1, abs=0.1)


@pytest.mark.slow
def test_the_ensemble_draws_the_estimates_errors() -> None:
    right = machine()
    found = identify([logged(right)], KEYS, right)
    text = ensemble_to_toml(found.ensemble("fitted", seed=3))
    ensemble = loads_ensemble(text)
    drawn = np.array([list(scenario.draws.values())[: len(found.keys)] for scenario in ensemble.scenarios(400, seed=1)])
    order = [list(ensemble.distributions).index(key) for key in found.keys]
    np.testing.assert_allclose(drawn[:, order].mean(axis=0), found.values, atol=0, rtol=0.01)
    spread = drawn[:, order].std(axis=0) / found.deviations
    np.testing.assert_allclose(spread, 1, atol=0.15)
    correlation = np.corrcoef(drawn[:, order].T)
    np.testing.assert_allclose(correlation, found.correlation, atol=0.25)


def test_a_log_of_another_machine_is_refused() -> None:
    right = logged(machine())
    other = {name: -values if name == "tau_1" else values for name, values in right.columns.items()}
    with pytest.raises(
        ConfigurationError,
        match=r"log: tau_1 holds -.* N on average, .* is tau_1 of the opposite sign \(--column tau_1",
    ):
        identify([Log(right.t, other)], ["plant.vehicle.mass"], machine())


def test_something_must_be_fitted() -> None:
    with pytest.raises(ConfigurationError, match="keys: must name at least one parameter"):
        identify([logged(machine(simulation__duration=1.0))], [], machine())


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (["plant.vehicle.mas"], "did you mean 'plant.vehicle.mass'"),
        (["controller.nftsm.beta"], "no parameter that a log determines"),
        (["sensors.position_noise"], "no parameter that a log determines"),
        (["disturbance.vortex"], "--fit disturbance.vortex: no parameter that a log determines; it is true or false"),
    ],
)
def test_keys_that_no_log_tells_are_refused(keys: list[str], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        estimable_keys(keys, Experiment())


@pytest.mark.parametrize(
    "key", ["foo", "plant", "controller.nftsm.k", "simulation.engine", "disturbance.vortex", "plant.rope_*.modulus"]
)
def test_priors_are_of_parameters_that_a_log_tells(key: str) -> None:
    with pytest.raises(ConfigurationError, match=rf"^--prior {re.escape(key)}: "):
        problem_of("plant.vehicle.mass", Experiment(), None, {key: (1.0, 1.0)})


def test_a_pattern_leaves_out_switches() -> None:
    keys = estimable_keys(["*"], Experiment())
    assert "disturbance.strouhal" in keys
    assert not {"disturbance.vortex", "disturbance.integrated_phase"} & set(keys)


def test_priors_are_of_what_is_fitted_and_within_its_range() -> None:
    with pytest.raises(ConfigurationError, match=r"--prior plant.vehicle.mass: is not fitted"):
        unknown_parameters(["plant.rope_1.modulus"], Experiment(), {"plant.vehicle.mass": Prior(1, 1)})
    with pytest.raises(ConfigurationError, match=r"--prior plant.vehicle.mass=-1: must be"):
        unknown_parameters(["plant.vehicle.mass"], Experiment(), {"plant.vehicle.mass": Prior(-1, 1)})


@pytest.mark.parametrize("given", [(1e4, -1), (1e4, 0), (1e4, np.nan), (np.inf, 1), 5, (1, 2, 3), "ab", Prior(1e4, -1)])
def test_priors_are_a_mean_and_a_positive_deviation(given: Any) -> None:
    with pytest.raises(ConfigurationError, match=r"--prior plant.vehicle.mass: .*: must be mean and deviation"):
        prior_of("plant.vehicle.mass", given)


def test_a_pattern_stands_for_all_that_match_it_once() -> None:
    keys = estimable_keys(["plant.rope_*.modulus, plant.rope_1.modulus"], Experiment())
    assert keys == ("plant.rope_1.modulus", "plant.rope_2.modulus")


@pytest.mark.slow
def test_a_log_without_load_cells_does_without() -> None:
    right = machine()
    whole = logged(right)
    columns = {name: values for name, values in whole.columns.items() if not name.startswith("F")}
    found = identify(
        [replace(whole, columns=columns)], ["plant.vehicle.mass"], override(right, {"plant.vehicle.mass": 9e3})
    )
    assert abs(found.values[0] - 1e4) < 4 * found.deviations[0]
    assert "F1" not in found.noise


@pytest.mark.slow
def test_sensors_without_noise_are_not_taken_for_perfect() -> None:
    """The model of the filter, too, is right only to the size of its steps."""
    names = ("position_noise", "position_resolution", "speed_noise", "position_drift", "encoder_counts")
    silent = {f"sensors.{name}": 0 for name in names}
    calm = {"disturbance.current_sigma": 0.0, "disturbance.normal_force_sigma": 0.0}
    right = override(machine(), silent | calm)
    found = identify([logged(right)], KEYS, override(right, NOMINAL))
    off = (found.values - truth(right, found.keys)) / found.deviations
    assert np.abs(off).max() < 4
    assert found.noise["x"] == pytest.approx(DEFAULTS.noise.resolution)
    assert found.noise["theta_1"] == pytest.approx(DEFAULTS.noise.resolution / right.plant.winch_1.drum_radius)
    assert found.noise["F1"] == pytest.approx(10, rel=0.03)


def test_a_log_is_given_once(tmp_path: Path) -> None:
    log, (first, other) = logged(machine()), (tmp_path / "a.csv", tmp_path / "b" / ".." / "a.csv")
    (tmp_path / "b").mkdir()
    first.touch()
    for twice in ([log, log], [first, str(other)]):
        with pytest.raises(ConfigurationError, match=r"(logs|a\.csv): must be given once$"):
            identify(twice, "plant.vehicle.mass", machine())
