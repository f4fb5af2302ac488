"""Runs that tell: what is expected of them is what fits to their simulated logs come to."""

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest

from dualwinch.config.experiment_file import loads, to_toml
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.identification.estimate import PredictionErrorMethod
from dualwinch.toolboxes.identification.experiment_design import ExcitationDesign, excite
from dualwinch.toolboxes.identification.identify import identify
from dualwinch.toolboxes.identification.log import log_of
from dualwinch.toolboxes.identification.options import DEFAULTS, DataSheetOptions
from dualwinch.toolboxes.identification.resample import sections_of
from dualwinch.toolboxes.identification.unknowns import unknown_parameters
from tests.last_bit import SEEDS, perturbed
from tests.toolboxes.identification.conftest import machine

KEYS = ("plant.vehicle.mass", "plant.vehicle.drag_coefficient", "plant.rope_*.modulus")


@pytest.fixture(scope="module")
def designed() -> ExcitationDesign:
    experiment = machine()
    return excite(KEYS, experiment, duration=30.0, trials=24, seed=2)


@pytest.mark.nightly
@pytest.mark.slow
def test_what_is_expected_is_what_fits_come_to(designed: ExcitationDesign) -> None:
    """Errors of four seeded logs, over what was expected beforehand, are of the size of 1; so are stated deviations.

    By the median: of a log that seems to show a force that nobody recorded, a fit says so and is less sure. Of the
    first log wider models are tried, and none is likelier; the others are fitted by the one described, which is
    quicker.
    """
    perfect = replace(
        DEFAULTS,
        data_sheet=DataSheetOptions(**dict.fromkeys(vars(DEFAULTS.data_sheet), 0.0)),
        noise=replace(DEFAULTS.noise, described_factor=1.0),  # the sea is as described, as the design takes it
    )
    as_described = replace(perfect, search=replace(DEFAULTS.search, nuisance_share=0.0))
    right = leaves(designed.experiment)
    truth = np.array([right[key] for key in designed.keys])
    offs, shares = [], []
    for seed in range(11, 15):
        log = log_of(simulate(override(designed.experiment, {"simulation.seed": seed})))
        found = identify([log], KEYS, designed.experiment, options=as_described if offs else perfect)
        assert not found.along
        shares.append(found.deviations / designed.deviations)
        offs.append((found.values - truth) / designed.deviations)
    np.testing.assert_allclose(np.median(shares, axis=0), 1, atol=0.3)
    size = np.sqrt(np.mean(np.square(offs)))
    assert 0.5 < size < 1.6, "16 standard normal numbers: beyond that once in a thousand times"


def test_the_motion_tells_more_than_the_present_one(designed: ExcitationDesign) -> None:
    volume = np.linalg.slogdet(designed.covariance)[1]
    assert designed.present is not None
    assert volume < np.linalg.slogdet(designed.present)[1] - 1


def test_the_run_keeps_to_its_limits_and_goes_through_a_file(designed: ExcitationDesign) -> None:
    experiment = loads(to_toml(designed.experiment))
    run = simulate(experiment)
    assert run.outcome == "completed"
    assert run.metrics.peak_tension <= experiment.controller.limits.tension_max
    assert run["x"].max() < 49.1
    assert experiment.simulation.readings
    assert experiment.reference == designed.experiment.reference


@pytest.mark.slow
def test_the_same_seed_gives_the_same_motion(designed: ExcitationDesign) -> None:
    experiment = machine()
    again = excite(KEYS, experiment, duration=30.0, trials=24, seed=2, threads=1)
    assert again.experiment == designed.experiment
    np.testing.assert_array_equal(again.covariance, designed.covariance)


def test_it_says_what_to_expect(designed: ExcitationDesign) -> None:
    words = repr(designed)
    assert f"{designed.deviations[0]:.2g}" in words
    assert f"{designed.present_deviations[0]:.2g}" in words
    assert "way-points" in words
    assert "plant.rope_2.modulus" in designed._repr_html_()
    assert len(designed.plot().axes) == 2


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"duration": 1.0}, "duration = 1: must be 5 to 3600 s"),
        ({"criterion": "E"}, "criterion = E: must be D or A"),
        ({"trials": 0}, "trials = 0: must be a whole number >= 1"),
        ({"seed": -1}, "seed = -1: must be a whole number from 0 to 4294967295"),
        ({"seed": 2**32}, "seed = 4294967296: must be a whole number from 0 to 4294967295"),
    ],
)
def test_options_out_of_range_are_refused(options: dict, words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        excite(KEYS, machine(), **options)


def test_limits_that_no_motion_satisfies_are_reported() -> None:
    experiment = machine()
    with pytest.raises(
        ConfigurationError, match=r"none of \d+ motions is within the limits; the nearest has a motor's torq"
    ):
        excite(KEYS, experiment, torque=20.0, duration=20.0, trials=8)


def test_a_method_and_its_logs_are_freed_without_the_garbage_collector() -> None:
    """A search goes through hundreds of logs: those that wait for the collector would fill the memory."""
    experiment = override(machine(), {"simulation.duration": 1.0})
    sections = sections_of([log_of(simulate(experiment))], experiment, DEFAULTS.resampling)
    unknowns = unknown_parameters(["plant.vehicle.mass"], experiment, {}, DEFAULTS.search)
    gc.collect()
    gc.disable()
    try:
        method = PredictionErrorMethod(sections, experiment, unknowns, threads=1)
        assert method.information(np.array([unknown.start for unknown in unknowns])) is not None
        alive = weakref.ref(method)
        del method
        assert alive() is None
    finally:
        gc.enable()


@pytest.mark.slow
def test_a_motion_and_what_to_expect_of_it_do_not_hang_on_the_last_bit() -> None:
    noisy = override(machine(), {"sensors.tension_noise": 10.0, "sensors.position_noise": 5e-4})
    keys = ("plant.vehicle.mass", "plant.rope_1.modulus")
    design = excite(keys, noisy, duration=10.0, trials=16)
    for seed in SEEDS:
        moved = replace(perturbed(noisy, seed), controller=noisy.controller)
        near = excite(keys, moved, duration=10.0, trials=16)
        np.testing.assert_allclose(near.experiment.reference.points, design.experiment.reference.points, rtol=1e-6)
        np.testing.assert_allclose(
            near.covariance, design.covariance, rtol=1e-6, atol=1e-9 * abs(design.covariance).max()
        )
