"""Remarks on runs: each said where its cause is, and none of the paper's own run."""

import math
from dataclasses import replace

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.simulation.analysis.remarks import RemarkLimits, defaults_left, remarks, unusual_values
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

SHORT = override(case(2), {"simulation.duration": 1.0})


def test_the_papers_run_needs_no_remark() -> None:
    assert not list(remarks(simulate(SHORT)))


def test_slack_saturation_and_chatter_are_said() -> None:
    result = simulate(SHORT)
    bad = replace(result.metrics, slack_share=0.02, saturated_share=0.5, torque_saturated_share=0.64, chatter=50.0)
    said = "; ".join(remarks(replace(result, metrics=bad)))
    for words in (
        "slack in 2 %",
        "beyond its limit in 50 %",
        "torque is at its limit in 64 %",
        "jump by 50 N a sample, 5 % of",
    ):
        assert words in said
    assert not list(remarks(replace(result, metrics=replace(bad, slack_share=0.0)), RemarkLimits(0.1, 0.9, 0.9)))


def test_a_loop_that_is_unstable_at_small_amplitudes_is_said() -> None:
    """23.6 ms more of delay are borne, 40 are not (`test_margins`)."""
    late = override(SHORT, {"simulation.delay_samples": 40, "plant.winch_1.inertia": 2.5})
    run = simulate(late)
    lost = replace(run, outcome="left_track", metrics=replace(run.metrics, slack_share=math.nan, chatter=math.nan))
    for each in (run, lost):
        assert any("unstable at small amplitudes: at rest at 25 m" in words for words in remarks(each))


def test_defaults_that_do_not_follow_are_said() -> None:
    assert defaults_left(SHORT) == []
    other = override(
        SHORT, {"plant.vehicle.height": 1.0, "plant.winch_1.drum_radius": 0.4, "controller.winch_1.kp": 1e-3}
    )
    assert defaults_left(other) == [
        "plant.vehicle.drag_area = 6: still the default, not following plant.vehicle.height; if meant, give it",
        (
            "plant.winch_1.inertia = 1.8, controller.winch_1.ki = 0.02: still the defaults, "
            "not following plant.winch_1.drum_radius; if meant, give it"
        ),
    ]
    (said,) = defaults_left(other, {"plant.vehicle.drag_area", "controller.winch_1.ki"})
    assert said.startswith("plant.winch_1.inertia = 1.8: still the default")
    (said,) = defaults_left(override(SHORT, {"plant.vehicle.mass": 3000.0}))
    assert said.startswith("plant.vehicle.normal_force = 4900: still the default, not following plant.vehicle.mass")
    both = override(SHORT, {f"plant.winch_{number}.gear_ratio": 20.0 for number in (1, 2)})
    assert defaults_left(both) == [
        (
            "controller.winch_*.kp = 0.0005, controller.winch_*.ki = 0.02: still the defaults, "
            "not following plant.winch_*.gear_ratio; if meant, give it"
        )
    ]
    assert defaults_left(override(SHORT, {"plant.rope_2.area": 3e-4})) == [
        "plant.rope_2.diameter = 0.024: still the default, not following plant.rope_2.area; if meant, give it"
    ]


def test_values_of_likely_another_unit_are_said_and_those_of_heavy_machines_are_not() -> None:
    wrong = {"plant.rope_1.modulus": 80.0, "plant.winch_2.drum_radius": 300.0, "plant.vehicle.mass": 3.0}
    said = unusual_values(override(SHORT, wrong))
    assert [words.partition(" ")[0] for words in said] == [
        "plant.vehicle.mass",
        "plant.rope_1.modulus",
        "plant.winch_2.drum_radius",
    ]
    assert said[0] == "plant.vehicle.mass = 3 kg is 0.0003 times the default, 10000 kg: see to its unit"
    assert not unusual_values(load_ensemble("site").experiment)
