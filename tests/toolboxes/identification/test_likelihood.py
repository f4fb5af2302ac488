"""Steps by the likelihood itself: its slopes beside differences, where they lead, what they say of the logs."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification.estimate import PredictionErrorMethod
from dualwinch.toolboxes.identification.likelihood import Likelihood, _bounded_step
from dualwinch.toolboxes.identification.noise import NoiseEstimator
from dualwinch.toolboxes.identification.options import EstimationOptions, NoiseOptions, SearchOptions
from dualwinch.toolboxes.identification.predictor import NoiseCovariances, parameter_names
from dualwinch.toolboxes.identification.resample import sections_of
from dualwinch.toolboxes.identification.unknowns import Prior, SearchCoordinates, estimable_keys, unknown_parameters
from tests.toolboxes.identification.conftest import logged, machine

KEYS = ("plant.vehicle.mass", "plant.vehicle.drag_coefficient", "plant.vehicle.friction_coefficient")
RIGHT = machine()
UNKNOWNS = unknown_parameters(estimable_keys(KEYS, RIGHT), RIGHT, {"plant.vehicle.mass": Prior(1e4, 300.0)})
COORDINATES = SearchCoordinates(UNKNOWNS)


@pytest.fixture(scope="module")
def fitting() -> PredictionErrorMethod:
    return PredictionErrorMethod(sections_of([logged(RIGHT)], RIGHT), RIGHT, UNKNOWNS)


@pytest.fixture(scope="module")
def likelihood(fitting: PredictionErrorMethod) -> Likelihood:
    return fitting.likelihood


def begin(**off: float) -> np.ndarray:
    values = np.array([unknown.start for unknown in UNKNOWNS])
    for name, factor in off.items():
        values[KEYS.index(f"plant.vehicle.{name}")] *= factor
    return COORDINATES.of(values)


@pytest.mark.slow
@pytest.mark.parametrize("speed_noise", [5e-4, 2e-3], ids=["taut", "a rope slackens"])
def test_no_neighbour_of_the_optimum_is_likelier(speed_noise: float) -> None:
    """Of a whole fit, along the eigenvectors of its covariance, with its own noise."""
    right = machine(sensors__speed_noise=speed_noise, simulation__duration=8.0)
    keys = estimable_keys((*KEYS, "plant.rope_*.modulus"), right)
    unknowns = unknown_parameters(keys, override(right, {"plant.vehicle.mass": 1.1e4}), {})
    fitting = PredictionErrorMethod(sections_of([logged(right)], right), right, unknowns)
    fit, coordinates = fitting.run(np.array([unknown.start for unknown in unknowns])), fitting.coordinates()
    assert fit.converged
    at = coordinates.of(fit.values)
    frame = fitting.likelihood.frame(at, fit.noise, coordinates)
    assert frame is not None
    (least,) = fitting.likelihood.deviances([at], fit.noise, coordinates)
    around = [at + sign * 0.1 * each for each in frame.directions for sign in (1, -1)]
    assert fitting.likelihood.deviances(around, fit.noise, coordinates).min() > least - 1e-4


def test_the_prior_is_part_of_it(fitting: PredictionErrorMethod, likelihood: Likelihood) -> None:
    noise, at = fitting.initial_noise(), begin(mass=1.06)
    free = SearchCoordinates(unknown_parameters(KEYS, RIGHT, {}))
    (without,) = likelihood.deviances([free.of(COORDINATES.values(at))], noise, free)
    assert likelihood.deviances([at], noise, COORDINATES)[0] - without == pytest.approx((600 / 300) ** 2)


def test_a_fixed_coordinate_stays(fitting: PredictionErrorMethod, likelihood: Likelihood) -> None:
    at = begin(friction_coefficient=1.2)
    maximum = likelihood.maximum(at, fitting.initial_noise(), COORDINATES, fixed=2)
    assert maximum is not None
    assert maximum.at[2] == at[2]
    assert maximum.at[1] != at[1]
    assert maximum.deviance < float(likelihood.deviances([at], fitting.initial_noise(), COORDINATES)[0])


def test_scoring_has_the_slopes_of_the_deviance(fitting: PredictionErrorMethod) -> None:
    """By unknowns and noise together, with outliers, over stretches that begin where the last one ended."""
    section = fitting.filters.sections[0]
    readings = section.readings.copy()
    readings[200::500] += 1.0
    filters = fitting.filters_of([replace(section, readings=readings)])
    values, noise = COORDINATES.values(begin(mass=1.001)), fitting.initial_noise()
    steps, logs = np.diag([1.0, 1e-4, 1e-5]), NoiseEstimator(filters, RIGHT, NoiseOptions()).coordinates(noise)
    ways = 1e-3 * np.eye(len(logs))

    def around(sign: int) -> list[tuple[Experiment, NoiseCovariances]]:
        by_values = [(fitting.with_values(values + sign * step), noise) for step in steps]
        return [*by_values, *((fitting.with_values(values), logs.noise(sign * way)) for way in ways)]

    sizes = np.concatenate([np.diag(steps), np.diag(ways)])
    normal = filters.scoring([(fitting.with_values(values), noise), *around(1)], sizes)
    assert normal is not None
    slopes = (filters.deviances(around(1)) - filters.deviances(around(-1))) / (4 * sizes)
    assert normal[:-1, -1] == pytest.approx(slopes, rel=0.02, abs=1e-3 * np.abs(slopes * sizes).max() / sizes.max())
    assert np.linalg.eigvalsh(normal[:-1, :-1] * np.outer(sizes, sizes)).min() > 0


def test_the_best_point_between_bounds_is_not_the_best_one_cut_off() -> None:
    information, slope = np.array([[1.0, 0.9], [0.9, 1.0]]), np.array([-2.0, -1.0])
    step = _bounded_step(information, slope, np.full(2, -1.0), np.full(2, 1.0))
    assert step == pytest.approx([1.0, 0.1], abs=1e-6)


def test_information_is_no_more_than_curvature(fitting: PredictionErrorMethod, likelihood: Likelihood) -> None:
    """Far from the best, where least squares and the likelihood disagree, the flatter of the two counts."""
    at, noise = begin(friction_coefficient=3.0), fitting.initial_noise()
    frame = likelihood.frame(at, noise, COORDINATES)
    assert frame is not None
    here = float(likelihood.objective([at], noise, COORDINATES)[0])
    information = frame.information_with(likelihood.poll(frame, at, here, 1.0, noise, COORDINATES).curvatures)
    values = COORDINATES.values(at)
    filtered = fitting.filters.run(fitting.with_values(values), noise)
    plain = likelihood.normal(values, noise, filtered)[:-1, :-1]
    assert (np.linalg.eigvalsh(information * np.outer(values, values)) >= -1e-6).all()
    assert np.trace(information / plain) <= len(values) * 1.001


def test_where_filters_diverge_there_is_no_maximum(fitting: PredictionErrorMethod) -> None:
    wild = override(RIGHT, {"plant.rope_1.modulus": 1e15, "plant.rope_2.modulus": 1e15})
    columns = [parameter_names(fitting.structure).index(key) for key in KEYS]
    lost = Likelihood(fitting.filters, lambda _: wild, columns, SearchOptions())
    assert lost.maximum(begin(), fitting.initial_noise(), COORDINATES) is None
    assert np.isinf(lost.deviances([begin()], fitting.initial_noise(), COORDINATES)).all()


def test_a_fit_that_is_given_up_too_early_has_not_converged() -> None:
    start = np.array([unknown.start for unknown in UNKNOWNS]) * [1, 1, 3]
    for iterations in (60, 2):
        options = EstimationOptions(search=SearchOptions(max_iterations=iterations))
        fitting = PredictionErrorMethod(sections_of([logged(RIGHT)], RIGHT), RIGHT, UNKNOWNS, options)
        assert fitting.continued(start, fitting.initial_noise()).converged == (iterations == 60)


def test_a_likelihood_that_jumps_is_looked_at_beyond_its_jumps(
    fitting: PredictionErrorMethod, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Up to two deviations behind the optimum, the deviance is higher by a step than it is farther behind."""
    likelihood, noise = fitting.likelihood, fitting.initial_noise()
    smooth, maximum = likelihood.deviances, likelihood.maximum(begin(), noise, COORDINATES)
    assert maximum is not None
    at = maximum.at
    frame = likelihood.frame(at, noise, COORDINATES)
    assert frame is not None
    deviations = np.linalg.inv(frame.directions)

    def deviances(height: float) -> Callable[..., np.ndarray]:
        def jumping(points: list[np.ndarray], *arguments: Any) -> np.ndarray:
            beyond = np.array([((point - at) @ deviations)[1] < -2.5 for point in points])
            return smooth(points, *arguments) - height * beyond

        return jumping

    monkeypatch.setattr(likelihood, "deviances", deviances(4.0))  # less than the rise over three deviations
    stay = likelihood.maximum(at, noise, COORDINATES)
    assert stay is not None
    assert (stay.at - at) @ deviations == pytest.approx([0, 0, 0], abs=0.05)
    monkeypatch.setattr(likelihood, "deviances", deviances(20.0))
    beyond = likelihood.maximum(at, noise, COORDINATES)
    assert beyond is not None
    assert (beyond.at - at) @ deviations == pytest.approx([0, -2.5, 0], abs=0.3)
    assert beyond.converged


def test_what_has_no_curvature_stays() -> None:
    """Nor does it keep the others from moving: the noise of a sensor that process noise hides, and a closed range."""
    information, slope = np.diag([2.0, 0.0, 2.0]), np.array([-1.0, 0.0, -1.0])
    step = _bounded_step(information, slope, np.array([-1.0, -1.0, 0.0]), np.array([1.0, 1.0, 0.0]))
    assert step == pytest.approx([0.5, 0.0, 0.0], abs=1e-6)
