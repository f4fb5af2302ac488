from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from dualwinch.config.settings import override
from dualwinch.simulation.batch.cores import cores
from dualwinch.simulation.exogenous.kept_signals import ROOM, keeping, size
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case


def scenario(seed: int) -> Experiment:
    return override(case(4), {"sensors.speed_noise": 1e-3, "simulation.seed": seed, "simulation.duration": 0.1})


SIZE = size(exogenous_signals(scenario(0)))


def test_there_is_room_for_a_portion_a_thread() -> None:
    assert 32 * cores() * size(exogenous_signals(case(4))) <= ROOM


def test_a_short_scenario_counts_for_a_long_one() -> None:
    """Else short ones without number would be kept, and memory grow with them."""
    assert size(exogenous_signals(scenario(0))) == size(exogenous_signals(case(4)))
    assert size(exogenous_signals(override(case(4), {"simulation.sample_time": 5e-4}))) == 8.8e6


def test_signals_are_kept_for_all_controllers_of_a_scenario() -> None:
    signals = keeping(10 * SIZE)
    first = signals(scenario(1))
    assert np.array_equal(first, exogenous_signals(scenario(1)))
    assert signals(replace(scenario(1), controller=case(4, "nftsm").controller)) is first
    assert signals(scenario(2)) is not first


def test_what_is_kept_is_bounded_and_the_latest_stays() -> None:
    signals = keeping(3 * SIZE + 1)
    kept, early = signals(scenario(0)), signals(scenario(1))
    for seed in range(2, 20):
        latest = signals(scenario(seed))
        assert signals(scenario(0)) is kept
        assert signals(scenario(seed)) is latest
    assert signals(scenario(1)) is not early


def test_signals_larger_than_the_room_are_given_and_not_kept() -> None:
    signals = keeping(SIZE - 1)
    first = signals(scenario(0))
    assert np.array_equal(first, exogenous_signals(scenario(0)))
    assert signals(scenario(0)) is not first


def test_many_threads_get_the_signals_of_their_scenario() -> None:
    signals = keeping(3 * SIZE)
    asked = [scenario(number % 5) for number in range(200)]
    with ThreadPoolExecutor(8) as pool:
        given = list(pool.map(signals, asked))
    for experiment, table in zip(asked, given, strict=True):
        assert np.array_equal(table, exogenous_signals(experiment))
