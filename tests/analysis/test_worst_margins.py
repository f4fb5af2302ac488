"""The least margins of machines against margins of one loop after the other, and against loops that are late."""

import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dualwinch.analysis import margin_survey
from dualwinch.analysis.linear_loop import linear_closed_loop, linear_open_loop
from dualwinch.analysis.margin_survey import UNSTABLE, UNSTEADY, MarginSurvey, survey_points
from dualwinch.analysis.margins import BOTH, MARGIN_KINDS, margins
from dualwinch.analysis.operating_points import loop_operating_point
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import LOOP_OPENINGS
from dualwinch.simulation.paper import case
from dualwinch.simulation.scenario import Scenario
from dualwinch.simulation.settings import override
from dualwinch.tuning.scoring.starts import with_designed_start
from dualwinch.tuning.tuning_problem import tuning_problem
from tests.tiers import mostly_slow

PAPER = case(4)
LAWS: tuple[dict[str, Any], ...] = (
    {},
    {"controller.kind": "adrc", "controller.estimator": "kalman"},
    {"controller.kind": "pid-cascade", "simulation.delay_samples": 3},
    {"actuator.kind": "motor", "controller.coordination.kind": "force-position"},
)


def one_after_the_other(experiment: Experiment, nominal: Plant | None = None) -> dict[str, float]:
    """Kind → least margin over all points and openings; 0 where a loop is unstable or has no cruise."""
    least = dict.fromkeys(MARGIN_KINDS, math.inf)
    for x, v in survey_points(experiment):
        for opening in LOOP_OPENINGS:
            try:
                found = margins(linear_open_loop(experiment, x, v, opening, nominal))
            except ConfigurationError:
                return dict.fromkeys(MARGIN_KINDS, 0.0)
            if not found.stable:
                return dict.fromkeys(MARGIN_KINDS, 0.0)
            least = {kind: min(value, getattr(found, kind)) for kind, value in least.items()}
    return least


def drawn(count: int) -> list[Scenario]:
    """Vertices of the sea with the filter it is tuned with, whose controller assumes the nominal machine."""
    sea = load_ensemble("sea", PAPER)
    sea = replace(sea, experiment=override(sea.experiment, {"controller.estimator": "calibrating-kalman"}))
    return [sea.scenario(index, 1, vertex=True) for index in range(count)]


TUNED = Path(__file__).parents[2] / "benchmarks/independent/tuned_in_site.toml"


def at(monkeypatch: pytest.MonkeyPatch, points: list[tuple[float, float]]) -> None:
    """Survey these points alone."""
    for module in (margin_survey, sys.modules[__name__]):
        monkeypatch.setattr(module, "survey_points", lambda _, **_words: points)


