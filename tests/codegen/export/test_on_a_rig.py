"""The exported C controller on drawn machines of the rig: around the independent plant, with all that is in between."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from math import exp, pi
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.embedded.host import Host, build
from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.export.package import Provenance, c_package
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.blocks import block
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import exogenous_names
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from tests.oracle.collocation import Collocation
from tests.oracle.plant import Hold, Plant
from tests.oracle.sampled import profile, quantise
from tests.oracle.values import DEFAULTS

METRE = 1e-8
RIG = load_ensemble("rig")
NOMINAL = RIG.experiment.plant
BEGINNING = {
    "controller.estimator": "self-calibrating-kalman",
    "sensors.outage_length": 0.1,
    "sensors.outage_period": 0.5,
    "simulation.duration": 1.5,
    "simulation.integrator": "rk4",
    "simulation.substeps": 64,
}


def machine(index: int, silence: str) -> Experiment:
    """A draw of the rig, its beginning."""
    return override(RIG.scenario(index, seed=7).experiment, {**BEGINNING, "sensors.outage": silence})


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> Callable[[], Host]:
    """New instances of the exported controller, which knows the data sheets and no machine in particular."""
    law = block("controller", machine(0, "held"), NOMINAL)
    inputs = ["x", "v", "F1", "F2", "theta_1", "theta_2", "x_ref", "v_ref", "a_ref"]
    assert [variable.name for variable in law.inputs] == inputs
    package = c_package(law, "law", Provenance("dualwinch", "test", "2026-01-01"))
    library = build(tmp_path_factory.mktemp("law"), package, "law", find_compiler().command)
    return lambda: Host(library, "law", law)


class Motor:
    """A first-order lag behind a command that is held."""

    def __init__(self, time: float, torque: float) -> None:
        self.time, self.torque = time, torque

    def mean(self, asked: float, duration: float) -> float:
        """What it gives on average until the next sample."""
        gone, way = exp(-duration / self.time), asked - self.torque
        self.torque = asked - gone * way
        return asked - self.time / duration * (1 - gone) * way


class Machine:
    """Everything between two samples of a controller: sensors, delay, motors and the plant, each of a draw."""

    def __init__(self, experiment: Experiment) -> None:
        values: Mapping[str, Any] = leaves(experiment)
        self.values, self.plant = values, Plant({key: values.get(key, start) for key, start in DEFAULTS.items()})
        self.solver = Collocation(self.plant)
        self.winches = self.plant.winch_1, self.plant.winch_2
        preload = values["controller.coordination.preload"]
        self.position, self.speed = self.plant.at_rest(preload, -values["sensors.position_bias"])
        rest = [winch.drum_radius / winch.gear_ratio * preload / 2 for winch in self.winches]
        self.queue = deque([rest] * values["simulation.delay_samples"])
        self.motors = [Motor(values["actuator.motor.time_constant"], torque) for torque in rest]
        self.read_x, self.late = 0.0, 0.0

    def sense(self, t: float, draws: Mapping[str, float]) -> list[float]:
        """Position, speed, both tensions, both drum angles, as the sensors say."""
        sensors = {key.removeprefix("sensors."): value for key, value in self.values.items()}
        off = sensors["position_bias"] + sensors["position_drift"] * draws["noise.drift"]
        x = self.position[0] + off + sensors["position_noise"] * draws["noise.position"]
        if not draws["noise.silent"]:
            self.read_x = quantise(x, sensors["position_resolution"])
        elif sensors["outage"] == "missing":
            self.read_x = float("nan")
        said = [self.read_x, self.speed[0] + sensors["speed_noise"] * draws["noise.speed"]]
        for i, tension in enumerate(self.plant.tensions(self.position, self.speed, t), start=1):
            noise = sensors["tension_noise"] * draws[f"noise.tension_{i}"]
            said.append(tension + sensors[f"load_cell_error_{i}"] * tension + sensors[f"load_cell_zero_{i}"] + noise)
        for i, winch in enumerate(self.winches, start=1):
            count = 2 * pi / (winch.gear_ratio * sensors["encoder_counts"])
            said.append(quantise(self.position[i] + sensors[f"encoder_zero_{i}"] / winch.drum_radius, count))
        return said

    def move(self, t: float, torques: Sequence[float], draws: Mapping[str, float]) -> None:
        """Go on to the next sample, whenever it comes."""
        late = self.values["simulation.jitter"] * draws["noise.lateness"]
        Ts = self.values["simulation.sample_time"]
        duration = Ts + late - self.late
        self.queue.append(list(torques))
        asked = zip(self.motors, self.queue.popleft(), strict=True)
        held = [motor.mean(torque, Ts) for motor, torque in asked]
        given = self.plant.given(held, self.position, self.speed, duration)
        hold = Hold(*given, current=draws["current"], load=draws["normal_force_variation"])
        self.position, self.speed = self.solver.advance(t, duration, self.position, self.speed, hold)
        self.late = late


def run(experiment: Experiment, controller: Host) -> NDArray[np.float64]:
    """Positions, the exported controller around the machine."""
    machine, names = Machine(experiment), exogenous_names(experiment.controller)
    found = np.empty(experiment.samples)
    for k, row in enumerate(exogenous_signals(experiment)):
        draws, t = dict(zip(names, row, strict=True)), k * 1e-3
        found[k] = machine.position[0]
        controller.input[:] = [*machine.sense(t + machine.late, draws), *profile(t)]
        assert controller.step() == 0
        machine.move(t + machine.late, controller.output[:2].tolist(), draws)
    return found


@pytest.mark.parametrize(("index", "silence"), [pytest.param(0, "held", marks=pytest.mark.slow), (1, "missing")])
def test_the_machine_goes_where_simulate_says(controller: Callable[[], Host], index: int, silence: str) -> None:
    experiment = machine(index, silence)
    assert experiment.plant.winch_1.radius_error
    ours, theirs = simulate(experiment, nominal=NOMINAL), run(experiment, controller())
    assert ours.outcome == "completed"
    assert np.ptp(theirs) > 0.1
    assert np.abs(ours["x"] - theirs).max() <= METRE
