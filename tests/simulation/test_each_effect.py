"""What each effect of a machine and each demanding part is to all that runs a loop: engines, lanes and derivatives."""

from functools import cache

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.simulation.experiment import EngineName
from tests.controllers.estimators.test_self_calibrating_kalman import rig
from tests.controllers.laws.predictive.test_mpc import HURRIED
from tests.simulation.loop.test_imperfections import ALL, imperfect
from tests.simulation.loop.test_site_effects import EFFECTS, machine
from tests.simulation.loop.test_slow_parts import calibrating
from tests.simulation.test_heavy_plants import DAMPING, heavy, noisy
from tests.test_own_actuators import ACTUATED
from tests.tiers import all_but, mostly_slow

SILENT = ALL | {
    "sensors.outage_length": 0.1,
    "sensors.encoder_zero_1": 1e-3,
    "sensors.encoder_counts": 4096,
    "controller.estimator": "calibrating-kalman",
    "sensors.position_drift": 1e-4,
}
OUTAGES = {"sensors.outage_length": 0.1, "sensors.outage_period": 0.4}
DAMPED = {"damping": 20.0, "shaping": 1.5}
SHAPED = {f"controller.winch_{winch}.{name}": size for winch in (1, 2) for name, size in DAMPED.items()}
MACHINES = {
    "shaped commands": lambda: dw.override(dw.case(4), SHAPED | {"simulation.duration": 0.05}),
    "friction, slope and steps": lambda: machine(EFFECTS, 0.1),
    "slow part": lambda: calibrating(3),
    "imperfect": lambda: imperfect(SILENT, duration=0.3),
    "imperfect, late samples": lambda: imperfect(SILENT, duration=0.3, jitter=2e-4),
    "site": noisy,
    "MPC": lambda: dw.override(HURRIED, {"simulation.duration": 0.6}),
    "missing readings": lambda: dw.override(rig(1.0).experiment, OUTAGES),
    **{
        name: lambda actuator=actuator: dw.override(dw.case(4, actuator=actuator), {"simulation.duration": 1.0})
        for name, actuator in ACTUATED.items()
    },
}
SLOW = ("MPC", "missing readings")
"""Their code takes long to compile, by CasADi's generator minutes."""


@cache
def interpreted(name: str) -> dw.Result:
    """The run of a machine by CasADi's interpreter."""
    return dw.simulate(MACHINES[name](), engine="interpreter")


@pytest.mark.parametrize(
    ("name", "engine"),
    mostly_slow(
        (
            (name, engine)
            for name in MACHINES
            for engine in ("compiled", "casadi")
            if name not in SLOW or engine != "casadi"
        ),
        lambda row: row[1] == "compiled" and row[0] not in SLOW,
    ),
)
def test_engines_agree(name: str, engine: EngineName) -> None:
    ours, theirs = dw.simulate(MACHINES[name](), engine=engine), interpreted(name)
    assert ours.outcome == theirs.outcome == "completed"
    for column, values in theirs.columns.items():
        scale = max(1.0, np.nanmax(np.abs(values)))
        np.testing.assert_allclose(ours[column], values, rtol=1e-9, atol=1e-9 * scale, err_msg=column)


@pytest.mark.parametrize("name", all_but(["limited"], ["limited", "friction, slope and steps", *SLOW]))
def test_lanes_are_single_runs(name: str) -> None:
    experiment = MACHINES[name]()
    lanes, alone = dw.rollout([], [[]], [experiment, experiment], stride=1), dw.simulate(experiment)
    for lane in (0, 1):
        assert np.abs(lanes.columns["x"][0, lane] - alone["x"]).max() < 1e-9
        for metric, value in dict(alone.metrics).items():
            assert lanes.metrics[metric][0, lane] == pytest.approx(value, rel=1e-6, nan_ok=True), metric


SMOOTH = {"controller.coordination.preload": 5000.0, "simulation.integrator": "exponential"}
EXACT = {"sensors.position_resolution": 0.0, "sensors.encoder_counts": 0}
DIFFERENTIATED = {
    "heavy ropes": (
        lambda: heavy(0.3, controller__coordination__preload=5000.0),
        {
            "controller.winch_1.damping": DAMPING,
            "plant.rope_1.mass_per_length": 2.36,
            "plant.rope_2.submerged_weight": 20.2,
            "plant.winch_1.gear_stiffness": 1.4e6,
            "plant.winch_2.rotor_inertia": 0.02,
            "plant.track.roller_spacing": 1.0,
        },
        ("mse", "peak_tension", "energy"),
    ),
    "MPC": (
        lambda: dw.override(dw.case(4, "mpc"), SMOOTH | {"simulation.duration": 3.0}),
        {"controller.mpc.position": 5e-4, "controller.mpc.speed": 1e-2},
        ("mse",),
    ),
    "self-calibrating filter": (lambda: rig(2.0).having(EXACT), {"controller.kalman.bandwidth": 20.0}, ("mse",)),
}
"""Experiment or scenario, values of some numbers, and figures of merit without kinks."""


@pytest.mark.slow
@pytest.mark.parametrize("name", DIFFERENTIATED)
def test_gradients_are_those_of_central_differences(name: str) -> None:
    build, point, metrics = DIFFERENTIATED[name]
    keys, values = list(point), np.array([*point.values()])
    slopes = dw.sensitivities(keys, [values], [build()], stride=0)
    steps = 1e-4 * np.diag(values)
    around = dw.rollout(keys, np.concatenate([values + steps, values - steps]), [build()])
    for metric in metrics:
        above, below = around.metrics[metric][:, 0].reshape(2, -1)
        expected = (above - below) / (2e-4 * values)
        np.testing.assert_allclose(slopes.gradients[metric][0, 0], expected, rtol=1e-4, err_msg=metric)
