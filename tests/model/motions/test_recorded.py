"""Recorded motions: the curve through the rows, its derivatives, its ends, its steady state."""

from pathlib import Path

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.motions import RecordedMotion
from dualwinch.model.reference import Reference, own_duration, setpoint, steady_window

T = np.linspace(0, 10, 101)
X = 20 * np.sin(T / 10)


def test_positions_alone_give_continuous_speed_and_acceleration() -> None:
    motion, t = RecordedMotion(T, X), np.linspace(0.5, 9.5, 5000)
    found = motion.at(t)
    assert np.asarray(found.x) == pytest.approx(20 * np.sin(t / 10), abs=1e-7)
    assert np.asarray(found.v) == pytest.approx(2 * np.cos(t / 10), abs=1e-6)
    assert np.asarray(found.a) == pytest.approx(-0.2 * np.sin(t / 10), abs=1e-4)
    assert np.abs(np.diff(found.a)).max() < 1e-4


def test_recorded_speeds_and_accelerations_are_kept_at_the_rows() -> None:
    v, a = np.cos(T), np.where(T < 5, 1.0, -1.0)
    found = RecordedMotion(T, X, v, a).at(T)
    assert np.asarray(found.x) == pytest.approx(X)
    assert np.asarray(found.v) == pytest.approx(v)
    assert np.asarray(found.a) == pytest.approx(a)


def test_beyond_its_ends_the_vehicle_rests() -> None:
    motion = RecordedMotion(T + 1, X + 1)
    for t, x in ((0.0, 1.0), (20.0, X[-1] + 1)):
        now = motion.at(t)
        assert [float(value) for value in (now.x, now.v, now.a)] == [x, 0, 0]


def test_the_longest_stretch_of_constant_speed_is_found() -> None:
    joints, speeds = np.array([0, 2, 5, 11, 20, 24]), (0.0, 1.0, 0.5, 0.0, -1.0)
    t = np.arange(0, 24.05, 0.1)
    x = 10 + np.interp(t, joints, np.concatenate(([0], np.cumsum(np.diff(joints) * speeds))))
    assert RecordedMotion(t, x).longest_cruise == pytest.approx((5, 11))
    assert RecordedMotion(T, X).longest_cruise is None
    assert RecordedMotion(T, 0 * X).longest_cruise is None


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "motion.csv"
    rows = [f"{1000 * t},{1000 * x},{100 * np.cos(t / 10) * 20}" for t, x in zip(T, X, strict=True)]
    path.write_text("ms,mm,v\n" + "\n".join(rows) + "\n")
    return path


def test_a_reference_reads_its_file_in_its_units(file: Path) -> None:
    asked = Reference("file", file=str(file), column="mm", unit="mm", time_column="ms", time_unit="ms")
    assert own_duration(asked) == pytest.approx(10)
    assert setpoint(np.array([3.33]), asked).x == pytest.approx(20 * np.sin(0.333), abs=1e-6)
    assert steady_window(asked, 8.0) == (0, 8)
    wrong = Reference("file", file=str(file), column="mm", unit="kN", time_column="ms", time_unit="ms")
    with pytest.raises(ConfigurationError, match=r'column .mm.: unit "kN": must be one of m, mm'):
        setpoint(0.0, wrong)


def test_another_kind_of_reference_does_not_read_the_file() -> None:
    assert Reference("profile", file="/no/such.csv").recording is None
