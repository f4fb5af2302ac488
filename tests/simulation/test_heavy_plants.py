"""Ropes with mass and sag and winches with gearboxes wherever a plant goes: engines, packages, FMUs, gradients."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dualwinch as dw
from benchmarks.embedded.host import Host, build
from dualwinch.codegen.block import Block
from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.export.package import Provenance, c_package
from dualwinch.simulation.blocks import block
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.toolboxes.fmu.export import export_fmu
from dualwinch.toolboxes.stepper.stepper import Stepper
from tests.fmus import Instance
from tests.stepping import interpreted, plausible, values
from tests.tiers import all_but
from tests.toolboxes.stepper.feeding import feed, torques_of

ABOUT = Provenance("dualwinch", "test", "2026-01-01")
INDEPENDENT = Path(__file__).parents[2] / "benchmarks/independent"
GAINS = {
    "power_law_in_site": Path(__file__).parents[1] / "power_law_in_site.toml",
    **{name: INDEPENDENT / f"{name}.toml" for name in ("searched", "tuned_in_site", "shaped_in_site")},
}
"""Name of gains for the site → their file; those of the first have no linear speed."""
DAMPING = 164.0
SHAFTS = {"omega_1": "motor_1.omega", "omega_2": "motor_2.omega"}
"""What an encoder gives → the plant's output: it is on the motor's shaft."""


@cache
def heavy(duration: float = 0.1, **keys: Any) -> dw.Experiment:
    """The nominal machine of `site`, its drums damped, with perfect sensors, motors and drives, in calm water."""
    site = dw.load_ensemble("site").experiment
    damping = {f"controller.winch_{number}.damping": DAMPING for number in (1, 2)}
    simulation = replace(site.simulation, duration=duration, jitter=0.0, delay_samples=0, torque_step=0.0)
    calm = replace(site, sensors=dw.Sensors(), actuator=dw.Ideal(), disturbance=dw.Disturbance(), simulation=simulation)
    return dw.override(
        calm, damping | {"reference.jerk_limit": 1.0} | {k.replace("__", "."): v for k, v in keys.items()}
    )


def test_a_lane_of_the_stepper_is_the_run() -> None:
    run, stepper = dw.simulate(noisy(), engine="interpreter"), Stepper(noisy(), batch=2, exact=True)
    feed(stepper, torques_of(run))
    for name in ("x", "theta_2", "F1", "sag_1", "gear_2", "F2_vehicle"):
        np.testing.assert_array_equal(stepper.result(1)[name], run[name])


@pytest.mark.slow
def test_an_environment_begins_at_rest_and_steps() -> None:
    environments = dw.VectorEnvironment(2, heavy(0.01))
    _, info = environments.reset(seed=0)
    observed, *_ = environments.step(environments.action_space.sample())
    assert np.isfinite(np.asarray(observed)).all()
    assert isinstance(info, dict)


def noisy() -> dw.Experiment:
    """The nominal machine of `site` with its noise."""
    site = dw.load_ensemble("site").experiment
    return dw.override(site, {"simulation.duration": 0.1, "controller.winch_1.damping": DAMPING})


def packaged(what: str, experiment: dw.Experiment, folder: Path) -> tuple[Host, Block]:
    made = block(what, experiment)
    (folder / what).mkdir()
    flags = find_compiler().command
    return Host(build(folder / what, c_package(made, made.name, ABOUT), made.name, flags), made.name, made), made


def names(variables: Any) -> list[str]:
    return [variable.name for variable in variables]


def test_packages_of_plant_and_controller_are_the_closed_loop(tmp_path: Path) -> None:
    experiment = heavy()
    (plant, of_plant), (controller, of_controller) = (
        packaged(what, experiment, tmp_path) for what in ("plant", "controller")
    )
    sensed, outputs, rows = names(of_controller.inputs)[:-3], names(of_plant.outputs), []
    assert sensed == ["x", "v", "F1", "F2", "omega_1", "omega_2"]
    given = plant.state[len(of_plant.states) :]
    read = [outputs.index(SHAFTS.get(name, name)) for name in sensed]
    assert plant.prepare() == plant.reset() == 0
    for reference in exogenous_signals(experiment)[:, :3]:
        rows.append(given.copy())
        controller.input[:] = [*given[read], *reference]
        assert controller.step() == 0
        plant.input[:2] = controller.output[:2]
        assert plant.step() == 0
    run = dw.simulate(experiment)
    for name, column in (("x", "x"), ("F2", "F2"), ("rope_1.sag.depth", "sag_1"), ("omega_1", "omega_1")):
        ours = np.array(rows)[:, outputs.index(name)]
        np.testing.assert_allclose(ours, run[column], rtol=1e-9, atol=1e-9 * np.abs(run[column]).max(), err_msg=name)


def test_drum_speeds_of_a_package_are_positive_where_their_drum_retrieves_rope(tmp_path: Path) -> None:
    """At the reference's speed drum 1 retrieves, drum 2 pays out, and neither is damped; a faster one is."""
    controller, made = packaged("controller", heavy(), tmp_path)
    assert all("positive where it retrieves rope" in made.inputs[place].description for place in (4, 5))
    x, v, radius = 10.0, 0.5, 0.8
    moving = np.array([x, v, 1000.0, 1000.0, v / radius, -v / radius, x, v, 0.0])

    def torques(**faster: float) -> np.ndarray:
        assert controller.reset() == 0
        controller.input[:] = moving
        for name, more in faster.items():
            controller.input[names(made.inputs).index(name)] += more
        assert controller.step() == 0
        return controller.output[:2].copy()

    plain, undamped = torques(), block("controller", dw.override(heavy(), dict.fromkeys(DAMPINGS, 0.0)))
    assert names(undamped.inputs) == ["x", "v", "F1", "F2", "x_ref", "v_ref", "a_ref"]
    given = np.delete(moving, [4, 5])
    first = np.array(undamped.step(values(undamped.states), given, values(undamped.parameters))[1]).ravel()
    np.testing.assert_allclose(plain, first[:2], rtol=1e-12)
    np.testing.assert_allclose(torques(omega_1=0.01) - plain, [-0.01 * DAMPING, 0.0], atol=1e-9)
    np.testing.assert_allclose(torques(omega_2=0.01) - plain, [0.0, -0.01 * DAMPING], atol=1e-9)


