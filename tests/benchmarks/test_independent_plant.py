"""The independent plant's effects, one by one, against textbooks, closed forms, its own step halved, and MoorDyn."""

import ctypes
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from benchmarks.independent.plant import DRUM, RATIO, STIFFNESS, Plant, library

FIXED = {"mass": 1e12, "drag": 0.0, "friction": 0.0}
"""A vehicle that stays where it is."""

SAGGING = {"submerged_weight": 20.2, "transverse_mass": 2.96, "transverse_drag": 0.0}


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return library(tmp_path_factory.mktemp("plant"))


def test_an_effect_that_is_not_there_is_refused(loaded: ctypes.CDLL) -> None:
    with pytest.raises(KeyError, match="rope_colour"):
        Plant(loaded, {"rope_colour": 1.0})


@pytest.mark.parametrize(
    ("spacing", "tension"), [(1.0, 200.0), (1.0, 1000.0), (0.5, 1000.0), (5.0, 6000.0), (0.0, 1000.0)]
)
def test_the_slope_of_the_sag_law_is_ernsts_modulus(loaded: ctypes.CDLL, spacing: float, tension: float) -> None:
    """Ernst 1965; whole spans alone: a rope of 20 m, or of 50.5 m in one."""
    length = 20.0 if spacing else 50.5
    span = spacing or length
    plant = Plant(loaded, FIXED | {"submerged_weight": 20.2, "roller_spacing": spacing}, 50.5 - length, tension)
    assert plant.forces()[0] == pytest.approx(tension, rel=1e-9)
    ernst = STIFFNESS / length / (1 + (20.2 * span) ** 2 * STIFFNESS / (12 * tension**3))
    step = 1e-3 * tension / ernst
    found = []
    for way in (step, -step):
        plant["theta"] += way / DRUM
        found.append(plant.forces()[0])
        plant["theta"] -= way / DRUM
    assert (found[0] - found[1]) / (2 * step) == pytest.approx(ernst, rel=1e-5)


@pytest.mark.parametrize(
    ("span", "tension", "share"),
    [(1.0, 200.0, 2e-3), (5.0, 200.0, 2e-3), (50.5, 1000.0, 0.7e-2), (50.5, 500.0, 2.6e-2), (50.5, 200.0, 13e-2)],
)
def test_the_parabola_is_near_irvines_catenary(loaded: ctypes.CDLL, span: float, tension: float, share: float) -> None:
    """Irvine, Cable Structures, 1981: tension of an inextensible rope of the same length and chord."""
    stiff = {"submerged_weight": 20.2, "modulus_factor": 1e6}
    plant = Plant(loaded, FIXED | stiff, 50.5 - span, tension)
    longer = plant["x"] - DRUM * plant["theta"]
    exact = brentq(lambda H: 2 * H / 20.2 * np.sinh(20.2 * span / 2 / H) - span - longer, 50.0, 1e4)
    assert tension == pytest.approx(exact, rel=share)


def frequency(plant: Plant, name: str, cycles: int, step: float) -> float:
    """In Hz, of a quantity about its value at the beginning of the motion, from the zero crossings of its speed."""
    crossings, before = [], 0.0
    while len(crossings) <= 2 * cycles:
        plant.move(step)
        now = plant[name]
        if before * now < 0:
            crossings.append(plant.t - step * now / (now - before))
        before = now
    return cycles / (crossings[2 * cycles] - crossings[0])


@pytest.mark.parametrize("segments", [2, 4, 16])
def test_a_rope_with_mass_swings_at_c_over_4_l(loaded: ctypes.CDLL, segments: int) -> None:
    """Its free end at a drum without inertia: sqrt(EA/m)/4L, of n segments as sin(pi/4n)/(pi/4n) has it."""
    mass = {"rope_mass": 2.36, "segments": segments, "inertia_factor": 0.0, "damping": 0.0, "substeps": 20}
    plant = Plant(loaded, FIXED | mass, 0.0)
    shape = 1e-5 * np.sin(np.pi / 2 * np.arange(1, segments + 1) / segments)
    first = plant.place("node")
    plant.state[first : first + segments - 1] += shape[:-1]
    plant["theta"] += shape[-1] / DRUM
    exact = np.sqrt(STIFFNESS / 2.36) / 4 / 50.5
    discrete = exact * np.sin(np.pi / 4 / segments) / (np.pi / 4 / segments)
    assert exact == pytest.approx(19.378, abs=1e-3)
    assert frequency(plant, "omega", 5, 1e-3) == pytest.approx(discrete, rel=2e-4)


