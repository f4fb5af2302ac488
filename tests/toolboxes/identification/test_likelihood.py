"""Steps by the likelihood itself: its slopes beside differences, where they lead, what they say of the logs."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification.estimate import PredictionErrorMethod
from dualwinch.toolboxes.identification.likelihood import Likelihood, NewtonStep
from dualwinch.toolboxes.identification.options import EstimationOptions, SearchOptions
from dualwinch.toolboxes.identification.predictor import parameter_names
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
def test_steps_lead_to_where_no_neighbour_is_likelier(fitting: PredictionErrorMethod, likelihood: Likelihood) -> None:
    noise, at, step = fitting.initial_noise(), begin(friction_coefficient=1.2), None
    for _ in range(8):
        found = likelihood.step(at, noise, COORDINATES, step)
        assert found is not None
        step, at = found, found.at
    assert isinstance(step, NewtonStep)
    assert step.fall < 0.01
    spread = 0.3 * np.sqrt(np.diag(np.linalg.inv(step.information))) / [unknown.scale for unknown in UNKNOWNS]
    around = [at + sign * each for each in np.diag(spread) for sign in (1, -1)]
    assert (likelihood.deviances(around, noise, COORDINATES) > step.deviance).all()


def test_the_prior_is_part_of_it(fitting: PredictionErrorMethod, likelihood: Likelihood) -> None:
    noise, at = fitting.initial_noise(), begin(mass=1.06)
    free = SearchCoordinates(unknown_parameters(KEYS, RIGHT, {}))
    (without,) = likelihood.deviances([free.of(COORDINATES.values(at))], noise, free)
    assert likelihood.deviances([at], noise, COORDINATES)[0] - without == pytest.approx((600 / 300) ** 2)


def test_a_fixed_coordinate_stays(fitting: PredictionErrorMethod, likelihood: Likelihood) -> None:
    at = begin(friction_coefficient=1.2)
    step = likelihood.step(at, fitting.initial_noise(), COORDINATES, fixed=2)
    assert step is not None
    assert step.at[2] == at[2]
    assert step.at[1] != at[1]


def test_information_is_no_more_than_curvature(fitting: PredictionErrorMethod, likelihood: Likelihood) -> None:
    """Far from the best, where least squares and the likelihood disagree, the flatter of the two counts."""
    at, noise = begin(friction_coefficient=3.0), fitting.initial_noise()
    step = likelihood.step(at, noise, COORDINATES)
    assert step is not None
    values = COORDINATES.values(at)
    filtered = fitting.filters.run(fitting.with_values(values), noise)
    plain = likelihood.normal(values, noise, filtered)[:-1, :-1]
    assert (np.linalg.eigvalsh(step.information * np.outer(values, values)) >= -1e-6).all()
    assert np.trace(step.information / plain) <= len(values) * 1.001


def test_where_filters_diverge_there_is_no_step(fitting: PredictionErrorMethod) -> None:
    wild = override(RIGHT, {"plant.rope_1.modulus": 1e15, "plant.rope_2.modulus": 1e15})
    columns = [parameter_names(fitting.structure).index(key) for key in KEYS]
    lost = Likelihood(fitting.filters, lambda _: wild, columns, SearchOptions())
    assert lost.step(begin(), fitting.initial_noise(), COORDINATES) is None
    assert np.isinf(lost.deviances([begin()], fitting.initial_noise(), COORDINATES)).all()


def test_a_fit_that_should_get_better_and_does_not_has_not_converged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    options = EstimationOptions(search=SearchOptions(max_rounds=0))
    fitting = PredictionErrorMethod(sections_of([logged(RIGHT)], RIGHT), RIGHT, UNKNOWNS, options)
    start = np.array([unknown.start for unknown in UNKNOWNS]) * [1, 1, 3]
    assert fitting.run(start, noise=fitting.initial_noise()).converged
    deviances = Likelihood.deviances

    def worse(likelihood: Likelihood, points: list[np.ndarray], *given: Any, **named: Any) -> np.ndarray:
        """The end of a step, a single point, is never likelier than its beginning."""
        return deviances(likelihood, points, *given, **named) if len(points) > 1 else np.array([np.inf])

    monkeypatch.setattr(Likelihood, "deviances", worse)
    assert not fitting.run(start, noise=fitting.initial_noise()).converged


def test_a_likelihood_that_jumps_is_looked_at_beyond_its_jumps(
    fitting: PredictionErrorMethod, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Up to two deviations behind the optimum, the deviance is higher by a step than it is farther behind."""
    likelihood, noise = fitting.likelihood, fitting.initial_noise()
    smooth, at, step = likelihood.deviances, begin(), None
    for _ in range(4):
        step = likelihood.step(at, noise, COORDINATES, step)
        assert step is not None
        at = step.at
    assert step is not None
    assert likelihood.beyond_jumps(step, noise, COORDINATES) is None
    jagged = replace(step, curvatures=np.array([1.0, 7.0, 1.0]))
    assert likelihood.beyond_jumps(jagged, noise, COORDINATES) is None
    deviations = np.linalg.inv(step.directions)

    def deviances(height: float) -> Callable[..., np.ndarray]:
        def jumping(points: list[np.ndarray], *arguments: Any) -> np.ndarray:
            beyond = np.array([((point - at) @ deviations)[1] < -2.5 for point in points])
            return smooth(points, *arguments) - height * beyond

        return jumping

    monkeypatch.setattr(likelihood, "deviances", deviances(4.0))  # less than the rise over three deviations
    assert likelihood.beyond_jumps(jagged, noise, COORDINATES) is None
    monkeypatch.setattr(likelihood, "deviances", deviances(20.0))
    found = likelihood.beyond_jumps(jagged, noise, COORDINATES)
    assert found is not None
    assert (found - at) @ deviations == pytest.approx([0, -3, 0], abs=1e-6)
