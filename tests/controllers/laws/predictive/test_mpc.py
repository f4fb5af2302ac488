"""Model predictive control in the loop: limits, preview, steady states, and what it looks ahead to."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from benchmarks.embedded.host import PRECISE, Host, build
from benchmarks.embedded.report import recorded
from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.export.package import Provenance, c_package
from dualwinch.controllers.laws.extended_state_observer import ObserverOutput
from dualwinch.controllers.laws.predictive.mpc import Mpc, MpcState
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context, Estimate
from dualwinch.model.motions import Setpoint
from dualwinch.model.plant import Plant
from dualwinch.model.vehicle import Vehicle
from dualwinch.simulation.blocks import block
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

T, MASS = 1e-3, 1e4
SMOOTH = Plant(vehicle=Vehicle(drag_coefficient=0.0, friction_coefficient=0.0))
HURRIED = override(case(4, "mpc"), {"reference.kind": "uniform", "reference.speed": 0.15, "simulation.duration": 4.0})
"""The reference runs away at once, beyond what the ropes can give."""


def sampled(law: Mpc, x: float, v: float, samples: int, d: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Positions and forces of a mass that the law holds at 0 m, pushed by an acceleration."""
    state, context, rows = law.initial_state(), Context(SMOOTH, Limits(), T), []
    for _ in range(samples):
        estimate = Estimate(x, v, 1e3, 1e3, 0.0, 0.0, 0.0, 0.0)
        state, output = law.step(state, estimate, Setpoint(0.0, 0.0, 0.0), context)
        rows.append((x, float(output.u_sat)))
        a = float(output.u_sat) / MASS + d
        x, v = x + T * v + T**2 / 2 * a, v + T * a
    xs, forces = np.array(rows).T
    return xs, forces


def test_a_constant_push_leaves_no_error() -> None:
    x, force = sampled(Mpc(position=2e-3), 0.0, 0.0, 3000, d=0.1)
    assert np.abs(x).max() > 1e-4
    assert abs(x[-1]) < 1e-8
    assert force[-1] == pytest.approx(-0.1 * MASS, rel=1e-5)


@pytest.mark.slow
def test_the_force_keeps_to_its_limits_and_to_its_rate() -> None:
    law = Mpc(rise_time=0.29)
    x, force = sampled(law, -0.1, 0.0, 4000)
    changes = np.diff(np.append(0.0, force)) / T
    assert np.abs(force).max() <= Limits().force
    assert np.abs(force).max() > 0.999 * Limits().force
    assert np.abs(changes).max() <= 2e4 * (1 + 1e-9)
    assert np.abs(changes).max() > 0.999 * 2e4
    assert abs(x[-1]) < 1e-3


def test_limits_hold_in_a_run_that_saturates() -> None:
    result = simulate(HURRIED)
    force = result["u_sat"]
    assert result.outcome == "completed"
    assert np.abs(force).max() <= 5800
    assert (force > 0.99 * 5800).mean() > 0.05
    assert np.abs(np.diff(force)).max() <= 5.8e4 * T * (1 + 1e-9)
    assert np.abs(result["e"][-500:]).max() < 5e-3


@dataclass(frozen=True)
class Blind(Mpc):
    """The same law without preview: the setpoint goes on as it is."""

    kind: ClassVar = "blind"

    @property
    def preview(self) -> tuple[float, ...]:
        return ()

    def step(
        self, state: MpcState, estimate: Estimate, setpoint: Setpoint, context: Context
    ) -> tuple[MpcState, ObserverOutput]:
        return super().step(state, estimate, Setpoint(setpoint.x, setpoint.v, setpoint.a), context)


def corners(result: Result) -> np.ndarray:
    """Errors around the joints of the profile."""
    t = result["t"]
    near = [(np.abs(t - joint) < 1.0) for joint in (18.0, 29.0, 41.0)]
    return np.array([np.abs(result["e"][chosen]).max() for chosen in near])


@pytest.mark.slow
def test_preview_helps_where_the_acceleration_steps() -> None:
    seeing, blind = simulate(case(2, "mpc")), simulate(case(2, law=Blind()))
    assert (corners(seeing) < 0.6 * corners(blind)).all()


def test_it_is_better_than_the_papers_law_in_vortices(paper_run) -> None:
    ours, paper = simulate(case(4, "mpc")), paper_run(4, "fando-nftsm")
    assert ours.metrics.mse < paper.metrics.mse / 100
    assert ours.metrics.chatter < paper.metrics.chatter


def test_what_it_foresees_is_the_horizon() -> None:
    law = Mpc(horizon=0.9, stages=4)
    assert len(law.preview) == 4
    assert law.preview[-1] == pytest.approx(0.9)
    assert len(law.initial_state().sides) == 4


def test_in_single_precision_the_exported_controller_gives_nearly_the_same(tmp_path: Path) -> None:
    short = replace(HURRIED, simulation=replace(HURRIED.simulation, duration=1.0))
    made, result = block("controller", short), simulate(short)
    package = c_package(made, "controller", Provenance("dualwinch", "", ""), "float")
    library = build(tmp_path, package, "controller", find_compiler().command, *PRECISE)
    found = Host(library, "controller", made, "float").run(recorded(result, made))
    column = [output.name for output in made.outputs].index("u_sat")
    assert np.abs(found[:, column] - result["u_sat"]).max() < 1e-3 * 5800
