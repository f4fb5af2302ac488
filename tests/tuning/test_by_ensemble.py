from functools import cache
from pathlib import Path

import pytest

from dualwinch.analysis.resonance import matched_damping
from dualwinch.cli import main
from dualwinch.config.ensemble_file import find_ensemble, load_ensemble, loads_ensemble
from dualwinch.config.experiment_file import load, loads, own_keys, to_toml
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.paper import case
from dualwinch.tuning.baseline import RESERVE, assumptions, default_coordination, default_estimator, default_reserve
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.space import ContinuousDimension
from dualwinch.tuning.tuning_problem import tuning_problem


@cache
def problem_of(ensemble: str) -> TuningProblem:
    """The usual problem of a built-in ensemble, at which several tests look."""
    return tuning_problem(ensemble=ensemble)


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("[plant.winch_1]\nradius_error = 1e-4", "self-calibrating-kalman"),
        ("[distributions]\nplant.winch_2.drum_radius = { uniform = [0.79, 0.81] }", "self-calibrating-kalman"),
        ("[sensors]\noutage_length = 0.1", "self-calibrating-kalman"),
        ("[plant.winch_1]\ndrum_radius = 0.7", "calibrating-kalman"),
        ("[sensors]\nload_cell_zero_1 = 10", "calibrating-kalman"),
    ],
)
def test_who_cannot_trust_drums_learns_them(text: str, kind: str) -> None:
    assert default_estimator(loads_ensemble(text)) == kind


def test_motors_that_lag_are_quiet_by_themselves() -> None:
    texts = {name: [bound.text for bound in problem_of(name).constraints] for name in ("sea", "rig")}
    assert "mean.chatter<=0.25*paper" in texts["sea"]
    assert "mean.chatter<=1*paper" in texts["rig"]


def test_where_torques_are_uncertain_commands_may_keep_off_their_limit() -> None:
    (reserve,) = [found for found in problem_of("rig").space.dimensions if found.name == RESERVE]
    assert isinstance(reserve, ContinuousDimension)
    assert (reserve.lower, reserve.upper) == pytest.approx((0, 1.5 * (0.02 * 6000 + 30)))
    assert default_reserve(load_ensemble("rig")) == pytest.approx(0.02 * 6000 + 30)
    assert leaves(problem_of("rig").experiment)[RESERVE] == pytest.approx(0.02 * 6000 + 30)
    given = tuning_problem(ensemble="rig", settings=[f"{RESERVE}=20"])
    assert leaves(given.experiment)[RESERVE] == 20
    assert leaves(given.paper_experiment)[RESERVE] == 0
    stronger = tuning_problem(ensemble="rig", settings=["controller.coordination.tension_max=9000"])
    assert leaves(stronger.experiment)[RESERVE] == pytest.approx(0.02 * 9000 + 30)
    assert leaves(stronger.paper_experiment)[RESERVE] == 0
    assert leaves(problem_of("sea").experiment)[RESERVE] == 0
    assert RESERVE not in problem_of("sea").space.names
    assert RESERVE not in tuning_problem(ensemble="rig", space=["controller.nftsm.beta"]).space.names


def test_the_filter_expects_the_noise_of_the_position_sensor_that_is_described() -> None:
    key = "controller.kalman.position_noise"
    assert all(leaves(problem_of(name).experiment)[key] == 6e-4 for name in ("sea", "rig", "site"))
    problem = tuning_problem(ensemble="rig", settings=["sensors.position_resolution=0.01"])
    assert leaves(problem.experiment)[key] == 3e-3  # 10 mm / sqrt(12)
    assert f"{key} = 0.003: noise and rounding of the described position sensor" in problem.choices
    given = tuning_problem(ensemble="rig", settings=["sensors.position_resolution=0.01", f"{key}=2e-3"])
    assert leaves(given.experiment)[key] == 2e-3


def test_what_was_gained_says_what_it_rests_on() -> None:
    assert assumptions(load_ensemble("rig")) == "this holds for machines within the tolerances of 'rig'"
    assert "assumes exact drums, encoder zeros and position sensor, as 'sea' does" in assumptions(load_ensemble("sea"))
    assert "match the model exactly" in assumptions(None)