@pytest.mark.parametrize(
    ("changes", "all_points"),
    mostly_slow(
        ((changes, all_points) for changes in LAWS for all_points in (False, True)),
        lambda row: row[0] == LAWS[0] and not row[1],
    ),
    ids=str,
)
def test_margins_are_those_of_one_loop_after_the_other(
    changes: dict[str, Any], all_points: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = override(PAPER, changes)
    if not all_points:
        at(monkeypatch, [(2.5, -1.8)])
    (found,) = MarginSurvey([experiment], openings=tuple(LOOP_OPENINGS)).worst([[]])
    wanted = one_after_the_other(experiment)
    assert {kind: worst.value for kind, worst in found.items()} == pytest.approx(wanted, rel=1e-9)


def test_margins_are_those_of_motors_without_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    at(monkeypatch, [(2.5, -1.8)])
    limits = {"torque_limit": 40.0, "base_speed": 60.0, "continuous_torque": 20.0}
    lag = override(PAPER, {"actuator.kind": "motor"})
    limited = override(lag, {f"actuator.motor.{name}": value for name, value in limits.items()})
    (found,), (wanted,) = (MarginSurvey([experiment]).worst([[]]) for experiment in (limited, lag))
    assert found == wanted
    assert found["disk"].value > 0


@pytest.mark.slow
def test_margins_on_heavy_ropes_and_gears_are_those_of_one_loop_after_the_other() -> None:
    """On the nominal machine of the site with damped drums and a law without chatter; its ropes' sag at its softest."""
    values = {
        "controller.nftsm.smoothing": 0.05,
        "controller.winch_1.damping": 164.0,
        "controller.winch_2.damping": 164.0,
    }
    experiment = override(load_ensemble("site").experiment, values)
    (found,) = MarginSurvey([experiment], openings=tuple(LOOP_OPENINGS)).worst([[]])
    wanted = one_after_the_other(experiment)
    assert min(wanted.values()) > 0
    assert {kind: worst.value for kind, worst in found.items()} == pytest.approx(wanted, rel=1e-6)


@pytest.mark.slow
def test_a_machine_as_drawn_has_a_controller_that_assumes_the_nominal_one() -> None:
    machines = drawn(3)
    (found,) = MarginSurvey(machines, openings=tuple(LOOP_OPENINGS)).each([[]])
    for machine, worst in zip(machines, found, strict=True):
        wanted = one_after_the_other(machine.experiment, machine.nominal)
        assert {kind: of.value for kind, of in worst.items()} == pytest.approx(wanted, rel=1e-9)
    first = machines[0]
    knowing = one_after_the_other(first.experiment)["delay"]
    assert knowing != pytest.approx(found[0]["delay"].value, rel=1e-3)


@pytest.mark.slow
def test_a_filter_that_learns_the_machine_has_margins_on_a_rig(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it learns follows from where the machine is: nominal or drawn, the margins are those of `linearise`."""
    points = [(2.5, -1.8), (25.0, 0.0), (47.5, 1.8)]
    at(monkeypatch, points)
    rig = load_ensemble("rig")
    changes = {"controller.kind": "adrc", "controller.estimator": "self-calibrating-kalman"}
    rig = replace(rig, experiment=override(rig.experiment, changes))
    machines = [rig.experiment, *(rig.scenario(index, 7) for index in range(2))]
    (found,) = MarginSurvey(machines, openings=("u",)).each([[]], ["delay", "disk"])
    for machine, worst in zip(machines, found, strict=True):
        experiment, nominal = (
            (machine.experiment, machine.nominal) if isinstance(machine, Scenario) else (machine, None)
        )
        wanted = [margins(linear_open_loop(experiment, *point, "u", nominal)) for point in points]
        assert all(each.stable for each in wanted)
        for kind, of in worst.items():
            assert of.value == pytest.approx(min(getattr(each, kind) for each in wanted), rel=1e-6)


@pytest.mark.slow
def test_the_worst_is_where_it_is_said_to_be_whatever_else_is_looked_at() -> None:
    """Many gains on many machines at once give what one of each gives, and linearising there the same margin."""
    machines, names = drawn(4), ["controller.nftsm.beta", "controller.coordination.preload"]
    gains = [[0.05, 2000.0], [0.02, 2500.0], [0.03, 3000.0]]
    survey = MarginSurvey(machines, names, openings=tuple(LOOP_OPENINGS))
    for row, worst in zip(gains, survey.worst(gains), strict=True):
        for kind, of in worst.items():
            machine = machines[of.machine]
            changed = override(machine.experiment, dict(zip(names, row, strict=True)))
            there = margins(linear_open_loop(changed, of.x, of.v, of.opening, machine.nominal))
            assert getattr(there, kind) == pytest.approx(of.value, rel=1e-9)
            assert getattr(there, f"{kind}_frequency") == pytest.approx(of.frequency, rel=1e-6)
            alone = MarginSurvey([machine], names, openings=tuple(LOOP_OPENINGS)).worst([row])[0][kind]
            assert alone.value == pytest.approx(of.value, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("kp", [0.0005, 0.002])
def test_both_torques_may_be_late_by_the_delay_margin_and_no_more(kp: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sample more of delay at both motors is exact: the closed loop says where it becomes unstable."""
    gains = {"controller.coordination.preload": 6000.0, "controller.winch_1.kp": kp, "controller.winch_2.kp": kp}
    experiment = override(case(2), gains)
    for point in survey_points(experiment):
        monkeypatch.setattr(margin_survey, "survey_points", lambda _, point=point, **_words: [point])
        margin = MarginSurvey([experiment], openings=(BOTH,)).worst([[]], ["delay"])[0]["delay"].value
        borne = math.floor(margin / experiment.simulation.sample_time)
        radii = [
            np.abs(linear_closed_loop(override(experiment, {"simulation.delay_samples": late}), *point).poles()).max()
            for late in (borne, borne + 1)
        ]
        assert radii[0] < 1 < radii[1]


def test_an_unstable_loop_has_no_margin_and_the_place_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    at(monkeypatch, [(2.5, -1.8), (25.0, 0.0)])
    wild = override(PAPER, {"controller.winch_1.kp": 0.02, "controller.winch_2.kp": 0.02})
    worst = MarginSurvey([wild]).worst([[]])[0]
    assert {of.value for of in worst.values()} == {0.0}
    assert {of.reason for of in worst.values()} == {UNSTABLE}
    x, v = worst["delay"].x, worst["delay"].v
    assert np.abs(linear_closed_loop(wild, x, v).poles()).max() > 1


@pytest.mark.slow
def test_where_nothing_is_steady_there_is_no_margin(monkeypatch: pytest.MonkeyPatch) -> None:
    master = override(PAPER, {"controller.coordination.kind": "master-slave"})
    monkeypatch.setattr(margin_survey, "survey_points", lambda _, **_words: [(25.0, 1.8)])
    worst = MarginSurvey([master]).worst([[]])[0]["disk"]
    assert (worst.value, worst.reason) == (0.0, UNSTEADY)
    with pytest.raises(ConfigurationError, match="reaches no steady motion"):
        linear_open_loop(master, worst.x, worst.v)


def test_all_machines_of_the_sea_have_steady_motion_at_the_ends_of_the_track(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the start, on drawn machines: from a perfect controller's state one in ten was not found there."""
    problem = tuning_problem(ensemble="sea")
    machines = problem.drawn(14, 11, problem.tuned(problem.start))
    at(monkeypatch, [(2.5, 1.8), (47.5, -1.8)])
    for of_machine in MarginSurvey(machines, amplitudes=[0.002]).each([[]], ["disk"])[0]:
        assert (of_machine["disk"].reason, of_machine["disk"].value > 0.4) == ("", True)


@pytest.mark.slow
def test_margins_of_gains_do_not_depend_on_those_that_the_machine_has(monkeypatch: pytest.MonkeyPatch) -> None:
    """Gains about the start, as a search draws them: steady motion is found without that of the machine's own gains."""
    problem = with_designed_start(tuning_problem(ensemble="rig")).beginnings[-1]
    at(monkeypatch, [(2.5, 1.8)])
    machine = problem.drawn_ensemble.chosen([2], 5)
    start, random = problem.space.encoded(problem.start), np.random.default_rng(1)
    points = [problem.space.decoded((start + 0.1 * random.standard_normal(len(start))).clip(0, 1)) for _ in range(12)]
    survey = MarginSurvey(machine, problem.space.keys, amplitudes=[0.01])
    margins_of = survey.worst([problem.space.parameters(point) for point in points], ["disk"])
    assert not any(worst["disk"].reason == UNSTEADY for worst in margins_of)


def of_the_site() -> list[Scenario]:
    problem = tuning_problem(ensemble="site")
    return [each for each in problem.drawn(3, 11, problem.tuned(problem.start)) if isinstance(each, Scenario)]


@pytest.mark.slow
@pytest.mark.parametrize("index", range(3))
def test_machines_of_the_site_have_a_rest(index: int) -> None:
    """There the speed wheel says nothing of its scale, which the filter learns in motion."""
    machine = of_the_site()[index]
    assert loop_operating_point(machine.experiment, 25.0, 0.0, machine.nominal).residual < 1e-6


@pytest.mark.slow
def test_machines_of_the_site_have_a_stable_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    """There the speed wheel says nothing of its scale, which the filter learns in motion, so it stays what it was.

    Also with other gains than those with which operating points are known. Compiling their loops takes ten times as
    long as to find where they rest.
    """
    problem = tuning_problem(ensemble="site", config=TUNED)
    machines = [problem.experiment, *problem.drawn(3, 3)[2:]]
    at(monkeypatch, [(25.0, 0.0), (47.5, 0.0)])
    space, start = problem.space, problem.space.encoded(problem.start)
    random = np.random.default_rng(0)
    shares = np.clip([start, *(start + 0.05 * random.standard_normal((3, len(start))))], 0, 1)
    values = [space.parameters(space.decoded(each)) for each in shares]
    for row in MarginSurvey(machines, space.keys, amplitudes=[0.002]).each(values, ["disk"]):
        assert [(of["disk"].reason, of["disk"].value > 0.4) for of in row] == [("", True)] * len(machines)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ensemble", "config"), [("site", None), ("site", TUNED), ("overload", None)], ids=["start", "tuned", "overload"]
)
def test_machines_of_the_site_move_steadily_everywhere(ensemble: str, config: Path | None) -> None:
    """Under sag and drums that differ from the nominal ones, where the filter's gates shut out the first guess.

    Motors that would grow hot or lose their torque at speed are taken to be cold and slow.
    """
    problem = tuning_problem(ensemble=ensemble, config=config)
    machines = problem.drawn(14, 11, problem.tuned(problem.start))
    survey = MarginSurvey(machines, amplitudes=[0.002], openings=("u",))
    assert any(v > 1 for _, v in survey_points(problem.experiment))
    reasons = [of["disk"].reason for of in survey.each([[]], ["disk"])[0]]
    assert not any(reasons)


def test_points_are_ends_and_middle_of_the_track_at_rest_and_at_cruise() -> None:
    points = survey_points(PAPER)
    assert sorted({x for x, _ in points}) == [2.5, 25.0, 47.5]
    assert sorted({v for _, v in points}) == pytest.approx([-1.8, 0.0, 1.8])
    beyond = override(PAPER, {"reference.speed": 3.0})
    assert {v for _, v in survey_points(beyond)} == {0.0}, "it takes more force than there is"