DAMPINGS = ("controller.winch_1.damping", "controller.winch_2.damping")


@pytest.mark.slow
def test_packages_step_as_the_interpreter_with_more_segments(tmp_path: Path) -> None:
    keys = {"plant__rope_1__segments": 4, "plant__rope_2__segments": 1, "simulation__substeps": 16}
    for what in ("plant", "closed-loop"):
        host, made = packaged(what, heavy(**keys), tmp_path)
        states, inputs = plausible(made, 50)
        states = values(made.states) + 1e-5 * (states - values(made.states))  # a rope bears no metres
        expected = interpreted(made, states, inputs, values(made.parameters))
        for state, given, after in zip(states, inputs, expected, strict=True):
            host.state[: len(state)], host.input[:] = state, given
            assert host.step() == 0
            np.testing.assert_allclose(host.state, after, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("version", [2, 3])
def test_an_fmu_of_the_plant_moves_as_its_block(version: Any, tmp_path: Path) -> None:
    export_fmu(heavy(), tmp_path / "plant.fmu", block="plant", fmi=version)
    fmu, made = Instance(tmp_path / "plant.fmu"), block("plant", heavy())
    state, outputs = values(made.states), np.zeros(0)
    torques = dict(zip(names(made.inputs), values(made.inputs), strict=True)) | {"tau_1": 40.0, "tau_2": 25.0}
    fmu.set(**torques)
    for _ in range(20):
        fmu.step()
        state, outputs = (
            np.array(f).ravel() for f in made.step(state, list(torques.values()), values(made.parameters))
        )
    assert fmu.get("x", "rope_1.sag.depth", "motor_2.omega", "F1") == pytest.approx(
        [outputs[names(made.outputs).index(name)] for name in ("x", "rope_1.sag.depth", "motor_2.omega", "F1")]
    )


@pytest.mark.parametrize("gains", all_but(["power_law_in_site"], list(GAINS)))
def test_a_shove_beyond_the_loops_linear_range_fades(gains: str) -> None:
    """10 kN for 0.3 s throw the vehicle to 0.2 m/s; describing functions doubt the loop from 0.1 m/s on."""
    times, forces = [0.0, 20.0, 20.001, 20.3, 20.301, 50.0], [0.0, 0.0, -10e3, -10e3, 0.0, 0.0]
    shove = {f"disturbance.force.{key}": value for key, value in (("times", times), ("values", forces), ("unit", "N"))}
    run = dw.simulate(dw.override(dw.load(GAINS[gains]), {**shove, "simulation.duration": 30.0}))
    t, off = run["t"], np.abs(run["v"] - run["v_ref"])
    assert off[t < 20].max() < 0.01
    assert off[t < 21].max() > 0.2
    assert off[t > 26].max() < 0.02


def test_a_linear_speed_calms_the_drums_after_a_shove() -> None:
    """5 kN for 3 s: at the speed errors that they leave, a power of it keeps the drums oscillating at 10 Hz.

    The governor of the tension commands bounds the tension either way, and calms the power law as well.
    """
    times, forces = [0.0, 2.0, 2.001, 5.0, 5.001, 50.0], [0.0, 0.0, -5e3, -5e3, 0.0, 0.0]
    shove = {f"disturbance.force.{key}": value for key, value in (("times", times), ("values", forces), ("unit", "N"))}
    shoved = dw.override(dw.load(GAINS["power_law_in_site"]), {**shove, "simulation.duration": 12.0})
    power, linear = (
        dw.simulate(dw.override(shoved, {"controller.nftsm.linear_speed": speed})).metrics for speed in (0.0, 0.01)
    )
    assert max(linear.peak_tension, power.peak_tension) < shoved.controller.limits.tension_max
    assert 1.3 * linear.chatter < power.chatter
    assert linear.mse < 1.05 * power.mse