def test_where_ropes_sag_fast_force_is_shared_by_tension_unless_another_way_is_named() -> None:
    assert default_coordination(load_ensemble("rig")) is None
    problem = problem_of("site")
    assert problem.experiment.controller.coordination.kind == "proportional-tension"
    assert any(line.startswith("coordination proportional-tension: none is named") for line in problem.choices)
    assert {"controller.proportional_tension.slow_time", "controller.nftsm.smoothing"} <= set(problem.space.names)
    given = tuning_problem(ensemble="site", settings=["controller.coordination.kind=differential-tension"])
    assert given.experiment.controller.coordination.kind == "differential-tension"


def test_the_drums_damping_matches_the_impedance_of_the_ropes() -> None:
    """sqrt(EA mu) R^2/G with the tangent of a rope that does not sag, as the textbook has it."""
    found = leaves(problem_of("site").experiment)
    assert found["controller.winch_1.damping"] == pytest.approx((8e10 * 0.000452 * 2.36) ** 0.5 * 0.8**2 / 36, rel=0.02)
    assert found["controller.winch_1.kp"] == pytest.approx(0.01 * 0.8 / 36)


def test_the_drums_damping_leads_by_a_share_of_the_drives_lag_and_is_not_searched_for() -> None:
    problem = problem_of("site")
    drive, lead = (
        leaves(problem.experiment)[key] for key in ("actuator.motor.time_constant", "controller.winch_2.lead")
    )
    assert lead == pytest.approx(0.4 * drive)
    assert not any(name.endswith((".damping", ".lead")) for name in problem.space.names)


def test_bounds_of_a_search_are_a_factor_around_the_gains_that_are_designed_for_the_machine() -> None:
    problem = problem_of("site")
    start = {
        dimension.name: (dimension, float(problem.start[dimension.name]))
        for dimension in problem.space.dimensions
        if isinstance(dimension, ContinuousDimension)
    }
    for name in ("controller.nftsm.phi", "controller.observer.l0", "controller.winch.ki", "controller.nftsm.smoothing"):
        dimension, value = start[name]
        assert (dimension.lower, dimension.upper) == pytest.approx((value / 10, value * 10))
    gamma, value = start["controller.auxiliary.gamma"]
    assert gamma.upper / value != pytest.approx(value / gamma.lower), "of a gain that is not designed: its own bounds"
    (phi,) = tuning_problem(ensemble="site", space=["controller.nftsm.phi"]).space.dimensions
    assert isinstance(phi, ContinuousDimension)
    assert (phi.lower, phi.upper) == (0.005, 5), "named: its own bounds"


def test_shaping_of_the_winches_is_searched_where_they_start_with_it() -> None:
    name, settings = "controller.winch.shaping", [f"controller.winch_{winch}.shaping=0.5" for winch in (1, 2)]
    assert name not in problem_of("site").space.names
    assert name in tuning_problem(ensemble="site", settings=settings).space.names


DAMPING, KIND = "controller.winch_1.damping", "controller.coordination.kind"

HEAVY = """
[plant.rope_1]
mass_per_length = 2.4
submerged_weight = 20.5
[plant.rope_2]
mass_per_length = 2.4
submerged_weight = 20.5
[plant.winch_1]
inertia = 90.0
[plant.winch_2]
inertia = 90.0
"""


