"""Each integrator against the independent solver, with its steps halved."""

from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from dualwinch.model.disturbance import Disturbance
from dualwinch.model.plant import DisturbanceInputs, Plant, PlantState, Torques
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.integrators import INTEGRATORS, Motion, Problem
from tests.oracle.collocation import Collocation
from tests.oracle.plant import Hold
from tests.oracle.plant import Plant as OraclePlant
from tests.oracle.values import DEFAULTS

ORACLE = OraclePlant({**DEFAULTS, "disturbance.vortex": True})


@dataclass(frozen=True)
class Stretch:
    """A stretch of motion with held torques, and where the independent implementation says that it ends."""

    x: float
    v: float
    pulls: tuple[float, float]
    slips: tuple[float, float]
    torques: tuple[float, float]
    duration: float
    t: float = 7.0

    @property
    def start(self) -> NDArray[np.float64]:
        """State at the beginning, by the ropes' pulls in N and how fast they stretch in m/s."""
        k_1, k_2 = ORACLE.stiffnesses(self.x)
        theta_1, theta_2 = (self.pulls[0] / k_1 + self.x) / 0.8, (self.pulls[1] / k_2 - self.x) / 0.8
        omega_1, omega_2 = (self.v + self.slips[0]) / 0.8, (self.slips[1] - self.v) / 0.8
        return np.array([self.x, self.v, theta_1, omega_1, theta_2, omega_2])

    @property
    def end(self) -> NDArray[np.float64]:
        """State at the end."""
        x, v, theta_1, omega_1, theta_2, omega_2 = self.start.tolist()
        (x, theta_1, theta_2), (v, omega_1, omega_2) = Collocation(ORACLE, swing=0.2).advance(
            self.t, self.duration, (x, theta_1, theta_2), (v, omega_1, omega_2), Hold(*self.torques)
        )
        return np.array([x, v, theta_1, omega_1, theta_2, omega_2])

    def error(self, name: str, steps: int) -> NDArray[np.float64]:
        """Error of the state at the end after so many equal samples of one sub-step each."""
        motion, h = np.append(self.start, [0.0, 0.0]), self.duration / steps
        for index in range(steps):
            motion = one_step(name)(self.t + index * h, h, motion, self.torques)
        return np.abs(np.array(motion).ravel()[:6] - self.end)


@cache
def one_step(name: str) -> ca.Function:
    """``(t, h, motion, torques) -> motion`` at t + h."""
    t, h, motion, torques = ca.SX.sym("t"), ca.SX.sym("h"), ca.SX.sym("motion", 8), ca.SX.sym("torques", 2)
    problem = Problem(t, h, Torques(*ca.vertsplit(torques)), DisturbanceInputs(), Disturbance(vortex=True), Plant())
    *state, phase, slow = ca.vertsplit(motion)
    after = INTEGRATORS[name].advance(problem, Motion(PlantState(*state), phase, slow), 1)
    return ca.Function("one_step", [t, h, motion, torques], [ca.vertcat(*leaves(after).values())])


SMOOTH = Stretch(25.0, 1.2, (3000.0, 1500.0), (0.02, -0.03), (60.0, 35.0), duration=20e-3)
SLACKENING = Stretch(5.0, 1.2, (3000.0, 100.0), (0.02, -0.1), (60.0, 5.0), duration=4e-3)


@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("which", [0, 2, 4], ids=["x", "theta_1", "theta_2"])
def test_halving_the_step_shows_the_order(name: str, which: int) -> None:
    fewest = 256 if name == "verlet" else 16  # what the damping of a drum as light as the paper's takes
    coarse, fine = (SMOOTH.error(name, steps)[which] for steps in (fewest, 4 * fewest))
    assert np.log2(coarse / fine) / 2 == pytest.approx(INTEGRATORS[name].order, abs=0.25)


@pytest.mark.parametrize("name", INTEGRATORS)
def test_order_where_a_rope_goes_slack_and_taut_again_on_the_way(name: str) -> None:
    """Those that do not locate the instant fall to first order."""
    x, v, theta_1, omega_1, theta_2, omega_2 = replace(SLACKENING, duration=2e-3).end.tolist()
    assert ORACLE.tensions((x, theta_1, theta_2), (v, omega_1, omega_2))[1] == 0
    coarse, fine = (SLACKENING.error(name, steps)[0] for steps in (8, 64))
    order = 1 if name in {"rk4", "verlet"} else INTEGRATORS[name].order
    assert np.log2(coarse / fine) / 3 == pytest.approx(order, abs=0.35)


@pytest.mark.parametrize("name", INTEGRATORS)
def test_a_stretch_through_slack_agrees_with_the_independent_solver(name: str) -> None:
    steps = 4096 if INTEGRATORS[name].order == 1 else 512
    assert SLACKENING.error(name, steps)[[0, 2, 4]].max() < 1e-7
