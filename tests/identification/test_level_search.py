"""Noise and scatter that logs tell, beside what was simulated."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.identification.fit import OUTLIER, Fitting
from dualwinch.identification.level_search import LevelSearch
from dualwinch.identification.sections import sections_of
from dualwinch.identification.unknowns import keys_of, unknowns_of
from dualwinch.model.signals import Signal
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override
from tests.identification.conftest import logged, machine

T = np.linspace(0, 20, 2001)


def search(right: Experiment, believed: Experiment) -> tuple[LevelSearch, Fitting]:
    unknowns = unknowns_of(keys_of(["plant.vehicle.mass"], believed), believed, {})
    fitting = Fitting(sections_of([logged(right)], believed), believed, unknowns)
    return LevelSearch(fitting.filters, believed, OUTLIER), fitting


def test_a_force_that_nobody_describes_is_found() -> None:
    """First-order noise of 300 N that lasts a second, as the filter takes it for."""
    calm = machine()
    drawn, kept = np.random.default_rng(2).normal(size=len(T)), np.exp(-(T[1] - T[0]))
    gust = np.zeros(len(T))
    for k in range(1, len(T)):
        gust[k] = kept * gust[k - 1] + 300 * np.sqrt(1 - kept**2) * drawn[k]
    force = Signal.from_arrays(T, gust, unit="N")
    level, fitting = search(replace(calm, disturbance=replace(calm.disturbance, force=force)), calm)
    found = level.scattered(calm, fitting.first_levels(), anywhere=True)
    assert found.scatter["force"].deviation == pytest.approx(300, rel=0.35)
    assert found.scatter["torque_1"].deviation < 0.1
    quiet, calmly = search(calm, calm)
    assert quiet.scattered(calm, calmly.first_levels(), anywhere=True).scatter["force"].deviation < 30


def test_noise_is_found_from_far_off() -> None:
    right = machine()
    level, fitting = search(right, override(right, {"sensors.tension_noise": 60.0, "sensors.speed_noise": 1e-3}))
    levels = fitting.first_levels()
    weights = fitting.filters.weigh(right, levels, outlier=OUTLIER, gains=False)
    found = level.quieted(right, levels, weights)
    assert np.sqrt(found.noise[1]) == pytest.approx(2e-3, rel=0.05)
    np.testing.assert_allclose(np.sqrt(found.noise[2:4]), 10, rtol=0.1)


def test_scatter_that_filters_bear_is_not_widened() -> None:
    right = machine()
    level, fitting = search(right, right)
    levels = fitting.first_levels()
    assert level.wide_enough(right, levels).scatter["torque_1"] == levels.scatter["torque_1"]
