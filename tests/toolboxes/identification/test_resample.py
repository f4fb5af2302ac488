"""Logs on samples: what arrives when, what says something new, what is refused."""

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification.log import log
from dualwinch.toolboxes.identification.options import ResamplingOptions
from dualwinch.toolboxes.identification.predictor import READINGS
from dualwinch.toolboxes.identification.resample import counting, resampled

ROWS = 400
REPEATS = ResamplingOptions().repeats


def columns(**changed: np.ndarray) -> dict[str, np.ndarray]:
    """A second and a half at 1 kHz: torques that rise, a position with noise."""
    t = np.arange(ROWS) * 1e-3
    noise = np.random.default_rng(0).normal(0, 1e-3, ROWS)
    return {"t": t, "tau_1": 20 + t, "tau_2": 20 - t, "x": noise} | changed


def at(readings: np.ndarray, name: str) -> np.ndarray:
    return readings[:, READINGS.index(name)]


def test_torques_arrive_late_and_readings_do_not() -> None:
    given = columns()
    for late in (0, 1, 3):
        inputs, readings = resampled(log(given), override(Experiment(), {"simulation.delay_samples": late}))
        assert len(inputs) == len(readings) == ROWS - late
        np.testing.assert_array_equal(inputs[:, 1], given["tau_1"][: ROWS - late])
        np.testing.assert_allclose(inputs[:, 0], given["t"][late:], atol=1e-12)
        np.testing.assert_array_equal(at(readings, "x"), given["x"][late:])


def test_readings_are_of_the_time_before_their_sensors_delay() -> None:
    given = columns(F1=1000 + columns()["t"])
    late = override(Experiment(), {"sensors.position_delay": 4.3e-3, "sensors.tension_delay": 2e-3})
    _, readings = resampled(log(given), late)
    for name, samples in (("x", 4), ("F1", 2)):
        np.testing.assert_array_equal(at(readings, name)[:-samples], given[name][samples:])
        assert np.isnan(at(readings, name)[-samples:]).all()


def test_samples_that_jitter_are_when_the_log_says() -> None:
    early = np.random.default_rng(1).uniform(-5e-5, 5e-5, ROWS)
    given = columns()
    given["t"] = given["t"] + early
    steady, _ = resampled(log(given), Experiment())
    np.testing.assert_allclose(np.diff(steady[:, 0]), 1e-3)
    np.testing.assert_allclose(steady[:, 3], 1e-3)
    inputs, readings = resampled(log(given), override(Experiment(), {"simulation.jitter": 5e-5}))
    np.testing.assert_allclose(inputs[:, 0], given["t"], atol=1e-12)
    np.testing.assert_allclose(inputs[:-1, 3], np.diff(given["t"]), atol=1e-12)
    np.testing.assert_array_equal(at(readings, "x"), given["x"])


def test_samples_that_jitter_and_have_no_row_are_in_between() -> None:
    given = columns()
    given["t"] = given["t"] + 3e-5 * np.sin(np.arange(ROWS))
    thinned = {name: values[::2] for name, values in given.items()}
    inputs, _ = resampled(log(thinned), override(Experiment(), {"simulation.jitter": 5e-5}))
    np.testing.assert_allclose(inputs[::2, 0], thinned["t"], atol=1e-12)
    assert np.diff(inputs[:, 0]).min() > 0.9e-3


def test_rows_between_samples_and_gaps() -> None:
    """A log at a third of the rate, with a gap in the position: torques are held, the rest is no reading."""
    given = columns()
    given = {name: np.tile(values, 3)[::3] for name, values in given.items()} | {"t": np.arange(ROWS) * 3e-3}
    given["x"][10:20] = np.nan
    inputs, readings = resampled(log(given), Experiment())
    assert len(inputs) == 3 * ROWS - 2
    np.testing.assert_array_equal(inputs[:9, 1], np.repeat(given["tau_1"][:3], 3))
    read = np.isfinite(at(readings, "x"))
    assert read.sum() == ROWS - 10
    assert read[0]
    assert not read[[1, 2, 30]].any()


def test_a_sensor_that_repeats_itself_says_nothing() -> None:
    x = columns()["x"].copy()
    x[100 : 100 + REPEATS] = x[100]
    x[200 : 200 + REPEATS - 1] = x[200]
    _, readings = resampled(log(columns(x=x)), Experiment())
    read = np.isfinite(at(readings, "x"))
    assert read[100]
    assert not read[101 : 100 + REPEATS].any(), "silent"
    assert read[200 : 200 + REPEATS].all(), "chance"


