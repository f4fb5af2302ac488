"""Tensions between samples: what a stiff solver finds, and the rows themselves where they do not say enough."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dualwinch.model.actuators import Motor
from dualwinch.model.plant import DisturbanceInputs, PlantState, Torques, derivative, tensions
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.between_samples import POINTS_A_SAMPLE, between_samples
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.simulate import simulate

START = slice(0, 21)


@pytest.fixture(scope="module")
def run(paper_run: Callable[[int, str], Result]) -> Result:
    return paper_run(1, "fando-nftsm")


@pytest.mark.parametrize("row", [0, 3, 11])
def test_it_is_what_a_stiff_solver_finds(run: Result, row: int) -> None:
    t, forces = between_samples(run, START)
    assert len(t) == 20 * POINTS_A_SAMPLE + 1
    plant, torques = run.experiment.plant, Torques(run["tau_1"][row], run["tau_2"][row])
    start = [run[name][row] for name in ("x", "v", "theta_1", "omega_1", "theta_2", "omega_2")]

    def rate(_t: float, state: np.ndarray) -> list[float]:
        return list(leaves(derivative(PlantState(*state), torques, DisturbanceInputs(), plant)).values())

    at = np.arange(POINTS_A_SAMPLE) * 1e-3 / POINTS_A_SAMPLE
    found = solve_ivp(rate, (0, 1e-3), start, method="Radau", t_eval=at, rtol=1e-10, atol=1e-12)
    wanted = np.array([tensions(PlantState(*state), plant) for state in found.y.T]).T
    for force, exact in zip(forces.values(), wanted, strict=True):
        np.testing.assert_allclose(force[row * POINTS_A_SAMPLE : (row + 1) * POINTS_A_SAMPLE], exact, atol=2.0)


def test_samples_hide_what_it_shows(run: Result) -> None:
    _t, forces = between_samples(run, START)

    def turns(force: np.ndarray) -> int:
        return int(np.count_nonzero(np.diff(np.sign(np.diff(force)))))

    assert turns(forces["F2"]) > 1.5 * turns(run["F2"][START])


@pytest.mark.parametrize(("change", "stride"), [({"actuator": Motor()}, 1), ({}, 3)])
def test_where_rows_do_not_say_enough_they_are_what_is_shown(change: dict, stride: int) -> None:
    run = simulate(replace(case(1), **change), stride=stride)
    t, forces = between_samples(run, START)
    np.testing.assert_array_equal(t, run["t"][START])
    np.testing.assert_array_equal(forces["F1"], run["F1"][START])
    np.testing.assert_array_equal(forces["F2"], run["F2"][START])
