"""Random signals of a scenario: their moments, their seeds, their independence."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from dualwinch.model.disturbance import Disturbance
from dualwinch.simulation.exogenous.sensors import Sensors
from dualwinch.simulation.exogenous.signals import GaussMarkov, exogenous_pieces, exogenous_signals
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.loop.closed_loop import closed_loop
from dualwinch.simulation.loop.structure import structure_of

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


def test_gauss_markov_has_the_standard_deviation_and_the_correlation_time() -> None:
    signal = GaussMarkov(2.0, 0.1, 1e-3, np.random.default_rng(1)).draw(400_000)
    assert signal.std() == pytest.approx(2, rel=0.05)
    assert signal.mean() == pytest.approx(0, abs=0.15)
    assert autocorrelation(signal, 100) == pytest.approx(np.exp(-1), abs=0.04)
    assert autocorrelation(signal, 200) == pytest.approx(np.exp(-2), abs=0.04)


def test_gauss_markov_is_stationary_from_its_first_sample() -> None:
    generators = [np.random.default_rng(seed) for seed in range(4000)]
    signals = np.array([GaussMarkov(3.0, 0.05, 1e-3, generator).draw(50) for generator in generators])
    assert signals.std(axis=0) == pytest.approx(np.full(50, 3.0), rel=0.08)


def test_the_sample_time_does_not_change_the_signals_statistics() -> None:
    coarse = GaussMarkov(1.0, 0.5, 1e-2, np.random.default_rng(2)).draw(200_000)
    assert coarse.std() == pytest.approx(1, rel=0.05)
    assert autocorrelation(coarse, 50) == pytest.approx(np.exp(-1), abs=0.04)


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
