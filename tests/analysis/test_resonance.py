"""The rule for the drums' resonance on their ropes, against eigenvalues of the linearised loop."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.quoted.heavy import MACHINES, PLACES, SMALL, both, law_of, machine, swings_up, with_gain
from dualwinch.analysis.margin_survey import MarginSurvey
from dualwinch.analysis.resonance import AMPLITUDES, RESONANCE, UNDECIDED, resonance_gains
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from tests.tiers import mostly_slow

QUICK = {"both, damping 164", "both, damping 164, ki 0.2, kp 0.005", "`site`, damping 164"}


@pytest.mark.parametrize("name", mostly_slow(((name,) for name in MACHINES), lambda row: row[0] in QUICK))
def test_where_it_decides_it_is_right(name: str) -> None:
    """Amid the track below and above its band; elsewhere, where one drum swings, it is on the safe side."""
    experiment, (low, high) = MACHINES[name], UNDECIDED
    held, lost = with_gain(experiment, low), with_gain(experiment, high)
    assert [swings_up(held, x) for x in PLACES] == [False] * len(PLACES)
    assert swings_up(lost, PLACES[0])
    (verdict, *_) = {each.verdict for each in resonance_gains(with_gain(experiment, 1.1 * high), amplitudes=[SMALL])}
    assert verdict == "fails"


def test_without_the_drums_damping_it_would_be_wrong_by_an_order() -> None:
    """The form of a controller without damping, (observer gain + slope) m/c, at gains that hold."""
    experiment = with_gain(MACHINES["both, damping 164"], UNDECIDED[0])
    found = resonance_gains(experiment, amplitudes=[SMALL])[0]
    law = law_of(experiment)
    terminal = 0.6 * law.nftsm.beta * 0.05 ** (-2 / 3)
    surface = (law.nftsm.eta + law.nftsm.k / law.nftsm.phi) / law.nftsm.beta * 0.05 ** (2 / 3)
    mass = 150 / 0.8**2 + 2.36 * 25 + 4 / math.pi**2 * 2.36 * 25.5
    assert found.mass == pytest.approx(mass)
    assert found.feedback == pytest.approx(law.observer.l0 + terminal + surface + 0.02 * 36 / 0.8, rel=1e-6)
    assert found.damping == pytest.approx(300 * (1 + 5e-4 * 36 / 0.8) + 164 * 36 / 0.8**2)
    assert (law.observer.l0 + terminal + surface) * mass / 300 > 20
    assert not swings_up(experiment, PLACES[0])


def test_frequency_is_that_of_the_drum_on_its_rope() -> None:
    found = resonance_gains(machine(winch__inertia=150.0), 20.0)
    omega = math.sqrt(80e9 * 4.52e-4 / 30.5 / (150 / 0.8**2))
    assert found[0].frequency == pytest.approx(omega / (2 * math.pi))
    assert {each.amplitude for each in found} == set(AMPLITUDES)
    assert [each.winch for each in found] == [1, 2] * len(AMPLITUDES)


def test_small_errors_see_a_steeper_law_and_large_ones_the_whole_observer() -> None:
    paper = override(case(4), both(winch__inertia=150.0))
    small, medium, large = (each for each in resonance_gains(paper, amplitudes=AMPLITUDES[:3]) if each.winch == 1)
    assert small.gain > medium.gain
    assert large.feedback - 0.9 > law_of(paper).observer.l0 + 0.5 * law_of(paper).observer.kf


def test_a_shaped_command_keeps_a_drum_still_that_would_swing_up() -> None:
    """By eigenvalues; the rule attenuates the law's part of the feedback by z/shaping, and nothing else."""
    plain = with_gain(MACHINES["`site`, damping 164"], UNDECIDED[1])
    shaped = override(plain, both(gain__shaping=0.5))
    assert [swings_up(each, PLACES[0]) for each in (plain, shaped)] == [True, False]
    case_4 = override(case(4), both(winch__inertia=150.0, gain__damping=164.0, gain__ki=0.0, gain__kp=0.0))
    drum, attenuated = (resonance_gains(each)[0] for each in (case_4, override(case_4, both(gain__shaping=1.5))))
    ratio = drum.damping / (2 * drum.mass * 2 * math.pi * drum.frequency)
    assert attenuated.feedback == pytest.approx(drum.feedback * ratio / 1.5)
    assert (attenuated.damping, attenuated.mass) == (drum.damping, drum.mass)


def test_a_survey_has_the_least_of_many_machines() -> None:
    site = load_ensemble("site")
    damped = replace(site, experiment=override(site.experiment, both(gain__damping=100.0)))
    scenarios = [damped.scenario(index, 1) for index in range(3)]
    rows = np.array([[5.0, 164.0, 164.0], [30.0, 100.0, 164.0]])
    names = ["controller.observer.l0", "controller.winch_1.damping", "controller.winch_2.damping"]
    found = MarginSurvey(scenarios, names).worst(rows, [RESONANCE])
    for row, worst in zip(rows, found, strict=True):
        gains = [
            (each.gain, index, each.winch)
            for index, scenario in enumerate(scenarios)
            for each in resonance_gains(
                override(scenario.experiment, dict(zip(names, row, strict=True))), nominal=scenario.nominal
            )
        ]
        gain, machine, winch = max(gains)
        margin = worst[RESONANCE]
        assert margin.value == pytest.approx(1 / gain)
        assert (margin.machine, margin.opening) == (machine, f"tau_{winch}")
