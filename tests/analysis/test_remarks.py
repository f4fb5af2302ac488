"""Remarks on runs: each said where its cause is, and none of the paper's own run."""

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from dualwinch.analysis.linear_loop import linear_open_loop
from dualwinch.analysis.margins import margins
from dualwinch.analysis.remarks import (
    RemarkLimits,
    defaults_left,
    delay_remarks,
    ensemble_remarks,
    loop_remarks,
    remarks,
    without_effect,
)
from dualwinch.analysis.resonance import matched_damping
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.config.experiment_file import load
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

SHORT = override(case(2), {"simulation.duration": 1.0})
STEEP = override(
    case(4),
    {
        "controller.nftsm.beta": 0.13,
        "controller.nftsm.eta": 0.94,
        "controller.nftsm.k": 13.6,
        "controller.nftsm.phi": 0.01,
        "controller.observer.l0": 28.0,
    },
)


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


def test_an_unstable_loop_is_said_first_and_no_preload_is_advised() -> None:
    late = override(SHORT, {"simulation.delay_samples": 40, "plant.winch_1.inertia": 2.5})
    run = simulate(late)
    slack = replace(run, metrics=replace(run.metrics, slack_share=0.8))
    first, *others = remarks(slack)
    assert first.startswith("unstable at small amplitudes")
    assert "a rope is slack in 80 % of the samples" in others
    stable = simulate(SHORT)
    (said,) = remarks(replace(stable, metrics=replace(stable.metrics, slack_share=0.8)))
    assert said == "a rope is slack in 80 % of the samples: increase the preload or reduce the speed"


def test_defaults_that_do_not_follow_are_said() -> None:
    assert defaults_left(SHORT) == []
    other = override(
        SHORT, {"plant.vehicle.height": 1.0, "plant.winch_1.drum_radius": 0.6, "controller.winch_1.kp": 1e-3}
    )
    assert defaults_left(other) == [
        "plant.vehicle.drag_area = 6: still the default, not following plant.vehicle.height; if intended, give it",
        (
            "plant.winch_1.inertia = 1.8, controller.winch_1.ki = 0.02: still the defaults, "
            "not following plant.winch_1.drum_radius; if intended, give them"
        ),
    ]
    meant = {"plant.vehicle.drag_area", "plant.vehicle.drag_coefficient", "controller.winch_1.ki"}
    (said,) = defaults_left(other, meant)
    assert said.startswith("plant.winch_1.inertia = 1.8: still the default")
    (said,) = defaults_left(override(SHORT, {"plant.vehicle.mass": 3000.0}))
    assert said.startswith("plant.vehicle.normal_force = 4900: still the default, not following plant.vehicle.mass")
    both = override(SHORT, {f"plant.winch_{number}.gear_ratio": 30.0 for number in (1, 2)})
    assert defaults_left(both) == [
        (
            "controller.winch_*.kp = 0.0005, controller.winch_*.ki = 0.02: still the defaults, "
            "not following plant.winch_*.gear_ratio; if intended, give them"
        )
    ]
    assert defaults_left(override(SHORT, {"plant.rope_2.area": 4e-4})) == [
        "plant.rope_2.diameter = 0.024: still the default, not following plant.rope_2.area; if intended, give it"
    ]


def test_tensions_of_the_papers_ropes_and_motors_are_said_on_others_in_one_line() -> None:
    sizes = {f"plant.{rope}.area": 1e-4 for rope in ("rope_1", "rope_2")} | {"plant.winch_1.drum_radius": 0.5}
    other = override(SHORT, sizes)
    words = (
        "controller.coordination: preload = 2000, tension_min = 200, tension_max = 6000 N: still of the paper's ropes "
        "and motors, not following plant.rope_*.area, plant.winch_1.drum_radius; if intended, give them"
    )
    assert words in defaults_left(other)
    given = {f"controller.coordination.{name}" for name in ("preload", "tension_max")}
    (said,) = (line for line in defaults_left(other, given) if "coordination" in line)
    assert said.startswith("controller.coordination: tension_min = 200 N: still")
    less = override(SHORT, {"plant.winch_1.drum_radius": 0.6})
    assert not any("coordination" in line for line in defaults_left(less)), "no more than 1.5 times"


def test_mass_that_ropes_of_a_short_track_do_not_have_is_said() -> None:
    key = "plant.rope_1.shortest_mass"
    rig = override(SHORT, {"plant.track.length": 6.0, "plant.rope_1.mass_per_length": 0.006})
    words = f"{key} = 6 m: still the default, and ropes are 3.5 m long mid-track; if intended, give it"
    assert words in defaults_left(rig)
    assert not any(key in line for line in defaults_left(rig, {key}))
    both = defaults_left(override(rig, {"plant.rope_2.mass_per_length": 0.006}))
    assert words.replace("rope_1", "rope_*") in both


