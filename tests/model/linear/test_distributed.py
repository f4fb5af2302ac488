"""Linear models of plants with distributed ropes and gearboxes that give, against textbooks and small simulations."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.model.linear.modes import modes, numbered, track_modes
from dualwinch.model.plant import plant
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.ropes import Rope
from dualwinch.model.winch import Winch
from tests.model.linear.test_modes import named
from tests.model.test_heavy_ropes import STIFFNESS, plant_of
from tests.plant_points import linearise, operating_point

SITE = load_ensemble("site").experiment.plant


@pytest.mark.parametrize("segments", [2, 3, 8])
def test_longitudinal_modes_are_those_of_a_lumped_bar(segments: int) -> None:
    """Fixed at the vehicle, free at a drum without inertia: c/4L, 3 c/4L with the factors of the discrete chain."""
    heavy = plant_of(
        Rope(mass_per_length=2.36, segments=segments, shortest_mass=0.0, damping=10.0), Winch(inertia=1e-6)
    )
    found = modes(linearise(0.0, plant=heavy), heavy)
    speed, length = math.sqrt(STIFFNESS / 2.36), 50.5
    for number in range(1, segments):
        omega = 2 * segments * speed / length * math.sin((2 * number - 1) * math.pi / (4 * segments))
        mode = named(found, f"rope 1, longitudinal mode {number}")
        assert mode.natural_frequency == pytest.approx(omega, rel=1e-6)
        # of a damper of c N s/m beside a spring of k N/m over the whole rope: c omega/2k
        assert mode.damping == pytest.approx(10.0 * omega / (2 * STIFFNESS / length), rel=1e-6)
    first = named(found, "rope 1, longitudinal mode 1").natural_frequency / (2 * math.pi)
    assert first == pytest.approx(speed / length / 4, rel=1.05 * (math.pi / (4 * segments)) ** 2 / 6)


def test_rotor_and_drum_swing_on_the_gearbox_as_two_inertias_do() -> None:
    """sqrt(K (1/J1 + 1/J2)), damped by d/2K times that; the ropes all but cut."""
    winch = Winch(inertia=120.0, rotor_inertia=0.02, gear_stiffness=1.4e6, gear_damping=500.0, backlash=9e-4)
    loose = plant_of(Rope(modulus=1e3, damping=0.0), winch)
    point = operating_point(25.0, plant=loose)
    omega = math.sqrt(1.4e6 * (1 / 120 + 1 / (36**2 * 0.02)))
    for mode in modes(linearise(25.0, plant=loose), loose):
        if "gear" in mode.label:
            assert mode.natural_frequency == pytest.approx(omega, rel=1e-6)
            assert mode.damping == pytest.approx(500 * omega / (2 * 1.4e6), rel=1e-6)
    assert point.motor_1.theta - point.theta_1 == pytest.approx(0.8 * 1000 / 1.4e6 + 4.5e-4)
    (remark,) = point.remarks
    assert remark.startswith("linear while the ropes stay taut and the teeth, which transmit 800 N m in gearbox 1")


@pytest.mark.parametrize(("tension", "span"), [(200.0, 1.0), (1000.0, 1.0), (1000.0, 0.5), (6000.0, 5.0)])
def test_a_slow_torque_sees_ernsts_modulus(tension: float, span: float) -> None:
    """The drum's turn by a lasting torque, with the vehicle held."""
    rope = Rope(submerged_weight=20.2, added_mass_per_length=2.96)
    sagging = plant_of(rope, Winch(), spacing=span)
    system = linearise(25.0, 0.0, 2 * tension, sagging, tension_min=50.0, tension_max=2e4)
    held = [k for k, name in enumerate(system.states) if name not in {"x", "v"}]
    turn = -np.linalg.solve(system.A[np.ix_(held, held)], system.B[held, 0])[held.index(system.states.index("theta_1"))]
    ernst = STIFFNESS / 25.5 / (1 + (20.2 * span) ** 2 * STIFFNESS / (12 * tension**3))
    assert 36 / (0.8**2 * turn) == pytest.approx(ernst, rel=1e-6)


def test_the_sag_of_a_rope_has_its_mode() -> None:
    """Of one span between a fixed drum and a fixed vehicle: string of one term, stiffened by the rope's stretch."""
    rope, span, tension = Rope(submerged_weight=20.2, added_mass_per_length=2.96, damping=0.0), 1.0, 3000.0
    held = plant_of(rope, Winch(inertia=1e12), spacing=span)
    found = modes(linearise(25.0, 0.0, 2 * tension, held, tension_max=2e4), held)
    depth = 20.2 * span**2 / (8 * tension)
    string = 16 / 3 * tension / span**2 + (16 / 3 * depth / span**2) ** 2 * STIFFNESS
    for word in ("together", "opposed"):
        mode = named(found, f"sag of both ropes {word}")
        assert mode.natural_frequency == pytest.approx(math.sqrt(string / (8 / 15 * 2.96)), rel=1e-4)


