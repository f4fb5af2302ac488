"""The whole closed loop against the independent implementation, which integrates with a stiff implicit method."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.estimators.low_pass import LowPass
from dualwinch.controllers.nominal import Nominal
from dualwinch.controllers.registry import POSITION_LAWS
from dualwinch.model.disturbance import Disturbance
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Reference
from dualwinch.model.vehicle import Vehicle
from dualwinch.model.winch import Winch
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.loop.closed_loop import closed_loop
from dualwinch.simulation.loop.structure import structure_of
from dualwinch.simulation.paper import CASES, CONTROLLERS, case
from dualwinch.simulation.sensors import Sensors
from dualwinch.simulation.simulate import simulate
from tests.conftest import OracleRun, PaperRun
from tests.oracle.sampled import Scenario, run
from tests.tiers import all_but, mostly_slow
from tests.tolerances import close

METRE = 1e-6
"""Largest difference of the position that counts as agreement, in m."""

SETTINGS: list[tuple[str, int, tuple[int, ...], tuple[str, ...]]] = [
    ("exponential", 4, (2, 4), tuple(CONTROLLERS)),
    ("exponential", 8, (1, 3), tuple(CONTROLLERS)),
    ("rk4", 4, (2, 4), tuple(CONTROLLERS)),
    ("rk4", 64, (1, 3), ("fando-nftsm",)),
]
"""Integrator, sub-steps, cases, controllers: slack at the start of Cases 1 and 3 takes more sub-steps than the rest."""

RUNS = [
    (integrator, substeps, number, kind)
    for integrator, substeps, cases, kinds in SETTINGS
    for number in cases
    for kind in kinds
]


BEGINNING = 800
"""Samples of a run that the independent implementation goes along with in the quick tier; slow tests have them all."""


@pytest.mark.parametrize("samples", all_but([BEGINNING], [BEGINNING, None]))
@pytest.mark.parametrize(
    ("integrator", "substeps", "number", "kind"), mostly_slow(RUNS, lambda run: run[2] == 2 or run[3] == "fando-nftsm")
)
def test_positions_agree(
    integrator: Any, substeps: int, number: int, kind: str, samples: int | None, oracle_run: OracleRun
) -> None:
    simulation = Simulation(integrator=integrator, substeps=substeps)
    ours, theirs = simulate(replace(case(number, kind), simulation=simulation)), oracle_run(number, kind, samples)
    assert len(ours["x"][:samples]) == len(theirs["x"])
    assert np.abs(ours["x"][:samples] - theirs["x"]).max() <= METRE


@pytest.mark.parametrize(
    ("kind", "number", "samples"),
    mostly_slow(product(CONTROLLERS, CASES, (BEGINNING, None)), lambda row: row[2] == BEGINNING),
)
def test_positions_agree_by_default(
    number: int, kind: str, samples: int | None, paper_run: PaperRun, oracle_run: OracleRun
) -> None:
    ours, theirs = paper_run(number, kind)["x"], oracle_run(number, kind, samples)["x"]
    assert np.abs(ours[:samples] - theirs).max() <= METRE


@pytest.mark.parametrize("samples", all_but([BEGINNING], [BEGINNING, None]))
@pytest.mark.parametrize("kind", CONTROLLERS)
def test_every_column_agrees(kind: str, samples: int | None, paper_run: PaperRun, oracle_run: OracleRun) -> None:
    """To a part of the column's own range; the observer's gain, which follows rates, is the most sensitive."""
    ours, theirs = paper_run(4, kind), oracle_run(4, kind, samples)
    for name, expected in theirs.items():
        if np.isnan(expected).all():
            assert name not in ours.columns
        else:
            assert np.abs(ours[name][:samples] - expected).max() <= 5e-4 * np.ptp(ours[name]), name


EVERYTHING = Experiment(
    plant=Plant(
        vehicle=Vehicle(mass=9e3, added_mass=2e3, drag_coefficient=0.4, friction_velocity=0.02),
        winch_1=Winch(coulomb_friction=20.0, viscous_friction=3.0),
        winch_2=Winch(inertia=2.2, drum_radius=0.7, gear_ratio=30.0, viscous_friction=5.0),
    ),
    controller=Controller(
        estimator=LowPass(speed_filter_time=0.01),
        nominal=Nominal(mass=1e4, drag_coefficient=0.3, friction_coefficient=0.12),
    ),
    reference=Reference(kind="profile"),
    disturbance=Disturbance(vortex=True, integrated_phase=True, current_sigma=0.1, normal_force_sigma=0.1),
    sensors=Sensors(position_noise=1e-4, position_resolution=1e-5, speed_noise=1e-4, tension_noise=5.0),
    simulation=Simulation(duration=1.5, delay_samples=3, integrator="exponential", substeps=8, seed=11),
)
CHANGES = {
    "plant.vehicle.mass": 9e3,
    "plant.vehicle.added_mass": 2e3,
    "plant.vehicle.drag_coefficient": 0.4,
    "plant.vehicle.friction_velocity": 0.02,
    "plant.winch_1.coulomb_friction": 20.0,
    "plant.winch_1.viscous_friction": 3.0,
    "plant.winch_2.inertia": 2.2,
    "plant.winch_2.drum_radius": 0.7,
    "plant.winch_2.gear_ratio": 30.0,
    "plant.winch_2.viscous_friction": 5.0,
    "controller.speed_filter_time": 0.01,
    "controller.nominal.mass": 1e4,
    "controller.nominal.drag_coefficient": 0.3,
    "controller.nominal.friction_coefficient": 0.12,
    "disturbance.integrated_phase": True,
    "simulation.delay_samples": 3,
}


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_everything_switched_on_at_once_agrees(kind: str) -> None:
    """Sensor noise, current, rail load, delay, filter, wrong nominal values, winch friction; the draws are shared."""
    experiment = replace(EVERYTHING, controller=replace(EVERYTHING.controller, law=POSITION_LAWS[kind]()))
    names = closed_loop(structure_of(experiment)).exogenous
    drawn = dict(zip(names, exogenous_signals(experiment).T, strict=True))
    sensors = experiment.sensors
    scenario = Scenario(
        kind,
        4,
        CHANGES,
        {
            "current": drawn["current"],
            "load": drawn["normal_force_variation"],
            "x": sensors.position_noise * drawn["noise.position"],
            "v": sensors.speed_noise * drawn["noise.speed"],
            "F1": sensors.tension_noise * drawn["noise.tension_1"],
            "F2": sensors.tension_noise * drawn["noise.tension_2"],
        },
        sensors.position_resolution,
    )
    ours, theirs = simulate(experiment), run(scenario, experiment.samples)
    assert np.abs(ours["x"] - theirs["x"]).max() <= METRE
    assert np.abs(ours["u"] - theirs["u"]).max() <= 1e-3 * np.ptp(theirs["u"])


def test_two_sided_ropes_agree() -> None:
    experiment = case(1)
    experiment = replace(
        experiment,
        plant=Plant(rope_slack=False),
        simulation=Simulation(duration=1.0, integrator="exponential", substeps=8, seed=11),
    )
    ours, theirs = simulate(experiment), run(Scenario("fando-nftsm", 1, {"plant.rope_slack": False}), 1000)
    assert theirs["F2"].min() < -100
    assert np.abs(ours["x"] - theirs["x"]).max() <= METRE


def test_rows_are_written_at_the_beginning_of_each_sample(paper_run: PaperRun) -> None:
    result = paper_run(2, "fando-nftsm")
    assert close(result["t"], 1e-3 * np.arange(50_000), rel=1e-6, abs=1e-12)
    assert result["x"][0] == 0
    assert (result["F1"][0], result["F2"][0]) == pytest.approx((1000, 1000))


def test_true_disturbance_is_the_vortex_where_the_controller_knows_the_plant(paper_run: PaperRun) -> None:
    result = paper_run(4, "fando-nftsm")
    t, v = result["t"], result["v"]
    vortex = 0.2 * 900 * v * np.abs(v) * np.sin(2 * np.pi * 0.1 * v * t)
    assert np.abs(result["d_true"] - vortex / 1e4).max() < 1e-9


def test_estimate_follows_the_true_disturbance(paper_run: PaperRun) -> None:
    result = paper_run(4, "fando-nftsm")
    steady = (result["t"] > 18.5) & (result["t"] < 28.5)
    error, truth = (result["d_hat"] - result["d_true"])[steady], result["d_true"][steady]
    assert np.sqrt(np.mean(error**2)) < 0.4 * np.sqrt(np.mean(truth**2))


def test_with_bounded_jerk_the_torques_do_not_step(paper_run: PaperRun) -> None:
    """At the joints of the paper's profile the command steps by M times the step of the reference acceleration."""
    stepping = paper_run(2, "fando-nftsm")
    smooth = simulate(replace(case(2), reference=Reference(jerk_limit=0.5)))
    for column, step in (("u", 1000.0), ("tau_1", 8.0)):
        assert np.abs(np.diff(stepping[column])).max() > step
        assert np.abs(np.diff(smooth[column])).max() < 0.02 * step
    assert smooth.metrics.max_abs_error < stepping.metrics.max_abs_error
    assert smooth["x_ref"][-1] == pytest.approx(46.8, abs=1e-12)
