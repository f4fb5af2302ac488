from dataclasses import replace

import numpy as np

from dualwinch.config.settings import override
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.laws.nftsm import Nftsm
from dualwinch.simulation.exogenous.kept_signals import KeptSignals
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case


def scenario(seed: int) -> Experiment:
    return override(case(4), {"sensors.speed_noise": 1e-3, "disturbance.seed": seed, "simulation.duration": 0.1})


def test_signals_are_kept_for_all_controllers_of_a_scenario() -> None:
    signals = KeptSignals(10, 10**9)
    first = signals(scenario(1))
    assert np.array_equal(first, exogenous_signals(scenario(1)))
    assert signals(replace(scenario(1), controller=Controller(law=Nftsm()))) is first
    assert signals(scenario(2)) is not first


def test_what_is_kept_is_bounded_and_the_latest_stays() -> None:
    table = exogenous_signals(scenario(0)).nbytes
    for most, room in ((3, 10**9), (100, 3 * table + 1)):
        signals = KeptSignals(most, room)
        kept = signals(scenario(0))
        for seed in range(20):
            signals(scenario(seed))
            assert signals(scenario(0)) is kept
        assert len(signals) == 3
    nothing = KeptSignals(3, table - 1)
    nothing(scenario(0))
    assert len(nothing) == 0
