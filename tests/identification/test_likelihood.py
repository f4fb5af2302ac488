"""Steps by the likelihood itself: its slopes beside differences, where they lead, what they say of the logs."""

import numpy as np
import pytest

from dualwinch.identification.coordinates import Coordinates
from dualwinch.identification.fit import Fitting
from dualwinch.identification.likelihood import Likelihood, Step
from dualwinch.identification.sections import sections_of
from dualwinch.identification.unknowns import Prior, keys_of, unknowns_of
from dualwinch.simulation.settings import override
from tests.identification.conftest import logged, machine

KEYS = ("plant.vehicle.mass", "plant.vehicle.drag_coefficient", "plant.vehicle.friction_coefficient")
RIGHT = machine()
UNKNOWNS = unknowns_of(keys_of(KEYS, RIGHT), RIGHT, {"plant.vehicle.mass": Prior(1e4, 300.0)})


@pytest.fixture(scope="module")
def fitting() -> Fitting:
    return Fitting(sections_of([logged(RIGHT)], RIGHT), RIGHT, UNKNOWNS)


@pytest.fixture(scope="module")
def likelihood(fitting: Fitting) -> Likelihood:
    return fitting.likelihood(Coordinates(UNKNOWNS))


def begin(likelihood: Likelihood, **off: float) -> np.ndarray:
    values = np.array([unknown.start for unknown in UNKNOWNS])
    for name, factor in off.items():
        values[KEYS.index(f"plant.vehicle.{name}")] *= factor
    return likelihood.coordinates.of(values)


def test_steps_lead_to_where_no_neighbour_is_likelier(fitting: Fitting, likelihood: Likelihood) -> None:
    levels, at, step = fitting.first_levels(), begin(likelihood, friction_coefficient=1.2), None
    for _ in range(8):
        found = likelihood.step(at, levels, step)
        assert found is not None
        step, at = found, found.at
    assert isinstance(step, Step)
    assert step.better < 0.01
    spread = 0.3 * np.sqrt(np.diag(np.linalg.inv(step.information))) / [unknown.scale for unknown in UNKNOWNS]
    around = [at + sign * each for each in np.diag(spread) for sign in (1, -1)]
    assert (likelihood.unlikely(around, levels) > step.unlikely).all()


def test_what_is_known_beforehand_is_part_of_it(fitting: Fitting, likelihood: Likelihood) -> None:
    levels, at = fitting.first_levels(), begin(likelihood, mass=1.06)
    free = fitting.likelihood(Coordinates(unknowns_of(KEYS, RIGHT, {})))
    with_prior, without = likelihood.unlikely([at], levels), free.unlikely([begin(free, mass=1.06)], levels)
    assert with_prior[0] - without[0] == pytest.approx((600 / 300) ** 2)


def test_what_is_held_stays(fitting: Fitting, likelihood: Likelihood) -> None:
    at = begin(likelihood, friction_coefficient=1.2)
    step = likelihood.step(at, fitting.first_levels(), held=2)
    assert step is not None
    assert step.at[2] == at[2]
    assert step.at[1] != at[1]


def test_information_is_no_more_than_curvature(fitting: Fitting, likelihood: Likelihood) -> None:
    """Far from the best, where least squares and the likelihood disagree, the flatter of the two counts."""
    at, levels = begin(likelihood, friction_coefficient=3.0), fitting.first_levels()
    step = likelihood.step(at, levels)
    assert step is not None
    values = likelihood.coordinates.values(at)
    weights = fitting.filters.weigh(fitting.with_values(values), levels, outlier=4.0)
    plain = fitting.gains.normal(values, levels, weights)[:-1, :-1]
    assert (np.linalg.eigvalsh(step.information * np.outer(values, values)) >= -1e-6).all()
    assert np.trace(step.information / plain) <= len(values) * 1.001


def test_where_filters_go_astray_there_is_no_step(fitting: Fitting, likelihood: Likelihood) -> None:
    wild = override(RIGHT, {"plant.rope_1.modulus": 1e15, "plant.rope_2.modulus": 1e15})
    lost = Likelihood(
        fitting.filters,
        fitting.gains,
        lambda _: wild,
        lambda _, levels: fitting.filters.weigh(wild, levels),
        likelihood.coordinates,
        4.0,
    )
    assert lost.step(begin(likelihood), fitting.first_levels()) is None
    assert np.isinf(lost.unlikely([begin(likelihood)], fitting.first_levels())).all()


def test_a_fit_that_should_get_better_and_does_not_is_not_at_rest(
    fitting: Fitting, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dualwinch.identification.fit.ROUNDS", 0)
    start = np.array([unknown.start for unknown in UNKNOWNS]) * [1, 1, 3]
    assert fitting.run(start, known=fitting.first_levels()).settled
    monkeypatch.setattr(Likelihood, "_checked", lambda _, at, *given: (np.zeros_like(at), given[1]))
    assert not fitting.run(start, known=fitting.first_levels()).settled
