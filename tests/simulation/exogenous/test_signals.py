"""Random signals of a scenario: their moments, their seeds, their independence."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from dualwinch.model.disturbance import Disturbance
from dualwinch.simulation.exogenous.signals import exogenous_pieces, exogenous_signals
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.loop.closed_loop import closed_loop
from dualwinch.simulation.loop.structure import structure_of
from dualwinch.simulation.sensors import Sensors

SEA = Disturbance(current_sigma=0.05, current_time=0.5, normal_force_sigma=0.1, normal_force_time=0.2)
NOISY = Sensors(position_noise=1e-3, speed_noise=1e-3, tension_noise=10.0)
EXPERIMENT = Experiment(disturbance=SEA, sensors=NOISY, simulation=Simulation(seed=5))
RANDOM = (
    *("current", "normal_force_variation"),
    *("noise.position", "noise.speed", "noise.tension_1", "noise.tension_2"),
)


def drawn(experiment: Experiment) -> dict[str, NDArray[np.float64]]:
    names = closed_loop(structure_of(experiment)).exogenous
    return dict(zip(names, exogenous_signals(experiment).T, strict=True))


def autocorrelation(signal: NDArray[np.float64], lag: int) -> float:
    return float(np.mean(signal[lag:] * signal[:-lag]) / np.mean(signal**2))


def test_current_is_limited() -> None:
    strong = replace(EXPERIMENT, disturbance=replace(SEA, current_sigma=0.2))
    current = drawn(strong)["current"]
    assert np.abs(current).max() == 0.154
    assert np.mean(np.abs(current) < 0.154) > 0.3


def test_rail_load_varies_in_newtons_around_zero() -> None:
    assert drawn(EXPERIMENT)["normal_force_variation"].std() == pytest.approx(490, rel=0.1)


def test_sensor_draws_are_standard_normal() -> None:
    signals = drawn(EXPERIMENT)
    for name in RANDOM[2:]:
        assert signals[name].std() == pytest.approx(1, rel=0.02)
        assert autocorrelation(signals[name], 1) == pytest.approx(0, abs=0.02)


def test_signals_are_independent_of_each_other() -> None:
    signals = drawn(replace(EXPERIMENT, disturbance=replace(SEA, current_time=0.01, normal_force_time=0.01)))
    correlations = np.corrcoef([signals[name] for name in RANDOM])
    assert np.abs(correlations - np.eye(len(RANDOM))).max() < 0.06


def test_the_same_seed_gives_the_same_bits_and_another_does_not() -> None:
    again = exogenous_signals(EXPERIMENT)
    assert np.array_equal(exogenous_signals(EXPERIMENT), again)
    other = drawn(replace(EXPERIMENT, simulation=Simulation(seed=6)))
    for name in RANDOM:
        assert not np.array_equal(other[name], drawn(EXPERIMENT)[name])


@pytest.mark.parametrize(
    ("quiet", "name"),
    [
        (replace(EXPERIMENT, disturbance=replace(SEA, current_sigma=0.0)), "current"),
        (replace(EXPERIMENT, disturbance=replace(SEA, normal_force_sigma=0.0)), "normal_force_variation"),
        (replace(EXPERIMENT, sensors=replace(NOISY, speed_noise=0.0)), "noise.speed"),
    ],
)
def test_switching_one_signal_off_leaves_the_others_as_they_are(quiet: Experiment, name: str) -> None:
    before, after = drawn(EXPERIMENT), drawn(quiet)
    assert (after[name] == 0).all()
    for other in set(RANDOM) - {name}:
        assert np.array_equal(before[other], after[other])


def test_a_longer_run_begins_with_the_shorter_one() -> None:
    short = exogenous_signals(replace(EXPERIMENT, simulation=Simulation(duration=20.0, seed=5)))
    assert np.array_equal(exogenous_signals(EXPERIMENT)[:20_000, :9], short[:, :9])


def test_everything_is_quiet_by_default() -> None:
    signals = drawn(Experiment())
    for name in RANDOM:
        assert (signals[name] == 0).all()


def test_the_steady_state_includes_both_its_ends() -> None:
    marked = drawn(Experiment())["steady"]
    assert np.flatnonzero(marked)[[0, -1]].tolist() == [18_000, 29_000]
    assert marked.sum() == 11_001


@pytest.mark.parametrize("length", [1, 7, 1000, 4999])
def test_pieces_are_the_whole_to_the_last_bit(length: int) -> None:
    short = replace(EXPERIMENT, simulation=Simulation(duration=5.0, seed=5))
    pieces = np.concatenate(list(exogenous_pieces(short, length)))
    assert np.array_equal(pieces, exogenous_signals(short))


def test_what_a_seed_gives_is_pinned() -> None:
    """It is part of what a stored result means."""
    signals = drawn(EXPERIMENT)
    assert {name: float(signals[name][20_000]) for name in RANDOM} == {
        "current": 0.0550163369849491,
        "normal_force_variation": 216.08983351470147,
        "noise.position": 1.2347227334976196,
        "noise.speed": 0.8129938244819641,
        "noise.tension_1": -0.6887212991714478,
        "noise.tension_2": 0.6306052803993225,
    }
