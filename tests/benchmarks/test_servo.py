"""The servo's table, of a drive whose mass, friction and lag are known."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from benchmarks import servo
from benchmarks.servo import drive, fitted

MASS, COULOMB, VISCOUS, LAG = 60.0, 12.0, 150.0, 0.5e-3

GAIN, STEP, PARTS = 35.0, 1e-3, 20


def recorded(file: Path, *, pulses: bool) -> Path:
    """Six seconds to and fro under a proportional-derivative controller, integrated in short steps."""
    number = round(6 / STEP)
    t = STEP * np.arange(number)
    wanted = 0.1 - 0.1 * np.cos(2 * np.pi * t / 3)
    q = v = force = 0.0
    positions, voltages = np.zeros(number), np.zeros(number)
    last = wanted[0]
    for k in range(number):
        positions[k] = 5e-8 * round(q / 5e-8)
        voltages[k] = 160 * 240 * (wanted[k] - positions[k]) / GAIN - 240 * (positions[k] - last) / STEP / GAIN
        voltages[k] += (3.0 if k // 150 % 2 else -3.0) if pulses else 0.0
        last = positions[k]
        for _ in range(PARTS):
            before, faster = force, v
            force += (GAIN * voltages[k] - force) * -np.expm1(-STEP / PARTS / LAG)
            faster += ((force + before) / 2 - COULOMB * np.tanh(v / 1e-4) - VISCOUS * v) / MASS * STEP / PARTS
            q += (v + faster) / 2 * STEP / PARTS
            v = faster
    savemat(file, {"t": t[:, None], "qm": positions[:, None], "vir": voltages[:, None], "gtau": GAIN})
    return file


@pytest.mark.slow
@pytest.mark.nightly
def test_a_known_drive_is_found(tmp_path: Path) -> None:
    run = drive(recorded(tmp_path / "a.mat", pulses=True))
    found = fitted(run, lag=True)
    inertia, coulomb, viscous, lag = found.values.tolist()
    assert abs(1e4 * inertia - MASS) < max(4e4 * found.deviations[0], 0.005 * MASS)
    assert lag == pytest.approx(LAG, rel=0.02)
    assert 100 * coulomb + 1e4 * viscous * 0.1 == pytest.approx(COULOMB + VISCOUS * 0.1, rel=0.05)
    assert found.converged


@pytest.mark.slow
@pytest.mark.nightly
def test_in_units_in_which_torques_are_a_hundred_times_as_large_it_is_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the model lacks is then, in N m, far more than filters take for granted at first."""
    monkeypatch.setattr(servo, "PINION", 1.0)
    monkeypatch.setattr(servo, "SHAFT", 0.01)
    monkeypatch.setattr(servo, "BEGIN", dict(zip((*servo.KEYS, servo.LAG), (80.0, 10.0, 100.0, 2e-3), strict=True)))
    inertia, *_, lag = fitted(drive(recorded(tmp_path / "a.mat", pulses=True)), lag=True).values.tolist()
    assert inertia == pytest.approx(MASS, rel=0.01)
    assert lag == pytest.approx(LAG, rel=0.05)


def test_the_authors_method_finds_a_drive_without_a_lag_worth_speaking_of(tmp_path: Path) -> None:
    mass, viscous, coulomb, offset = drive(recorded(tmp_path / "a.mat", pulses=False)).inverse()
    assert mass == pytest.approx(MASS, rel=0.02)
    assert coulomb + viscous * 0.1 == pytest.approx(COULOMB + VISCOUS * 0.1, rel=0.03)
    assert abs(offset) < 1