def test_a_drag_area_beside_the_papers_coefficient_is_said() -> None:
    other = override(SHORT, {"plant.vehicle.drag_area": 2.0})
    diameter, coefficient = defaults_left(other, {"plant.vehicle.drag_area"})
    assert diameter == (
        "plant.vehicle.diameter = 2, plant.vehicle.height = 3: still the defaults, not following "
        "plant.vehicle.drag_area; if intended, give them"
    )
    assert coefficient == (
        "plant.vehicle.drag_coefficient = 0.3: still the paper's, times drag_area = 2 m^2; where that is a drag area "
        "Cd A, give drag_coefficient = 1"
    )
    assert len(defaults_left(other, {"plant.vehicle.drag_area", "plant.vehicle.drag_coefficient"})) == 1


def test_a_drum_that_may_oscillate_is_said_with_the_damping_that_matches_its_rope() -> None:
    site = load_ensemble("site").experiment
    (said,) = [words for words in loop_remarks(site) if "may oscillate" in words]
    matched = matched_damping(site, int(said.split("drum ")[1][0]))
    assert f".damping = 0, where {matched:.3g} matches its rope" in said
    damped = override(site, {f"controller.winch_{winch}.damping": matched for winch in (1, 2)})
    assert not [words for words in loop_remarks(damped) if "matches" in words]


def test_remarks_on_an_ensemble_are_of_its_worst_scenario_and_its_mean() -> None:
    good = {"slack_share": 0.0, "peak_tension": 5e3, "chatter": 1.0, "saturated_share": 0.0}
    good["torque_saturated_share"] = 0.5
    worst = good | {"slack_share": 0.125, "saturated_share": 0.5}

    def said(**kinds: dict[str, float]) -> list[str]:
        statistics = {name: {kind: of[name] for kind, of in kinds.items()} for name in good}
        return list(ensemble_remarks(case(2), statistics, completed=True))

    assert not said(worst=good, mean=good)
    (slack,) = said(worst=worst, mean=good)
    assert slack.startswith("a rope is slack in 12.5 % of the samples of the worst scenario: ")


def test_tensions_far_beyond_their_limit_are_said() -> None:
    run = simulate(SHORT)
    pulled = replace(run, metrics=replace(run.metrics, peak_tension=12e3))
    assert "a rope is pulled by up to 1.2e+04 N, 2 times tension_max" in list(remarks(pulled))
    assert run.metrics.peak_tension < 9e3


@pytest.mark.slow
def test_a_loop_that_tolerates_little_further_delay_is_said_to_be() -> None:
    """Damped drums of heavy winches behind a gearbox: by two samples, at a motor's torque; without lead by one."""
    assert not list(delay_remarks(case(4), 5e-3))
    tuned = load(Path(__file__).parents[1] / "power_law_in_site.toml")
    (said,) = delay_remarks(tuned, 5e-3)
    least = margins(linear_open_loop(tuned, 25.0, opening="tau_1")).delay
    late = override(tuned, {"controller.winch_1.lead": 0.0, "controller.winch_2.lead": 0.0})
    assert 1.8 * margins(linear_open_loop(late, 25.0, opening="tau_1")).delay < least < 3 * tuned.simulation.sample_time
    assert re.match(
        rf"the loop tolerates {1e3 * least:.2g} ms of further delay at (tau_1|tau_2|torques), at rest", said
    )
    assert not list(delay_remarks(tuned, least / 2))


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"disturbance.vortex_amplitude": 3.0}, "disturbance.vortex_amplitude = 3: no effect"),
        ({"plant.vehicle.bristle_damping": 2.0}, "plant.vehicle.bristle_damping = 2: no effect"),
        (
            {"plant.winch_1.gear_damping": 5.0, "plant.winch_2.gear_damping": 5.0},
            "plant.winch_*.gear_damping = 5: no effect",
        ),
        (
            {"plant.winch_1.gear_damping": 5.0, "plant.winch_2.gear_damping": 6.0},
            "plant.winch_1.gear_damping = 5: no effect",
        ),
    ],
)
def test_values_of_absent_effects_are_said_to_have_none(settings: dict[str, float], said: str) -> None:
    found = without_effect(override(SHORT, settings), list(settings))
    assert found[0].startswith(said)
    assert len(found) == len(set(settings.values()))


def test_nothing_is_said_of_defaults_of_parts_that_the_usual_experiment_lacks() -> None:
    filtered = override(SHORT, {"controller.estimator": "self-calibrating-kalman", "sensors.position_noise": 1e-3})
    assert without_effect(filtered, list(leaves(filtered))) == []


@pytest.mark.parametrize(
    "settings",
    [
        {"disturbance.vortex_amplitude": 3.0, "disturbance.vortex": True},
        {"plant.winch_1.gear_damping": 5.0, "plant.winch_1.gear_stiffness": 1e6},
        {"plant.vehicle.mass": 3000.0, "controller.observer.l0": 20.0, "simulation.duration": 3.0},
        {"plant.winch_1.eccentricity": 0.0},
        {"simulation.duration": 1e-5, "disturbance.vortex_amplitude": 3.0},
    ],
)
def test_nothing_is_said_of_values_with_an_effect_nor_where_there_are_errors(settings: dict[str, float]) -> None:
    assert without_effect(override(SHORT, settings), list(settings)) == []