def test_rotor_and_drum_swing_against_each_other(loaded: ctypes.CDLL) -> None:
    """Two masses on a spring: sqrt(K (1/J_1 + 1/J_2)), with a rope that hardly pulls back."""
    rotor, drum, stiffness = 0.02, 120.0, 1.4e6
    winch = {"rotor_inertia": rotor, "drum_inertia": drum, "inertia_factor": 0.0, "gear_stiffness": stiffness}
    plant = Plant(loaded, FIXED | winch | {"damping": 0.0, "modulus_factor": 1e-4, "substeps": 50}, 0.0, 50.0)
    plant["turn"] += 1e-3
    wanted = np.sqrt(stiffness * (1 / (rotor * RATIO**2) + 1 / drum)) / 2 / np.pi
    assert frequency(plant, "spin", 10, 1e-3) == pytest.approx(wanted, rel=1e-3)


def test_teeth_leave_a_gap(loaded: ctypes.CDLL) -> None:
    """From flank to flank the rotor turns by the backlash, and by the twist of both loads."""
    gap, stiffness, drum = 3e-3, 1e6, 1e12
    winch = {"drum_inertia": drum, "rotor_inertia": 0.02, "gear_stiffness": stiffness, "gear_damping": 2e3}
    plant = Plant(loaded, FIXED | winch | {"backlash": gap, "substeps": 20})
    ends = []
    for torque in (5.0, -5.0):
        plant.torque[0] = torque
        for _ in range(1500):
            plant.move(1e-3)
        ends.append(plant["turn"])
        assert plant.forces()[4] == pytest.approx(RATIO * torque, rel=1e-6)
    assert ends[0] - ends[1] == pytest.approx(gap + 2 * RATIO * 5.0 / stiffness, rel=1e-6)


LUGRE = {"break_away": 1.5, "stribeck_speed": 0.01, "bristle_stiffness": 5e6, "bristle_damping": 1e5}
COULOMB = 490.0
"""N: Table 1's rail load times 0.1."""


def test_friction_in_steady_motion_is_stribecks_curve(loaded: ctypes.CDLL) -> None:
    for v in (1e-3, 5e-3, 0.01, 0.03, 0.5, -0.02):
        plant = Plant(loaded, LUGRE | FIXED | {"friction": 0.1})
        plant["v"] = v
        for _ in range(3000 if abs(v) < 0.1 else 20):
            plant.move(1e-3)
        curve = np.sign(v) * COULOMB * (1 + 0.5 * np.exp(-((v / 0.01) ** 2)))
        assert plant.forces()[6] == pytest.approx(curve, rel=1e-3)


def test_friction_breaks_away_near_its_value_at_rest(loaded: ctypes.CDLL) -> None:
    plant = Plant(loaded, LUGRE | FIXED | {"friction": 0.1})
    largest = 0.0
    for k in range(4000):
        plant["v"] = 1e-6 * k
        plant.move(1e-3)
        largest = max(largest, plant.forces()[6])
    assert 1.45 * COULOMB < largest < 1.52 * COULOMB


def test_hysteresis_loses_what_dahls_loop_encloses(loaded: ctypes.CDLL) -> None:
    """4 T_f (a - d tanh(a/d)) a cycle, to and fro by a: a loss factor of 0.015 at 0.2 mm."""
    force, way, length = 7.0, 4e-6 * 50.5, 0.2e-3
    plant = Plant(loaded, FIXED | {"drum_inertia": 1e12, "dahl_force": force, "damping": 0.0}, 0.0)
    enclosed, steps = 0.0, 500
    for half in range(10):
        for _ in range(steps):
            plant["omega"] = (1 if half % 2 else -1) * length * (2 if half else 1) / steps / 1e-3 / DRUM
            before, at = plant.forces()[0], plant["theta"]
            plant.move(1e-3)
            if half in {7, 8}:
                enclosed += DRUM * (plant["theta"] - at) * (before + plant.forces()[0]) / 2
    lost = 4 * force * (length - way * np.tanh(length / way))
    assert enclosed == pytest.approx(lost, rel=1e-3)
    assert lost / (np.pi * STIFFNESS / 50.5 * length**2) == pytest.approx(0.015, abs=1e-3)


