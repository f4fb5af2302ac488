"""A recorder that does not sample when the controller does, and sensors no better than their data sheets."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.identification.alternatives import ALTERNATIVES
from dualwinch.toolboxes.identification.cli.identify import options_with
from dualwinch.toolboxes.identification.identify import identify
from dualwinch.toolboxes.identification.log import Log
from dualwinch.toolboxes.identification.log import log as log_of_columns
from dualwinch.toolboxes.identification.options import DEFAULTS
from dualwinch.toolboxes.identification.predictor import RecordedExperiment
from dualwinch.toolboxes.identification.screening import LogScreening
from dualwinch.toolboxes.identification.unknowns import data_sheet_parameters
from tests.last_bit import perturbed

NOISE = {"x": 5e-4, "F1": 10.0, "F2": 10.0}
KEYS = ("plant.vehicle.mass", "plant.rope_*.modulus")
MODULUS = 8e10


def resampled(rate: float, phase: float) -> Log:
    """A log of Case 4 at a rate in Hz, from a phase in s on: torques, position and tensions only."""
    run = simulate(override(case(4), {"simulation.duration": 15.0, "sensors.tension_noise": 10.0}))
    rows = run.resample(times=np.arange(0, 14.9, 1 / rate) + phase)
    rng = np.random.default_rng(0)
    noisy = {name: rows[name] + size * rng.standard_normal(len(rows["t"])) for name, size in NOISE.items()}
    return log_of_columns({name: rows[name] for name in ("t", "tau_1", "tau_2")} | noisy)


def clock_of(log: Log) -> RecordedExperiment | None:
    """The recorder that is likelier than rows at the samples of Case 4."""
    return LogScreening([log.from_zero()], case(4), (), None, frozenset(ALTERNATIVES)).likeliest_clock(
        case(4), DEFAULTS
    )


def test_rows_at_the_samples_need_no_clock() -> None:
    assert clock_of(resampled(1000.0, 0.0)) is None


@pytest.mark.slow
@pytest.mark.parametrize("rate", [1000.0, 1024.0])
def test_the_clock_of_the_recorder_is_the_likeliest(rate: float) -> None:
    log = resampled(rate, 5e-4)
    clock = clock_of(log)
    assert clock is not None
    assert clock.recorder.phase == pytest.approx(5e-4, abs=1.3e-4)
    assert clock.recorder.interpolated
    assert clock_of(replace(log, columns=perturbed(dict(log.columns), 0))) == clock, "it does not hang on the last bit"


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.parametrize("rate", [1000.0, 1024.0, 2000.0])
def test_moduli_are_right_whenever_the_recorder_samples(rate: float) -> None:
    found = identify(resampled(rate, 5e-4), KEYS, case(4))
    off = np.abs(found.values - [1e4, MODULUS, MODULUS]) / found.deviations
    assert off.max() < 2.5
    assert found.deviations[1:].max() < 0.05 * MODULUS


def test_every_interval_contains_the_data_sheets() -> None:
    log = resampled(1000.0, 0.0)
    found = identify(log, "plant.vehicle.mass", case(4), plain=True)
    perfect = options_with([f"{name}=0" for name in vars(DEFAULTS.data_sheet)])
    certain = identify(log, "plant.vehicle.mass", case(4), plain=True, options=perfect)
    assert not certain.data_sheet
    assert set(found.data_sheet) == {each.key for each in data_sheet_parameters((), case(4), log.readings)}
    assert found.deviations[0] > 3 * certain.deviations[0]
    assert found.sheet_shares[0] > 0.9
    assert abs(found.values[0] - 1e4) < 3 * found.deviations[0]
    half = options_with(["load_cell_error = 0.5%"])
    assert half.data_sheet == replace(DEFAULTS.data_sheet, load_cell_error=0.005)
