"""The flight log's table, of a tether whose stiffness is known."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.kite import GRAVITY, STIFFNESS, facts


def cycle(file: Path, noise: float) -> Path:
    """A straight tether as stiff as Dyneema: reeled out at 1 m/s, its force swinging; the distance with noise."""
    t = 1e9 + 0.1 * np.arange(2000)
    force = 2000 + 1000 * np.sin(2 * np.pi * (t - t[0]) / 3.1)
    length = 200 + (t - t[0])
    distance = length * (1 + force / STIFFNESS) + noise * np.random.default_rng(0).normal(size=len(t))
    rows = np.column_stack([t, np.ones_like(t), force / GRAVITY, distance, np.full_like(t, 2)])
    header = "time,ground_tether_reelout_speed,ground_tether_force,kite_distance,phase"
    np.savetxt(file, rows, delimiter=",", header=header, comments="", fmt="%.9f")
    return file


def test_stiffness_is_found_where_it_can_be_seen_and_not_where_it_cannot(tmp_path: Path) -> None:
    plain, noisy = facts(cycle(tmp_path / "a.csv", 0.0)), facts(cycle(tmp_path / "b.csv", 0.3))
    assert float(plain[4]) == pytest.approx(1, abs=0.03)
    assert plain[5] == "100%"
    assert int(noisy[5].rstrip("%")) < 5
    assert plain[2] == f"{2000 * 300 / STIFFNESS:.2f}"