ALIVE = {
    "rope_mass": 2.36,
    "segments": 3,
    "inertia_factor": 0.0,
    "drum_inertia": 120.0,
    "rotor_inertia": 0.02,
    "gear_stiffness": 1.4e6,
    "roller_spacing": 1.0,
    "damping": 0.0,
} | SAGGING


def test_what_loses_nothing_keeps_its_energy(loaded: ctypes.CDLL) -> None:
    """Waves, sag, gearbox and drums at once: what drifts does so by a quarter when the step is halved."""
    drifts = []
    for substeps in (8, 16):
        plant = Plant(loaded, FIXED | ALIVE | {"substeps": substeps}, 20.0)
        plant["theta"] += 2e-4
        start = plant.energy()
        rest = Plant(loaded, FIXED | ALIVE, 20.0).energy()
        found = []
        for _ in range(400):
            plant.move(1e-3)
            found.append(plant.energy() - start)
        drifts.append(np.abs(found).max() / (start - rest))
    assert drifts[0] < 0.02
    assert drifts[1] < 0.35 * drifts[0]


WHOLE = (
    ALIVE
    | LUGRE
    | {
        "damping": 300.0,
        "backlash": 5e-4,
        "transmission_error": 1e-4,
        "gear_efficiency": 0.97,
        "gear_damping": 200.0,
        "skin_friction": 0.01,
        "transverse_drag": 1.2,
        "roller_friction": 0.05,
        "dahl_force": 7.0,
        "wound": 1.0,
        "cell_bandwidth": 50.0,
    }
)


def driven(loaded: ctypes.CDLL, **numbers: float) -> np.ndarray:
    """Position, tensions and readings after half a second of unequal torques that change every 50 ms."""
    plant = Plant(loaded, WHOLE | numbers, 20.0)
    rows = []
    for k in range(500):
        push = 12.0 if k // 50 % 2 else 6.0
        plant.torque[:] = 22.0 + push, 22.0 - push / 2
        plant.move(1e-3)
        cells = plant.place("cell")
        rows.append([1e3 * plant["x"], *plant.forces()[:2] / 1e3, *plant.state[cells : cells + 2] / 1e3])
    return np.array(rows)


def test_half_the_step_changes_next_to_nothing(loaded: ctypes.CDLL) -> None:
    """All effects at once, in mm and kN: 16 sub-steps against 64, and these against the explicit method."""
    fine = driven(loaded, substeps=64)
    assert np.abs(driven(loaded) - fine).max() < 4e-3
    assert np.abs(driven(loaded, substeps=32) - fine).max() < 1.5e-3


@pytest.mark.slow
def test_the_explicit_method_says_the_same(loaded: ctypes.CDLL) -> None:
    assert np.abs(driven(loaded, integrator=0, substeps=256) - driven(loaded, substeps=128)).max() < 1e-3


def stiffness(loaded: ctypes.CDLL, span: float, hertz: float, tension: float = 1000.0) -> float:
    """Dynamic stiffness in N/m of a single span, from small sinusoidal motion of its drum."""
    moved = FIXED | SAGGING | {"drum_inertia": 1e12, "damping": 0.0, "transverse_drag": 0.02, "substeps": 8}
    plant = Plant(loaded, moved, 50.5 - span, tension)
    size, step, cycles = 2e-7 * span, min(1e-3, 1 / hertz / 100), 40
    omega, total, weight = 2 * np.pi * hertz, 0.0, 0.0
    for k in range(round(cycles / hertz / step)):
        plant["omega"] = size / DRUM * omega * np.cos(omega * (k + 0.5) * step)
        plant.move(step)
        if k * step > cycles / 2 / hertz:
            wave = np.sin(omega * (k + 1) * step)
            total += (plant.forces()[0] - tension) * wave
            weight += wave**2 * size
    return total / weight


def one_mode(span: float, hertz: float, tension: float = 1000.0) -> float:
    """The same, linear: T' = k (s' + g a'), and the mode's equation."""
    k, a = STIFFNESS / span, 20.2 * span**2 / 8 / tension
    g = 16 / 3 * a / span
    resisting = 16 / 3 * tension / span**2 - 8 / 15 * 2.96 * (2 * np.pi * hertz) ** 2
    return k / (1 + k * g * g / span / resisting)


MOORDYN = {(1.0, 1.0): 16.15e6, (1.0, 5.0): 13.18e6, (5.0, 0.2): 224e3, (5.0, 1.0): 162e3}
"""Span in m and Hz → N/m at 1 000 N, by MoorDyn 2.7.2."""


