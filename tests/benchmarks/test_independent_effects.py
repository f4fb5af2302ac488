"""The product's plant against the independent one, which shares no code with it, under the same torques."""

import ctypes
from collections.abc import Mapping

import casadi as ca
import numpy as np
import pytest

from benchmarks.independent.plant import Plant as IndependentPlant
from benchmarks.independent.plant import library
from dualwinch.model.disturbance import Disturbance
from dualwinch.model.plant import DisturbanceInputs, Plant, Torques, resting_state, tensions
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.ropes import Rope, Track
from dualwinch.model.vehicle import Vehicle
from dualwinch.model.winch import Winch
from dualwinch.simulation.integrators import INTEGRATORS, Motion, Problem

BEGINNING, SUBSTEPS = 23.0, 5


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return library(tmp_path_factory.mktemp("plant"))


def torques() -> np.ndarray:
    """Pulls to and fro, in N m: the vehicle sticks, breaks away, and turns."""
    push = np.where(np.arange(400) // 100 % 2 == 0, 14.0, -4.0)
    return np.array([22.2 + push, 22.2 - push / 2])


def ours(plant: Plant) -> np.ndarray:
    """Position in mm, speed in mm/s and tensions in N at each ms, by Verlet's method."""
    start = Motion(resting_state(2000.0, plant, BEGINNING))
    state, tau = ca.SX.sym("state", len(leaves(start))), ca.SX.sym("tau", 2)
    motion = with_leaves(start, dict(zip(leaves(start), ca.vertsplit(state), strict=True)))
    still = Disturbance(vortex=False)
    problem = Problem(0.0, 1e-3, Torques(tau[0], tau[1]), DisturbanceInputs(), still, plant)
    moved = INTEGRATORS["verlet"].advance(problem, motion, SUBSTEPS)
    row = ca.vertcat(1e3 * moved.plant.x, 1e3 * moved.plant.v, *tensions(moved.plant, plant))
    step = ca.Function("step", [state, tau], [ca.vertcat(*leaves(moved).values()), row])
    pulled = torques()
    _, rows = step.mapaccum(pulled.shape[1])(list(leaves(start).values()), pulled)
    return np.array(rows).T


def theirs(loaded: ctypes.CDLL, effects: Mapping[str, float], bristle: float) -> np.ndarray:
    """The same, from a bristle that holds the vehicle on its slope."""
    plant, rows = IndependentPlant(loaded, effects, BEGINNING), []
    plant["bristle"] = bristle
    for pair in torques().T:
        plant.torque[:] = pair
        plant.move(1e-3)
        rows.append([1e3 * plant["x"], 1e3 * plant["v"], *plant.forces()[:2]])
    return np.array(rows)


WINCH = {"inertia_factor": 0.0, "drum_inertia": 150.0, "damping": 500.0}
EFFECTS = {
    "rail": {"break_away": 1.5, "bristle_stiffness": 5e6, "bristle_damping": 1e5},
    "slope": {"rail_tilt": 5e-3, "rail_wave": 5e-3},
    "hysteresis": {"dahl_force": 14.0},
}


def test_friction_slope_and_hysteresis_are_those_of_the_independent_plant(loaded: ctypes.CDLL) -> None:
    """Off by less than a tenth of what any of them makes."""
    rope, winch = Rope(damping=500.0, hysteresis=14.0), Winch(inertia=150.0)
    vehicle = Vehicle(stiction=0.5, bristle_stiffness=5e6, bristle_damping=1e5)
    track = Track(tilt=5e-3, waviness=5e-3)
    plant = Plant(vehicle=vehicle, track=track, rope_1=rope, rope_2=rope, winch_1=winch, winch_2=winch)
    bristle = resting_state(2000.0, plant, BEGINNING).rail.deflection
    everything = WINCH | {key: value for effect in EFFECTS.values() for key, value in effect.items()}
    judged = theirs(loaded, everything, bristle)
    off = np.abs(ours(plant) - judged).max(axis=0)
    assert (off < [1.5e-3, 0.012, 2.5, 2.5]).all(), off
    for name, effect in EFFECTS.items():
        without = theirs(loaded, {k: v for k, v in everything.items() if k not in effect}, bristle)
        made = np.abs(without - judged).max(axis=0)
        assert (made > 10 * off).any(), name
