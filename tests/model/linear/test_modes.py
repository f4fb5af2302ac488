from dataclasses import replace
from math import inf, sqrt

import numpy as np
import pytest

from dualwinch.model.linear.modes import Mode, modes, track_modes
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant
from dualwinch.model.ropes import Rope
from dualwinch.model.vehicle import Vehicle
from dualwinch.model.winch import Winch
from tests.plant_points import linearise, linearise_sweep

FREE = Vehicle(friction_coefficient=0.0)


def named(found: tuple[Mode, ...], label: str) -> Mode:
    (mode,) = [mode for mode in found if mode.label == label]
    return mode


@pytest.mark.parametrize("mass", [10.0, 1e4, 1e9])
def test_drum_and_vehicle_on_one_rope_swing_as_two_masses_do(mass: float) -> None:
    """With the other rope almost cut: sqrt(k/m) and c/(2 sqrt(k m)) with the reduced mass m of drum and vehicle."""
    vehicle = replace(FREE, mass=mass)
    plant = Plant(vehicle=vehicle, rope_2=Rope(modulus=1e-3, damping=0.0))
    system = linearise(20.0, 0.0, 1e-3, plant, tension_min=0.0)
    k, drum = 80e9 * 4.52e-4 / 30.5, 1.8 / 0.8**2
    reduced = drum * mass / (drum + mass)
    mode = max(modes(system, plant), key=lambda entry: entry.natural_frequency)
    assert mode.natural_frequency == pytest.approx(sqrt(k / reduced), rel=1e-8)
    assert mode.damping == pytest.approx(1000 / (2 * sqrt(k * reduced)), rel=1e-8)
    assert mode.time_constant == pytest.approx(2 * reduced / 1000, rel=1e-8)
    assert mode.sample_rate == pytest.approx(10 * sqrt(k / reduced) / (2 * np.pi), rel=1e-8)


def test_the_papers_modes_have_plain_names() -> None:
    found = modes(linearise(x=5.0, v=1.8))
    labels = ["rigid drift: position", "rigid drift: speed", "rope 1 – drum 1", "rope 2 – drum 2"]
    assert [mode.label for mode in found] == labels
    drift, speed, rope_1, _ = found
    assert (drift.rate, drift.damping, drift.time_constant) == (0, 0.0, inf)
    assert drift.main_states == ("x",)
    drag = 0.3 * 1000 * 6 * 1.8  # slope of the drag; the drums are carried along
    assert speed.rate.real == pytest.approx(-drag / (1e4 + 2 * 1.8 / 0.8**2), rel=1e-3)
    assert speed.damping == 1.0
    assert set(rope_1.main_states) == {"theta_1", "omega_1"}
    for mode in found:
        assert sum(mode.participation.values()) == pytest.approx(1.0)


def test_in_the_middle_of_the_track_both_ropes_swing_in_one_mode() -> None:
    together, opposed = (named(modes(linearise(x=25.0)), f"both drums {word}") for word in ("together", "opposed"))
    assert opposed.natural_frequency == pytest.approx(0.8 * sqrt(80e9 * 4.52e-4 / 25.5 / 1.8), rel=1e-5)
    assert together.natural_frequency > opposed.natural_frequency


def test_heavy_drums_leave_the_vehicle_on_both_ropes() -> None:
    heavy = Winch(inertia=1e9)
    plant = Plant(vehicle=FREE, winch_1=heavy, winch_2=heavy)
    mode = named(modes(linearise(20.0, plant=plant), plant), "vehicle on both ropes")
    stiffness = 80e9 * 4.52e-4 * (1 / 30.5 + 1 / 20.5)
    assert mode.natural_frequency == pytest.approx(sqrt(stiffness / 1e4), rel=1e-4)


def test_a_sampled_plant_has_the_same_modes() -> None:
    system = linearise(x=12.0, v=1.0)
    for mine, theirs in zip(modes(system.discretised(2e-4)), modes(system), strict=True):
        assert mine.rate == pytest.approx(theirs.rate, rel=1e-7, abs=1e-7)
        assert mine.label == theirs.label
        assert mine.participation == pytest.approx(theirs.participation, abs=1e-6)


def test_other_systems_are_labelled_by_their_states() -> None:
    A = np.array([[0.5, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    units: dict[str, str] = dict.fromkeys(("filter", "late", "runaway"), "1")
    system = LinearSystem(
        A,
        np.zeros((3, 0)),
        np.zeros((0, 3)),
        np.zeros((0, 0)),
        dt=0.1,
        states=tuple(units),
        inputs=(),
        outputs=(),
        units=units,
    )
    by_label = {mode.label: mode for mode in modes(system)}
    assert by_label["filter"].rate == pytest.approx(np.log(0.5) / 0.1)
    assert (by_label["late"].natural_frequency, by_label["late"].damping, by_label["late"].time_constant) == (inf, 1, 0)
    assert by_label["runaway"].damping == -1.0
    assert by_label["runaway"].time_constant < 0


@pytest.mark.parametrize("dt", [None, 1e-3])
@pytest.mark.parametrize("x", [0.0, 10.0, 25.0])
def test_without_friction_position_and_speed_drift_as_a_chain_of_two_integrators(x: float, dt: float | None) -> None:
    plant = Plant(vehicle=FREE)
    position, speed = modes(linearise(x, plant=plant, dt=dt), plant)[:2]
    assert {position.label, speed.label} == {"rigid drift: position", "rigid drift: speed"}
    assert position.natural_frequency == speed.natural_frequency == 0.0
    assert {position.main_states, speed.main_states} == {("x",), ("v",)}


def test_participation_does_not_depend_on_units() -> None:
    system = linearise(x=25.0, v=0.5)
    scale = np.array([1e3, 1e3, 57.3, 9.55, 57.3, 9.55])
    other = replace(system, A=scale[:, None] * system.A / scale)
    for mine, theirs in zip(modes(other), modes(system), strict=True):
        assert mine.participation == pytest.approx(theirs.participation, abs=1e-6)


def test_modes_are_followed_across_the_middle_of_the_track() -> None:
    """Every 2 m, the middle among them, where the two ropes' modes meet and mix."""
    x = np.arange(1.0, 50.0, 2.0)
    tracks = {track.label: track for track in track_modes(linearise_sweep(x, 1.8))}
    for rope, length in ((1, 50.5 - x), (2, x + 0.5)):
        expected = 0.8 * np.sqrt(80e9 * 4.52e-4 / length / 1.8)
        np.testing.assert_allclose(tracks[f"rope {rope} – drum {rope}"].natural_frequencies, expected, rtol=5e-4)
    assert len(tracks) == 4


def test_no_mode_is_lost_where_an_oscillation_becomes_two_decays() -> None:
    rope = Rope(damping=3000.0)
    plant = Plant(rope_1=rope, rope_2=rope)
    systems = linearise_sweep(np.linspace(0, 50, 101), 1.0, plant=plant)
    tracks = track_modes(systems, plant)
    assert len(tracks) == 6
    for k, system in enumerate(systems):
        rates = np.array([track.modes[k].eigenvalue for track in tracks])
        for pole in system.poles():
            assert min(np.abs(np.concatenate([rates, rates.conj()]) - pole)) < 1e-3
