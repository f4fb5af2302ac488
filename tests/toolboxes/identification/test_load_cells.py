"""Load cells with a lag: the model that is fitted has it too."""

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification.filter import LogFilters
from dualwinch.toolboxes.identification.identify import identify
from dualwinch.toolboxes.identification.noise import initial_measurement_noise
from dualwinch.toolboxes.identification.options import DEFAULTS
from dualwinch.toolboxes.identification.prediction import compile_predictor
from dualwinch.toolboxes.identification.predictor import (
    NoiseCovariances,
    described_disturbances,
    predicted_system,
    predictor_structure,
)
from dualwinch.toolboxes.identification.resample import sections_of
from dualwinch.toolboxes.identification.unknowns import estimable_keys, nuisance_parameters
from tests.toolboxes.identification.conftest import logged, machine

LAG = "sensors.load_cell_time_constant"
SLOW = machine(sensors__load_cell_time_constant=2e-3)


def test_the_lag_of_the_load_cells_is_the_likeliest() -> None:
    structure, (section,) = predictor_structure(SLOW), sections_of([logged(SLOW)], SLOW)
    noise = NoiseCovariances(
        initial_measurement_noise(section.readings, SLOW, DEFAULTS.noise),
        described_disturbances(SLOW, DEFAULTS.noise),
        SLOW.plant.vehicle,
    )
    filters = LogFilters(compile_predictor(predicted_system(structure, ())), structure, [section], DEFAULTS)
    lags = [1.5e-3, 1.9e-3, 2e-3, 2.1e-3, 2.5e-3]
    deviances = filters.deviances([(override(SLOW, {LAG: lag}), noise) for lag in lags])
    assert np.argmin(deviances) == 2
    assert deviances[[0, 4]].min() > deviances[2] + 100


def test_a_described_lag_is_estimated_around_its_value() -> None:
    (found,) = (each for each in nuisance_parameters((), SLOW) if each.key == LAG)
    assert found.prior is not None
    assert (found.start, found.prior.deviation) == pytest.approx((2e-3, 2e-3))
    assert LAG not in {each.key for each in nuisance_parameters((), machine())}


def test_what_zero_leaves_out_is_not_fitted_before_it_has_a_value() -> None:
    assert estimable_keys([LAG], SLOW) == (LAG,)
    for key in (LAG, "plant.rope_2.mass_per_length"):
        with pytest.raises(ConfigurationError, match=rf"--fit {key}: .* 0 leaves it out .*--set {key}="):
            estimable_keys([key], machine())


@pytest.mark.nightly
@pytest.mark.slow
def test_the_lag_is_found_with_the_mass() -> None:
    keys = ["plant.vehicle.mass", "plant.rope_*.modulus", LAG]
    found = identify(logged(SLOW), keys, override(SLOW, {LAG: 1e-3}))
    true = [10000.0, 8e10, 8e10, 2e-3]
    assert (np.abs(found.values - true) < 4 * np.sqrt(np.diag(found.covariance))).all()
    assert found.values[3] == pytest.approx(2e-3, rel=0.02)


@pytest.mark.nightly
@pytest.mark.slow
def test_a_lag_that_nobody_described_is_found() -> None:
    """Held for instantaneous, readings 2 ms late leave so much torque unexplained that the log was refused."""
    found = identify(logged(SLOW), ["plant.vehicle.mass", "plant.rope_*.modulus"], machine())
    assert (np.abs(found.values - [10000.0, 8e10, 8e10]) < 4 * np.sqrt(np.diag(found.covariance))).all()
    assert any(
        note.startswith("load cells lag by 2 ms, which the experiment does not describe") for note in found.notes
    )
    assert found.experiment.sensors.load_cell_time_constant == pytest.approx(2e-3, rel=0.02)
    quick = identify(logged(machine()), ["plant.vehicle.mass"], machine())
    assert not any("load cells lag" in note for note in quick.notes)


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.parametrize("beyond", [0.0, 1.0])
def test_friction_of_sheaves_is_found_wherever_the_cells_are(beyond: float) -> None:
    sheaves = {
        f"plant.winch_{number}.{name}": value
        for number in (1, 2)
        for name, value in (("sheave_friction", 0.03), ("cell_beyond", beyond))
    }
    right = override(machine(simulation__duration=8.0), sheaves)
    nominal = override(right, {f"plant.winch_{number}.sheave_friction": 0.05 for number in (1, 2)})
    found = identify(logged(right), ["plant.vehicle.mass", "plant.winch_*.sheave_friction"], nominal, plain=True)
    assert (np.abs(found.values - [10000.0, 0.03, 0.03]) < 4 * found.deviations).all()
    assert (found.deviations[1:] < 0.015).all()