@pytest.mark.parametrize(("span", "hertz"), [(1.0, 5.0), (5.0, 1.0), (1.0, 30.0)])
def test_a_span_is_as_stiff_as_its_mode_says(loaded: ctypes.CDLL, span: float, hertz: float) -> None:
    assert stiffness(loaded, span, hertz) == pytest.approx(one_mode(span, hertz), rel=5e-3)


@pytest.mark.parametrize(("span", "hertz"), MOORDYN)
def test_below_its_resonance_a_span_is_as_stiff_as_moordyn_said(span: float, hertz: float) -> None:
    assert one_mode(span, hertz) == pytest.approx(MOORDYN[span, hertz], rel=0.01)


INPUT = """--------------------- MoorDyn Input File ---------------------
a span of rope
---------------------- LINE TYPES -----------------------------
TypeName Diam Mass/m EA BA/-zeta EI Cd Ca CdAx CaAx
(name) (m) (kg/m) (N) (N-s/-) (N-m^2) (-) (-) (-) (-)
rope {diameter:.9f} 2.36 {stiffness:.6e} -0.5 0 1.2 {added:.6f} 0 0
---------------------- POINT PROPERTIES -----------------------
ID Type X Y Z Mass Volume CdA Ca
(#) (name) (m) (m) (m) (kg) (m^3) (m^2) (-)
1 Fixed 0 0 -50 0 0 0 0
2 Coupled {span} 0 -50 0 0 0 0
---------------------- LINES -----------------------------
ID LineType AttachA AttachB UnstrLen NumSegs LineOutputs
(#) (name) (#) (#) (m) (-) (-)
1 rope 1 2 {length:.12f} {parts} -
---------------------- OPTIONS -----------------------------
0 writeLog
{step:g} dtM
9.80665 g
1025 rhoW
5 CdScaleIC
100 WtrDpth
0.1 dtIC
10 TmaxIC
1e-7 threshIC
-------------------------- need this line --------------------------------------
"""


@pytest.mark.external
@pytest.mark.parametrize(("span", "hertz"), MOORDYN)
def test_below_its_resonance_a_span_is_as_stiff_as_in_moordyn(tmp_path: Path, span: float, hertz: float) -> None:
    """A span of 16 elements in water, of the same mass across and weight, at 1 000 N; one end moves by 1e-6 of it."""
    moordyn = pytest.importorskip("moordyn")
    parts, tension, displaced = 16, 1000.0, 2.36 - 20.2 / 9.80665
    numbers = {
        "diameter": np.sqrt(4 / np.pi * displaced / 1025),
        "stiffness": STIFFNESS,
        "added": (2.96 - 2.36) / displaced,
        "span": span,
        # a polygon of n elements sags by 1 - 1/n² of the parabola's shortening
        "length": span + 20.2**2 * span**3 / 24 / tension**2 * (1 - 1 / parts**2) - tension * span / STIFFNESS,
        "parts": parts,
        "step": 0.5 * span / parts / np.sqrt(STIFFNESS / 2.36),
    }
    file = tmp_path / "span.txt"
    file.write_text(INPUT.format(**numbers))
    system = moordyn.Create(str(file))
    moordyn.SetVerbosity(system, 0)
    moordyn.Init(system, [span, 0, -50], [0, 0, 0])
    line = moordyn.GetLine(system, 1)
    omega, step, cycles, gently = 2 * np.pi * hertz, min(1e-3, 1 / hertz / 100), 5, 2
    times, tensions = [], []
    for k in range(round(cycles / hertz / step)):
        t = k * step
        grown = min(t * hertz / gently, 1.0)
        size = 1e-6 * span * grown**2 * (3 - 2 * grown)
        moordyn.Step(
            system, [span + size * np.sin(omega * t), 0, -50], [size * omega * np.cos(omega * t), 0, 0], t, step
        )
        times.append(t + step)
        tensions.append(moordyn.GetLineNodeTen(line, parts)[0])
    moordyn.Close(system)
    late = np.array(times) > (cycles - 2) / hertz
    waves = omega * np.array(times)[late]
    columns = np.stack([np.sin(waves), np.cos(waves), np.ones_like(waves)], axis=1)
    in_phase, _, mean = np.linalg.lstsq(columns, np.array(tensions)[late])[0]
    assert mean == pytest.approx(tension, rel=3e-3)
    assert one_mode(span, hertz) == pytest.approx(in_phase / 1e-6 / span, rel=0.01)
