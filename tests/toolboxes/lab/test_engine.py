"""The engine runs what `simulate` runs: position by position, signal by signal."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.toolboxes.lab.content import Content
from dualwinch.toolboxes.lab.wasm.settings import MOTIONS
from tests.toolboxes.lab.in_node import content_of, needs_node, of_id, run_in_node

pytestmark = [pytest.mark.external, needs_node]

NEAR = 1e-9
"""Difference in m that positions may have."""

USUAL = "fando-nftsm"
OTHERS = (
    "pid-cascade",
    "mpc",
    "adrc+self-calibrating-kalman",
    "fando-nftsm+scheduled-preload",
    "fando-nftsm+two-sided",
)
HEAVY = "fando-nftsm+site"
HEAVY_TUNED = "fando-nftsm+self-calibrating-kalman+proportional-tension+site"

NOISE = {"sensors.position_noise": 5e-4, "sensors.speed_noise": 2e-3, "sensors.tension_noise": 10.0}
SEA = {"disturbance.current_sigma": 0.05, "disturbance.normal_force_sigma": 0.1, "sensors.position_drift": 1e-4}

ALTERED: dict[str, dict[str, Any]] = {
    "noise": NOISE,
    "sea": SEA | {"disturbance.current_time": 5.0, "sensors.position_drift_time": 30.0},
    "a seed of 64 bits": NOISE | {"simulation.seed": 2**63 + 12345},
    "a sample's delay": {"simulation.delay_samples": 1},
    "seven samples' delay": {"simulation.delay_samples": 7, "controller.observer.l0": 1.0},
    "jitter": {"simulation.jitter": 1e-4},
    "outages": {"sensors.outage_length": 0.3, "sensors.outage_period": 4.0},
    "motors": {"actuator.motor.time_constant": 5e-3},
    "load cells with lag": {"sensors.load_cell_time_constant": 2e-3, "sensors.tension_noise": 10.0},
    "a jerk limit": {"reference.jerk_limit": 0.05},
    "another speed": {"reference.speed": 1.2, "reference.cruise_until": 25.0, "simulation.duration": 45.0},
    "a uniform start with a jerk limit": {"reference.kind": "uniform", "reference.jerk_limit": 0.5},
    "another idea of the vehicle": {"controller.nominal.mass": 9e3, "controller.nominal.friction_coefficient": 0.2},
    "water that moves along": {"plant.vehicle.added_mass": 800.0},
    "another sample time": {"simulation.sample_time": 5e-4, "disturbance.vortex": True},
    "a rope that goes slack": {"controller.coordination.preload": 900.0, "plant.vehicle.mass": 1.4e4},
}


@pytest.fixture(scope="module")
def made() -> Content:
    return content_of(*OTHERS, HEAVY, HEAVY_TUNED)


def asked(settings: dict[str, Any]) -> dict[str, Any]:
    """A request of what an experiment is told."""
    values = {key: value for key, value in settings.items() if key != "simulation.seed"}
    if "reference.kind" in values:
        values["reference.kind"] = MOTIONS.index(values["reference.kind"])
    return {
        "structure": USUAL,
        "values": {key: float(value) for key, value in values.items()},
        "seed": str(settings.get("simulation.seed", 0)),
    }


def told(settings: dict[str, Any]) -> dw.Experiment:
    """The experiment of settings, with motors where they lag."""
    motor = {"actuator.kind": "motor"} if "actuator.motor.time_constant" in settings else {}
    return dw.override(dw.case(2), motor | settings)


def check(answer: dict[str, Any], result: dw.Result, near: float = NEAR) -> None:
    """Compare an answer with a result."""
    assert answer["outcome"] == result.outcome
    assert answer["until"] == pytest.approx(result.end_time)
    assert set(answer["columns"]) >= set(result.columns)
    for name, column in result.columns.items():
        if name == "x":
            np.testing.assert_allclose(answer["columns"][name], column, rtol=0, atol=near)
        else:
            scale = max(np.abs(column).max(), 1e-6)
            np.testing.assert_allclose(answer["columns"][name], column, rtol=0, atol=1e-6 * scale, err_msg=name)
    for name, value in dict(result.metrics).items():
        expected = None if np.isnan(value) else pytest.approx(value, rel=1e-6, abs=1e-12)
        assert answer["metrics"][name] == expected, name


def test_the_cases_are_those_of_simulate(made: Content, tmp_path: Path) -> None:
    requests = [{"structure": case["structure"], "values": case["values"]} for case in made.catalogue["cases"]]
    answers = run_in_node(made, tmp_path, requests)
    experiments = [*(dw.case(number) for number in (1, 2, 3, 4)), of_id(HEAVY).experiment]
    for experiment, answer in zip(experiments, answers, strict=True):
        check(answer, dw.simulate(experiment))


def test_numbers_act_as_they_do_in_simulate(made: Content, tmp_path: Path) -> None:
    answers = run_in_node(made, tmp_path, [asked(settings) for settings in ALTERED.values()])
    plain = dw.simulate(dw.case(2))
    for settings, answer in zip(ALTERED.values(), answers, strict=True):
        result = dw.simulate(told(settings))
        check(answer, result)
        same = len(result["x"]) == len(plain["x"]) and np.allclose(result["x"], plain["x"], rtol=0, atol=NEAR)
        assert not same, settings  # or nothing was compared


def test_other_structures_are_those_of_simulate(made: Content, tmp_path: Path) -> None:
    values = made.catalogue["cases"][3]["values"]
    answers = run_in_node(made, tmp_path, [{"structure": name, "values": values} for name in OTHERS])
    chosen = {structure["id"]: structure["settings"] for structure in made.catalogue["structures"]}
    for name, answer in zip(OTHERS, answers, strict=True):
        check(answer, dw.simulate(dw.override(dw.case(4), chosen[name])))


def test_a_tuned_controller_on_the_heavy_machine_is_that_of_simulate(made: Content, tmp_path: Path) -> None:
    """In a longer run, speeds at the edge of a step are rounded differently, which moves the vehicle by micrometres."""
    (case,) = (case for case in made.catalogue["cases"] if case["id"] == "case-site")
    sensors = {"sensors.load_cell_time_constant": 1e-3, "sensors.drum_speed_resolution": 7e-4}
    settings = sensors | {"simulation.duration": 2.0}
    (answer,) = run_in_node(made, tmp_path, [{"structure": HEAVY_TUNED, "values": case["values"] | settings}])
    check(answer, dw.simulate(dw.override(of_id(HEAVY_TUNED).experiment, settings)))


def test_a_drawn_machine_is_that_of_the_ensemble(made: Content, tmp_path: Path) -> None:
    """Its controller assumes the machine it was designed for."""
    rig, index = load_ensemble("rig"), 3
    drawn, keys = made.catalogue["rig"], made.catalogue["keys"]
    machine = {key: numbers[index] for key, numbers in drawn["machines"].items()}
    nominal = {key: keys[key]["default"] for key in machine if key.startswith("plant.")}
    request = {
        "structure": USUAL,
        "values": drawn["values"] | machine,
        "nominal": nominal,
        "seed": drawn["seeds"][index],
    }
    (answer,) = run_in_node(made, tmp_path, [request])
    scenario = rig.scenario(index, drawn["seed"])
    check(answer, dw.simulate(scenario.experiment, nominal=scenario.nominal))


def test_a_run_that_ends_early_is_a_result(made: Content, tmp_path: Path) -> None:
    """A soft, undamped position loop swings past the end of the rail."""
    settings = {
        "reference.kind": "uniform",
        "reference.speed": 1.98,
        "plant.vehicle.drag_coefficient": 0.0,
        "plant.vehicle.friction_coefficient": 0.0,
        "controller.pid_cascade.kp1": 50.0,
        "controller.pid_cascade.kp2": 0.02,
    }
    (answer,) = run_in_node(made, tmp_path, [asked(settings) | {"structure": "pid-cascade"}])
    result = dw.simulate(dw.override(dw.case(1, "pid-cascade"), settings))
    assert answer["outcome"] == result.outcome == "left_track"
    assert answer["until"] == pytest.approx(result.end_time)
    np.testing.assert_allclose(answer["columns"]["x"], result["x"], rtol=0, atol=NEAR)
    assert set(answer["metrics"].values()) == {None}


def test_rows_are_kept_as_often_as_asked(made: Content, tmp_path: Path) -> None:
    every, seventh, none, wrong = run_in_node(
        made, tmp_path, [asked({}) | {"stride": stride} for stride in (1, 7, 0, 5000)]
    )
    np.testing.assert_array_equal(seventh["columns"]["F1"], every["columns"]["F1"][::7])
    assert not none["columns"]
    assert none["metrics"] == every["metrics"]
    assert wrong["error"] == "stride 5000: must be 0 to 1024"


def test_what_is_unknown_is_an_error(made: Content, tmp_path: Path) -> None:
    requests = [{"structure": "pid"}, {"structure": USUAL, "values": {"plant.mass": 1}}]
    structure, key, length = run_in_node(made, tmp_path, [*requests, asked({"simulation.duration": 1e9})])
    assert structure["error"].startswith("unknown structure 'pid': must be fando-nftsm, ")
    assert key["error"] == "fando-nftsm: unknown key 'plant.mass'"
    assert "must be 1 to 5000000; change simulation.duration" in length["error"]
