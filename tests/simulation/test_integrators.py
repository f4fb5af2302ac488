from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from model.disturbance import Disturbance
from model.plant import Environment, Plant, PlantState, Torques
from model.quantity import leaves
from simulation.integrators import INTEGRATORS, Motion, Problem
from tests.oracle.collocation import Collocation
from tests.oracle.plant import Held
from tests.oracle.plant import Plant as OraclePlant
from tests.oracle.values import DEFAULTS

VALUES = {**DEFAULTS, "disturbance.vortex": True}


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
        k_1, k_2 = OraclePlant(VALUES).stiffnesses(self.x)
        theta_1, theta_2 = (self.pulls[0] / k_1 + self.x) / 0.8, (self.pulls[1] / k_2 - self.x) / 0.8
        omega_1, omega_2 = (self.v + self.slips[0]) / 0.8, (self.slips[1] - self.v) / 0.8
        return np.array([self.x, self.v, theta_1, omega_1, theta_2, omega_2])

    @property
    def end(self) -> NDArray[np.float64]:
        x, v, theta_1, omega_1, theta_2, omega_2 = self.start.tolist()
        solver = Collocation(OraclePlant(VALUES), swing=0.2)
        places, paces = solver.advance(
            self.t, self.duration, (x, theta_1, theta_2), (v, omega_1, omega_2), Held(*self.torques)
        )
        return np.array([places[0], paces[0], places[1], paces[1], places[2], paces[2]])

    @cache  # noqa: B019
    def errors(self, name: str, substeps: tuple[int, ...]) -> NDArray[np.float64]:
        """(substeps, states): errors at the end."""
        state, end = ca.SX.sym("state", 6), self.end
        problem = Problem(
            self.t, self.duration, Torques(*self.torques), Environment(), Disturbance(vortex=True), Plant()
        )
        found: list[NDArray[np.float64]] = []
        for count in substeps:
            after = INTEGRATORS[name].advance(problem, Motion(PlantState(*ca.vertsplit(state))), count).plant
            function = ca.Function("after", [state], [ca.vertcat(*leaves(after).values())])
            found.append(np.abs(np.array(function(self.start)).ravel() - end))
        return np.array(found)


SMOOTH = Stretch(25.0, 1.2, (3000.0, 1500.0), (0.02, -0.03), (60.0, 35.0), duration=20e-3)
SLACKENING = Stretch(5.0, 1.2, (3000.0, 100.0), (0.02, -0.1), (60.0, 5.0), duration=4e-3)


@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("which", [0, 2, 4], ids=["x", "theta_1", "theta_2"])
def test_halving_the_step_shows_the_order(name: str, which: int) -> None:
    coarse, fine = SMOOTH.errors(name, (16, 64))[:, which]
    assert np.log2(coarse / fine) / 2 == pytest.approx(INTEGRATORS[name].order, abs=0.25)


@pytest.mark.parametrize(("name", "order"), [("rk4", 1), ("exponential", 2)])
def test_order_where_a_rope_goes_slack_on_the_way(name: str, order: int) -> None:
    x, v, theta_1, omega_1, theta_2, omega_2 = replace(SLACKENING, duration=2e-3).end.tolist()
    assert OraclePlant(VALUES).tensions((x, theta_1, theta_2), (v, omega_1, omega_2))[1] == 0
    coarse, fine = SLACKENING.errors(name, (8, 64))[:, 0]
    assert np.log2(coarse / fine) / 3 == pytest.approx(order, abs=0.35)


@pytest.mark.parametrize("name", INTEGRATORS)
def test_one_sample_through_slack_agrees_with_the_independent_solver(name: str) -> None:
    assert replace(SLACKENING, duration=1e-3).errors(name, (64,)).max() < 1e-4


def test_the_stretches_cover_every_integrator() -> None:
    assert set(INTEGRATORS) == {"rk4", "exponential"}