@pytest.mark.parametrize(("x", "v", "preload"), [(12.0, 0.0, 2000.0), (3.0, 1.5, 6000.0), (44.0, -1.0, 8000.0)])
def test_steady_motion_leaves_nothing_but_round_off(x: float, v: float, preload: float) -> None:
    ropes = {
        "rope_1": replace(SITE.rope_1, segments=5, spare_length=30.0),
        "rope_2": replace(SITE.rope_2, segments=3, damping=300.0),
        "winch_1": replace(SITE.winch_1, gear_loss=0.03),
        "winch_2": replace(SITE.winch_2, sheave_friction=0.04),
    }
    point = operating_point(x, v, preload, replace(SITE, **ropes))
    assert point.residual < 1e-5
    assert point.tension_rate < 0.05  # rollers and water hold back less of a rope that grows shorter
    assert math.isclose(point.F1 + point.F2, preload)


@pytest.mark.parametrize("v", [0.0, 1.0])
def test_a_small_kick_dies_away_as_the_linear_model_says(v: float) -> None:
    """The nonlinear plant of the site from a kicked operating point, solved by itself, against exp(A t)."""
    site, preload = replace(SITE, rope_slack=False), 6000.0
    point, system, function = operating_point(20.0, v, preload, site), linearise(20.0, v, preload, site), plant(site)
    start, u = np.array(list(leaves(point.state).values())), [point.tau_1, point.tau_2]
    kick = np.zeros(len(start))
    kick[[system.states.index(name) for name in ("omega_1", "rope_1.waves.speed", "motor_2.omega")]] = 1e-6

    def rate(_: float, state: np.ndarray) -> np.ndarray:
        return np.array(function(state, u, [0, 0, 0])[0]).ravel()

    def after(begun: np.ndarray) -> np.ndarray:
        return solve_ivp(rate, (0.0, 0.03), begun, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]

    kicked, free, predicted = after(start + kick), after(start), expm(system.A * 0.03) @ kick
    largest = np.maximum(np.abs(predicted), 1e-3 * np.abs(predicted).max())
    np.testing.assert_array_less(np.abs(kicked - free - predicted) / largest, 0.02)


@pytest.mark.parametrize("x", [3.0, 12.0, 25.0, 44.0])
def test_at_rest_rigid_drift_is_apart_from_what_friction_remembers(x: float) -> None:
    """Three zero eigenvalues: of drift, which leaves friction alone, and of the friction within each rope."""
    system = linearise(x, 0.0, 4000.0, SITE)
    found = [mode for mode in modes(system, SITE) if mode.natural_frequency == 0]
    assert [mode.label for mode in found] == [
        "rigid drift: position",
        "friction within rope 1",
        "friction within rope 2",
    ]
    for mode in found:
        shape = np.array([mode.shape[name] for name in system.states])
        assert np.abs(system.A @ shape).max() < 1e-6 * np.abs(system.A).max() * np.abs(shape).max()
    for k, mode in enumerate(found):
        settled = [mode.shape["x"], mode.shape["rope_1.hysteresis.share"], mode.shape["rope_2.hysteresis.share"]]
        assert np.flatnonzero(np.abs(settled) > 1e-9).tolist() == [k]
        assert sum(mode.participation.values()) == pytest.approx(1)


def test_modes_of_one_name_are_numbered() -> None:
    assert numbered(["a", "b", "a"]) == ["a (1)", "b", "a (2)"]


def test_modes_of_the_site_are_followed_along_the_track() -> None:
    systems = [linearise(x, 1.0, 6000.0, SITE) for x in np.arange(5.0, 21.0, 4.0)]
    labels = {track.label for track in track_modes(systems, SITE)}
    assert {"rope 1 – drum 1", "gearbox 1", "sag of rope 1", "rigid drift: speed"} <= labels
    assert {"rope 1, longitudinal mode 2", "gearbox 2", "sag of rope 2"} <= labels


def test_a_rotor_that_swings_on_its_gearbox_is_the_gears_mode_also_where_the_drum_goes_along() -> None:
    """Of a soft gearbox on a short, stiff rope: the rotor's mode is the slower one, and drum and rotor move one way."""
    soft = replace(SITE, winch_2=replace(SITE.winch_2, gear_stiffness=0.5e6))
    found = modes(linearise(2.0, 0.0, 2000.0, soft), soft)
    gear, drum = (named(found, label) for label in ("gearbox 2", "rope 2 – drum 2"))
    assert set(gear.main_states) == {"motor_2.theta", "motor_2.omega"}
    assert {"theta_2", "omega_2"} == set(drum.main_states[:2])
    assert (gear.shape["motor_2.theta"] * gear.shape["theta_2"].conjugate()).real > 0
    rotor = SITE.winch_2.gear_ratio**2 * SITE.winch_2.rotor_inertia
    assert gear.natural_frequency == pytest.approx(math.sqrt(0.5e6 / rotor), rel=0.1)