def test_a_file_of_a_heavy_machine_starts_as_the_site_does_but_for_gains_that_it_names(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text(f"{HEAVY}[controller.winch_2]\ndamping = 50.0\n")
    problem = tuning_problem(config=mine, ensemble="rig")
    found = leaves(problem.experiment)
    assert 0.8 * matched_damping(load(mine), 1) < found[DAMPING] < matched_damping(load(mine), 1), "motors lag"
    assert found["controller.winch_2.damping"] == 50
    assert found["controller.coordination.preload"] == 1.8 * 2000
    assert found[KIND] == "proportional-tension"
    assert found["controller.kalman.compensation"] == 1
    assert any(f"({DAMPING} = {found[DAMPING]:.3g})" in line for line in problem.choices)


def test_a_heavy_machine_without_an_ensemble_starts_so_too(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text(HEAVY)
    problem = tuning_problem(config=mine)
    found = leaves(problem.experiment)
    assert found[DAMPING] == pytest.approx(matched_damping(load(mine), 1))
    assert (found["controller.estimator"], found[KIND]) == ("self-calibrating-kalman", "proportional-tension")
    assert len(problem.choices) == 3
    assert "controller.nftsm.smoothing" in problem.space.names
    light = tuning_problem(case=4)
    assert light.experiment == case(4)
    assert not light.choices


def test_the_start_of_a_completed_file_is_that_of_the_file(tmp_path: Path) -> None:
    """Values that ``dualwinch config`` has added and marked are not named."""
    mine, whole = tmp_path / "mine.toml", tmp_path / "whole.toml"
    mine.write_text(HEAVY)
    whole.write_text(to_toml(load(mine), own_keys(mine)))
    assert tuning_problem(config=whole).experiment == tuning_problem(config=mine).experiment


def test_gains_that_an_ensembles_own_file_names_are_the_start(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    text = find_ensemble("site").read_text(encoding="utf-8")
    own.write_text(f"{text}\n[controller.winch_1]\ndamping = 120.0\n")
    found = leaves(tuning_problem(ensemble=own).experiment)
    assert found[DAMPING] == 120
    assert found["controller.winch_2.damping"] == leaves(problem_of("site").experiment)[DAMPING]


def test_an_experiment_is_taken_as_it_is_and_undamped_drums_are_said() -> None:
    given = loads(HEAVY)
    problem = tuning_problem(given, ensemble="rig")
    assert problem.experiment.controller == given.controller
    (said,) = problem.choices
    assert said.startswith("gains as the experiment has them, with controller.winch_1.damping and controller.winch_2.")
    assert not tuning_problem(case(4), ensemble="sea").choices


@pytest.mark.slow
def test_config_prints_the_start_for_a_machine(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine, start = tmp_path / "mine.toml", tmp_path / "start.toml"
    mine.write_text(HEAVY)
    main(["config", "--config", str(mine), "--start"])
    printed = capsys.readouterr().out
    assert printed.startswith("# estimator self-calibrating-kalman: none is named, and ")
    start.write_text(printed)
    problem = tuning_problem(config=mine)
    assert load(start) == problem.experiment
    assert DAMPING in own_keys(start)
    assert tuning_problem(config=start).experiment == problem.experiment
    main(["config", "--ensemble", "site", "--start"])
    assert loads(capsys.readouterr().out) == problem_of("site").experiment


def test_where_ropes_sag_the_filter_knows_it(tmp_path: Path) -> None:
    ropes = "".join(
        f"[plant.rope_{number}]\narea = 7e-4\nmodulus = 1.1e11\nmass_per_length = 6.3\nsubmerged_weight = 61.8\n"
        for number in (1, 2)
    )
    (mine := tmp_path / "ferry.toml").write_text(f"[plant.track]\nlength = 220.0\n{ropes}")
    problem = tuning_problem(config=mine, ensemble="sea")
    assert problem.experiment.controller.estimator.kind == "self-calibrating-kalman"
    assert "in 'sea' sensors are noisy, ropes sag" in problem.choices[0]


def test_where_overloads_are_drawn_the_tensions_of_their_recovery_are_bounded() -> None:
    assert [problem_of(name).objectives[0].name for name in ("site", "overload")] == ["mean.mse", "geomean.mse"]
    usual, overloaded = (problem_of(name).constraints for name in ("site", "overload"))
    assert [constraint.label for constraint in overloaded][:2] == [
        "worst.slack_share <= 0.005",
        "worst.peak_tension <= 7500 N",
    ]
    assert [constraint.label for constraint in overloaded][2:] == [constraint.label for constraint in usual][2:]
    pushed, *_ = tuning_problem(case=4, settings=["disturbance.push.force=2e3"]).constraints
    assert pushed.label == overloaded[0].label
