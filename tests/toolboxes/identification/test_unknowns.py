"""Coordinates of the search: there and back, slopes beside differences, what is known beside draws."""

import numpy as np
import pytest

from dualwinch.toolboxes.identification.unknowns import Prior, SearchCoordinates, UnknownParameter

AMPLITUDE, ANGLE = "plant.winch_1.eccentricity", "plant.winch_1.eccentricity_angle"


def unknowns(size: Prior | None = None, at: Prior | None = None) -> list[UnknownParameter]:
    return [
        UnknownParameter("plant.vehicle.mass", "kg", 1e4, 5e3, 1.5e4, 500.0, Prior(1e4, 500.0)),
        UnknownParameter(ANGLE, "rad", 0.0, -9.0, 9.0, 1.8, at),
        UnknownParameter(AMPLITUDE, "m", 5e-5, 0.0, 3e-4, 1e-4, size),
        UnknownParameter("plant.winch_2.eccentricity", "m", 5e-5, 0.0, 3e-4, 1e-4),
    ]


@pytest.mark.parametrize("angle", [-3.0, 0.0, 2.0])
def test_there_and_back(angle: float) -> None:
    coordinates, values = SearchCoordinates(unknowns()), np.array([9e3, angle, 7e-5, 2e-5])
    assert coordinates.waves == ((2, 1),)
    np.testing.assert_allclose(coordinates.values(coordinates.of(values)), values, rtol=1e-12)


def test_slopes_are_those_of_differences() -> None:
    coordinates = SearchCoordinates(unknowns())
    at, step = coordinates.of(np.array([9e3, 2.0, 7e-5, 2e-5])), 1e-6
    for index, column in enumerate(coordinates.jacobian(at).T):
        moved = [coordinates.values(at + sign * step * np.eye(4)[index]) for sign in (1, -1)]
        np.testing.assert_allclose(column, (moved[0] - moved[1]) / (2 * step), rtol=1e-6, atol=1e-12)


def test_a_wave_goes_through_zero_to_the_other_side() -> None:
    coordinates = SearchCoordinates(unknowns())
    at, size = coordinates.of(np.array([1e4, 0.0, 1e-5, 2e-5])), coordinates.values
    ahead, there, behind = (size(np.where(np.arange(4) == 2, part, at)) for part in (0.1, 0.0, -0.1))
    assert ahead[1] == pytest.approx(0)
    assert behind[1] == pytest.approx(np.pi)
    assert ahead[2] == pytest.approx(behind[2])
    assert 0 < there[2] < 1e-7, "an angle without amplitude has no effect"


def test_what_is_known_of_a_wave_is_what_draws_say() -> None:
    size, at = Prior(5e-5, 2e-5), Prior(0.7, 1.2)
    coordinates = SearchCoordinates(unknowns(size, at))
    rows, centre = coordinates.prior_rows, coordinates.prior_centre
    drawn = np.random.default_rng(0).normal(size=(2, 400_000))
    sizes, angles = size.mean + size.deviation * drawn[0], at.mean + at.deviation * drawn[1]
    parts = np.array([sizes * np.cos(angles), sizes * np.sin(angles)]) / 1e-4
    np.testing.assert_allclose(centre[[2, 1]], parts.mean(axis=1), atol=2e-3)
    whitened = rows[:2][:, [2, 1]] @ (parts - parts.mean(axis=1, keepdims=True))
    np.testing.assert_allclose(np.cov(whitened), np.eye(2), atol=0.01)
    np.testing.assert_allclose(rows[2], [1, 0, 0, 0])
    np.testing.assert_array_equal(coordinates.known, [1, 1, 1, 0])


def test_what_is_known_of_a_half_leaves_a_wave_as_it_is() -> None:
    coordinates = SearchCoordinates(unknowns(size=Prior(5e-5, 2e-5)))
    assert coordinates.waves == ()
    assert SearchCoordinates(unknowns(), itself=1).waves == ()


def test_ranges_are_narrower_for_what_is_known() -> None:
    lower, upper = SearchCoordinates(unknowns(), within=2.0).bounds
    anywhere = SearchCoordinates(unknowns()).bounds
    assert (lower[0], upper[0]) == (18.0, 22.0)
    assert (anywhere[0][0], anywhere[1][0]) == (10.0, 30.0)
    assert (lower[3], upper[3]) == (anywhere[0][3], anywhere[1][3])
    assert (lower[1], upper[1]) == pytest.approx((-3.0, 3.0)), "parts are no larger than the amplitude can be"