@pytest.mark.parametrize("rate", [0.07, -0.07, 0.31, 3.7])
def test_encoders_say_where_they_are_when_they_count(rate: float) -> None:
    """Of a steadily turning drum, in counts a sample: the mean error is far below that of rounding, half a count."""
    count = 1e-3
    angle = count * (0.2 + rate * np.arange(ROWS))
    read = count * np.floor(angle / count + 0.5)
    _, readings = resampled(log(columns(theta_1=read)), Experiment())
    found = at(readings, "theta_1")
    kept = np.isfinite(found)
    kept[: np.flatnonzero(kept)[1]] = False  # before the first there is no telling how long it took
    assert abs(np.mean(found[kept] - angle[kept])) < 0.06 * count
    assert np.abs(found[kept] - angle[kept]).max() < 0.51 * count
    assert kept.sum() == pytest.approx(min(abs(rate), 1) * ROWS, abs=3)


def test_drum_speeds_count_only_without_angles() -> None:
    omega = np.linspace(0, 1, ROWS)
    _, alone = resampled(log(columns(omega_1=omega)), Experiment())
    np.testing.assert_array_equal(at(alone, "omega_1"), omega)
    _, beside = resampled(log(columns(omega_1=omega, theta_1=omega)), Experiment())
    assert np.isnan(at(beside, "omega_1")).all()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"t": 1 - np.arange(ROWS) * 1e-3}, r"t = 0.999 s in row 2 after 1 s: must ascend"),
        ({"tau_1": np.full(ROWS, np.nan)}, "tau_1: has no value in any row"),
        ({"x": np.full(3, 0.0)}, "x: must be a list of 400 numbers"),
        ({"t": np.full(ROWS, np.nan)}, "t: must be a finite number in every row"),
    ],
)
def test_what_is_no_log_is_refused(changed: dict[str, np.ndarray], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        log(columns(**changed), "run.csv")


def test_too_short_a_log_and_an_unknown_column_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="has 100 rows: must be 200 or more"):
        resampled(log({name: values[:100] for name, values in columns().items()}), Experiment())
    with pytest.raises(ConfigurationError, match="unknown column 'speed'"):
        log(columns(speed=np.zeros(ROWS)))


def test_torques_that_are_missing_for_long_are_refused() -> None:
    tau = columns()["tau_2"].copy()
    tau[50:250] = np.nan
    with pytest.raises(ConfigurationError, match=r"tau_2: none for 0.201 s after t = 0.049 s: must be <= 0.1 s"):
        resampled(log(columns(tau_2=tau)), Experiment())


def test_torques_that_chatter_between_rows_are_expected_at_their_mean() -> None:
    chatter = np.random.default_rng(3).normal(0, 4.0, ROWS)
    given = columns(tau_1=20 + chatter)
    rows = {name: values[::5] for name, values in given.items()}
    options = ResamplingOptions(between_rows=True, torque_rows=8, min_rows=50)
    inputs, _ = resampled(log(rows), Experiment(), options)
    np.testing.assert_array_equal(inputs[::5, 1:3], np.column_stack([rows["tau_1"], rows["tau_2"]]))
    last = slice(ROWS // 10, ROWS - 5)
    expected = np.convolve(rows["tau_1"], np.ones(8) / 8)[: len(rows["t"])]
    np.testing.assert_allclose(inputs[3::5, 1][8:], expected[8 : len(inputs[3::5])], atol=1e-9)
    assert inputs[last, 4] == pytest.approx(4.0, rel=0.5)
    assert (inputs[last, 5] < 0.5).all(), "this one does not chatter"
    later = rows["tau_1"].copy()
    later[40:] += 30
    others, _ = resampled(log(rows | {"tau_1": later}), Experiment(), options)
    np.testing.assert_array_equal(others[:200, 1], inputs[:200, 1])


def test_a_position_that_is_rounded_more_than_it_is_noisy_speaks_where_it_changes() -> None:
    """As an encoder does; between changes it repeats what is known."""
    steps = columns(x=np.repeat(np.arange(ROWS // 8) * 2e-3, 8))
    coarse = {"sensors.position_resolution": 2e-3}
    for noise, count in ((0.0, ROWS // 8 - 1), (1e-3, ROWS)):
        machine = override(Experiment(), coarse | {"sensors.position_noise": noise})
        _, readings = resampled(log(steps), machine)
        assert np.isfinite(at(readings, "x")).sum() == count
    assert counting(override(Experiment(), coarse).sensors) == ("theta_1", "theta_2", "x")
    assert counting(Experiment().sensors) == ("theta_1", "theta_2")
