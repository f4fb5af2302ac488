"""What plants leave out, against textbook formulas; the loop's gain at a rope's mode against the exact linear loop."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.analysis.idealisations import idealisations, position_loop_gain, summary
from dualwinch.simulation.experiment import Experiment
from tests.own_ropes import Stiffening

TUNED = Path(__file__).parents[1] / "toolboxes" / "stress" / "tuned_in_the_sea.toml"


def with_ropes(experiment: Experiment, **values: float) -> Experiment:
    plant = experiment.plant
    ropes = {name: replace(getattr(plant, name), **values) for name in ("rope_1", "rope_2")}
    return replace(experiment, plant=replace(plant, **ropes))


def test_the_papers_plant_has_light_winches_and_ropes_without_mass_and_weight() -> None:
    found = {one.name: one for one in idealisations(dw.case(4))}
    assert list(found) == ["winch inertia", "sag", "stiffness under sag"]
    assert (found["winch inertia"].value, found["winch inertia"].limit) == (1.8, pytest.approx(20 * 0.8**2))
    weight = 0.409 * 24**2 / 100 * 9.81 * (1 - 1000 / 7850)  # EN 12385-4, less the buoyancy of its steel
    slope = weight * 50.5 / 200
    assert found["sag"].value == pytest.approx(slope, rel=1e-3)
    assert found["stiffness under sag"].value == pytest.approx(12 / (slope**2 * 4.52e-4 * 80e9 / 200), rel=1e-3)
    assert found["sag"].parts == ("rope_1", "rope_2")
    assert set(found["winch inertia"].keys) >= {"plant.winch_1.inertia", "plant.winch_2.rotor_inertia"}
    assert summary(list(found.values())) == (
        "idealised: winches of 1.8 kg m² (20 R² = 12.8), ropes without mass and weight (w s/T = 5.09 at 200 N); "
        "see docs/site.md"
    )


def mode_error_of_cable(ernst: float) -> float:
    """Galerkin's method for Irvine's cable with one parabola, against 400 sine waves; the difference as a share."""
    number = np.arange(1, 800, 2)
    means = np.sqrt(2) * 2 / (number * np.pi)
    stiffness = np.diag((number * np.pi) ** 2) + 12 * (1 / ernst - 1) * np.outer(means, means)
    exact = np.sqrt(np.linalg.eigvalsh(stiffness)[0])
    return np.sqrt(10 / ernst) / exact - 1


def test_a_machine_as_it_is_built_leaves_out_transverse_modes_alone() -> None:
    (only,) = idealisations(dw.load_ensemble("site").experiment)
    stiffness = 4.52e-4 * 80e9
    assert only.value == pytest.approx(1 / (1 + 20.2**2 * stiffness / (12 * 200**3)))
    assert "one transverse mode a span" in only.statement
    assert "with one transverse mode a span (Ernst's factor 0.0065 at 200 N)" in only.brief
    assert only.brief.endswith(f"its first frequency up to {100 * mode_error_of_cable(only.value):.2g} % too high")
    close = dw.load_ensemble("site").experiment
    close = replace(close, plant=replace(close.plant, track=replace(close.plant.track, roller_spacing=0.05)))
    assert idealisations(close) == []
    assert summary([]) == ""


def test_sides_that_differ_are_named() -> None:
    experiment = dw.case(4)
    plant = experiment.plant
    heavy = replace(plant.winch_1, rotor_inertia=0.02)
    sagging = replace(plant.rope_2, submerged_weight=20.2, mass_per_length=2.36)
    track = replace(plant.track, roller_spacing=0.05)
    one = replace(experiment, plant=replace(plant, winch_1=heavy, rope_2=sagging, track=track))
    assert summary(idealisations(one)) == "idealised: winch 2 of 1.8 kg m² (20 R² = 12.8); see docs/site.md"


def test_ropes_that_differ_lack_the_same_once() -> None:
    experiment = dw.override(dw.case(4), {"plant.rope_1.modulus": 40e9})
    assert len(idealisations(experiment)) == 4, "a stiffness under sag for either rope"
    assert summary(idealisations(experiment)) == summary(idealisations(dw.case(4)))


def test_what_a_rope_of_another_law_weighs_is_not_guessed() -> None:
    experiment = dw.case(4)
    ropes = {"rope_1": Stiffening(), "rope_2": Stiffening(mass_per_length=2.0, submerged_weight=15.0)}
    rope_1, rope_2 = (
        one
        for number in (1, 2)
        for one in idealisations(replace(experiment, plant=replace(experiment.plant, **ropes)))
        if f"rope_{number}" in one.parts
    )
    assert (rope_1.name, rope_1.statement) == ("rope mass", "rope 1 without mass and weight")
    assert math.isnan(rope_1.value)
    assert rope_2.name == "stiffness under sag"


def test_gain_of_a_linear_law_is_that_of_the_exact_linear_loop() -> None:
    """Up to what ropes and drums make of the command, whose resonance is four times as fast."""
    experiment, omega = dw.case(2, "pid-cascade"), 100.0
    loop = dw.linear_open_loop(experiment, 25.0, 0.0, "u")
    z = np.exp(1j * omega * 1e-3)
    (exact,) = abs(loop.C @ np.linalg.solve(z * np.eye(len(loop.A)) - loop.A, loop.B) + loop.D).ravel()
    found = [position_loop_gain(experiment, omega, amplitude) for amplitude in (1e-3, 1e-4)]
    assert found == pytest.approx([exact, exact], rel=0.1)
    assert position_loop_gain(experiment, 4000.0) == 0.0, "beyond the Nyquist frequency"


@pytest.mark.parametrize(("l0", "kind"), [(5.0, "fando-nftsm"), (50.0, "fando-nftsm"), (5.0, "nftsm")])
def test_gain_of_a_sliding_mode_law_is_the_rules_feedback_over_the_frequency(l0: float, kind: str) -> None:
    """Observer gain and describing function in closed form (`analysis.resonance`), winches without PID."""
    law = {"controller.observer.l0": l0} if kind == "fando-nftsm" else {}
    pid = {f"controller.winch_{number}.{gain}": 0.0 for number in (1, 2) for gain in ("kp", "ki")}
    experiment, omega = dw.override(dw.case(4, kind), law | pid), 122.0
    rule, _ = dw.resonance_gains(experiment, amplitudes=(2e-4,))
    assert position_loop_gain(experiment, omega, 2e-4) * omega == pytest.approx(rule.feedback, rel=0.15)


def test_tuned_gains_have_the_ropes_mode_in_their_bandwidth_and_the_papers_have_not() -> None:
    """Of ropes with their mass the one loses the vehicle, the other hardly notices (the next test)."""
    (mode,) = (one for one in idealisations(dw.load(TUNED)) if one.name == "rope mass")
    assert 2 < mode.value < 10
    assert "19.4 Hz" in mode.statement
    assert not [one for one in idealisations(dw.case(4)) if one.name == "rope mass"]
    assert not [
        one for one in idealisations(with_ropes(dw.load(TUNED), mass_per_length=2.36)) if one.name == "rope mass"
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("experiment", "outcome"), [(dw.case(4), "completed"), (dw.load(TUNED), "left_track")])
def test_ropes_with_mass_lose_what_is_said_to_be_lost(experiment: Experiment, outcome: str) -> None:
    assert dw.simulate(with_ropes(experiment, mass_per_length=2.36), stride=0).outcome == outcome
