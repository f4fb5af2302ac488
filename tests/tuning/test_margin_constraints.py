"""Stability margins as constraints: their words, what candidates are measured by, and studies that keep them."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dualwinch.analysis.describing_function import amplitude_sweep
from dualwinch.analysis.linear_loop import linear_closed_loop, linear_open_loop
from dualwinch.analysis.margin_survey import MarginSurvey
from dualwinch.analysis.margins import margins
from dualwinch.cli.tune import StudyOptions, write
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.tuning.constraints import Constraint, constraints_from, objectives_from
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.result import TuningResult, margin_places
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate
from dualwinch.tuning.scoring.training_set import TRAINING_MACHINES, prepare, survey
from dualwinch.tuning.tune import tune
from dualwinch.tuning.tuning_problem import tuning_problem
from tests.simulation.inserted import run
from tests.studies import MakeProblem

DELAY, DISK = "worst.delay_margin>=8ms", "worst.disk_margin>=0.4"
BETA, KP = "controller.nftsm.beta", "controller.winch.kp"


def bound(text: str) -> Constraint:
    return constraints_from([text], case(4))[0]


@pytest.mark.parametrize(
    ("text", "limit", "label"),
    [
        ("worst.delay_margin>=5ms", 5e-3, "worst.delay_margin >= 0.005 s"),
        ("worst.delay_margin >= 0.005", 5e-3, "worst.delay_margin >= 0.005 s"),
        ("worst.gain_margin>=6dB", 10**0.3, "worst.gain_margin >= 1.99526"),
        ("worst.gain_margin>=2", 2, "worst.gain_margin >= 2"),
        ("worst.phase_margin>=45deg", 45, "worst.phase_margin >= 45 deg"),
        ("worst.phase_margin>=0.5 rad", math.degrees(0.5), "worst.phase_margin >= 28.6479 deg"),
        ("worst.disk_margin>=4e-1", 0.4, "worst.disk_margin >= 0.4"),
        ("worst.peak_tension<=5.5kN", 5500, "worst.peak_tension <= 5500 N"),
        ("worst.delay_margin>=0.5*paper", 0.5, "worst.delay_margin >= 0.5 times the paper's"),
    ],
)
def test_bounds_come_with_units(text: str, limit: float, label: str) -> None:
    found = bound(text)
    assert found.bound == pytest.approx(limit)
    assert found.label == label


def test_where_drums_swing_on_their_ropes_their_resonance_has_to_be_damped() -> None:
    """By default, where ropes have mass or winches are heavy and the law is one that the rule is about."""

    def bounds(**words: Any) -> list[str]:
        return [constraint.label for constraint in tuning_problem(**words).constraints]

    label = "worst.large_signal_margin >= 1"
    heavy = ["plant.winch_1.inertia=150", "plant.winch_2.inertia=150"]
    assert label in bounds(ensemble="site")
    assert label in bounds(case=4, settings=["plant.rope_1.mass_per_length=2.36"])
    assert label in bounds(case=4, settings=heavy)
    assert any("delay_margin" in each for each in bounds(ensemble="rig"))
    assert label not in bounds(case=4)
    assert label not in bounds(case=4, settings=[*heavy, "controller.kind=pid-cascade"])
    with pytest.raises(ConfigurationError, match=r'resonance_margin>=2: must be "fando-nftsm" or'):
        bounds(case=4, settings=["controller.kind=pid-cascade"], constraints=["worst.resonance_margin>=2"])


@pytest.mark.parametrize(("damping", "satisfied"), [(0.0, False), (330.0, True)])
def test_the_papers_gains_satisfy_it_on_heavy_drums_where_these_are_damped(damping: float, satisfied: bool) -> None:
    values = {"plant.winch_{}.inertia": 150.0, "plant.rope_{}.damping": 300.0, "controller.winch_{}.damping": damping}
    settings = [f"{key.format(number)}={value}" for key, value in values.items() for number in (1, 2)]
    problem = tuning_problem(case=4, settings=settings, space=[BETA])
    surveyed = survey(problem, [])
    assert surveyed is not None
    (found,) = surveyed.worst([problem.space.parameters(problem.start)], [problem.margins[0].margin])
    (constraint,) = (each for each in problem.constraints if each.statistic == problem.margins[0])
    assert (constraint.violation(problem.margins[0].of(found)) <= 0) == satisfied


def test_in_an_ensemble_margins_are_bounded_by_default_at_the_noise_and_at_larger_speed_errors() -> None:
    problem = tuning_problem(ensemble="sea")
    labels = [constraint.label for constraint in problem.constraints]
    assert {"worst.disk_margin >= 0.4", "worst.delay_margin >= 0.005 s"} <= set(labels)
    assert problem.margin_amplitudes == (problem.experiment.sensors.speed_noise, 0.01, 0.1)
    assert problem.margin_conditions.endswith("largest speed, for speed errors of 0.2, 1 and 10 cm/s")
    assert not tuning_problem(case=4).margins
    assert not tuning_problem(case=4).margin_conditions
    assert not tuning_problem(ensemble="sea", constraints=["none"]).margins


@pytest.mark.slow
def test_where_drums_swing_margins_are_bounded_for_small_speed_errors() -> None:
    problem = tuning_problem(ensemble="site")
    labels = [constraint.label for constraint in problem.constraints]
    assert {"worst.disk_margin >= 0.4", "worst.delay_margin >= 0.001 s"} <= set(labels)
    assert problem.margin_amplitudes == (problem.experiment.sensors.speed_noise, 0.01)
    assert problem.margin_conditions.endswith("largest speed, for speed errors of 0.2 and 1 cm/s")
    surveyed = survey(problem, problem.drawn(2, 5))
    assert surveyed is not None
    assert len(surveyed.loops) == 3 * 9 * 2, "machines, points and amplitudes"
    (worst,) = surveyed.worst([problem.space.parameters(problem.start)], ["disk", "delay"])
    assert worst["disk"].value > 0.4
    assert worst["delay"].value > 1e-3


@pytest.mark.parametrize(("amplitude", "linear_speed"), [(0.002, 0.0), (0.1, 0.0), (0.1, 0.01)])
def test_margins_at_an_amplitude_are_those_of_the_describing_functions(amplitude: float, linear_speed: float) -> None:
    experiment = override(case(4), {"controller.nftsm.linear_speed": linear_speed})
    (least,) = MarginSurvey([experiment], openings=["u"], amplitudes=[amplitude]).worst([[]], ["delay", "disk"])
    (point,) = amplitude_sweep(experiment, least["delay"].x, least["delay"].v, "u", [amplitude])
    assert least["delay"].value == pytest.approx(point.margins.delay, rel=1e-6)
    (point,) = amplitude_sweep(experiment, least["disk"].x, least["disk"].v, "u", [amplitude])
    assert least["disk"].value == pytest.approx(point.margins.disk, rel=1e-6)
    both = MarginSurvey([experiment], openings=["u"], amplitudes=[amplitude, 0.01]).worst([[]], ["delay"])[0]["delay"]
    assert both.value <= least["delay"].value


def test_a_margin_is_no_objective() -> None:
    with pytest.raises(ConfigurationError, match=r"make it a constraint, worst\.disk_margin>="):
        objectives_from(["worst.disk_margin"])


@pytest.fixture
def bounded(make_problem: MakeProblem) -> TuningProblem:
    return make_problem(constraints=["none", "worst.delay_margin>=5ms", DISK], space=[BETA, KP])


def test_candidates_have_the_margins_of_the_nominal_machine_and_of_drawn_ones(bounded: TuningProblem) -> None:
    prepared = prepare(bounded)
    assert prepared.margins is not None
    nominal, *machines = prepared.margins.machines
    assert nominal == bounded.experiment
    assert machines == list(prepared.scenarios[:TRAINING_MACHINES])
    (start,) = Evaluator(prepared).evaluate([Candidate(bounded.start, "start")])
    least = MarginSurvey([nominal, *machines], amplitudes=bounded.margin_amplitudes).worst([[]], ["delay", "disk"])[0]
    assert start.statistics["worst.delay_margin"] == pytest.approx(least["delay"].value, rel=1e-9)
    assert start.statistics["worst.disk_margin"] == pytest.approx(least["disk"].value, rel=1e-9)
    violation = start.violations["worst.delay_margin >= 0.005 s"]
    assert violation == pytest.approx(1 - least["delay"].value / 5e-3, rel=1e-6)


def test_all_candidates_have_margins_in_the_active_loops_and_the_leader_in_all(bounded: TuningProblem) -> None:
    evaluator = Evaluator(prepare(bounded))
    found = evaluator.evaluate([Candidate(bounded.start | {BETA: 0.01 * number}, "method") for number in range(1, 13)])
    assert {trial.pruned for trial in found} == {False, True}
    for trial in found:
        assert "worst.delay_margin" in trial.statistics, "it counts in the halving"
        assert set(trial.violations) == set(found[0].violations)
    active, surveyed = evaluator.cutting.active, evaluator.cutting.survey
    assert active is not None
    assert surveyed is not None
    assert len(active) < len(surveyed.loops)
    leader = evaluator.leader()
    assert leader is not None
    (worst,) = surveyed.worst([bounded.space.parameters(leader.candidate.point)], ["delay", "disk"])
    assert leader.evaluation.statistics["worst.delay_margin"] == pytest.approx(worst["delay"].value, rel=1e-9)
    assert leader.evaluation.statistics["worst.disk_margin"] == pytest.approx(worst["disk"].value, rel=1e-9)


def test_the_worst_fresh_machine_below_a_margin_becomes_a_cut_with_its_loops(make_problem: MakeProblem) -> None:
    bounded = make_problem(constraints=["none", "worst.delay_margin>=400ms"], space=[BETA])
    evaluator = Evaluator(prepare(bounded))
    evaluator.evaluate([Candidate(bounded.start, "start")])
    leader = evaluator.leader()
    assert leader is not None
    draws = evaluator.fresh("checks", 0, 4).scenarios
    surveys = [MarginSurvey([draw], amplitudes=bounded.margin_amplitudes) for draw in draws]
    violations = [1 - survey.worst([[]], ["delay"])[0]["delay"].value / 0.4 for survey in surveys]
    below = evaluator.machines_below(leader, draws)
    assert below == sum(violation > 0 for violation in violations)
    assert below > 0, "the start has too small a delay margin"
    surveyed = evaluator.cutting.survey
    assert surveyed is not None
    assert surveyed.machines[-1] is draws[int(np.argmax(violations))]
    again = evaluator.leader()
    assert again is leader
    active, last = evaluator.cutting.active, len(surveyed.machines) - 1
    assert active is not None
    assert last in surveyed.loops[active, 0]


def test_the_number_of_machines_is_bounded(bounded: TuningProblem) -> None:
    evaluator = Evaluator(prepare(bounded))
    evaluator.find_active_loops()
    for draw in evaluator.fresh("checks", 0, 6).scenarios:
        evaluator.cutting.add_machine(draw)
    surveyed = evaluator.cutting.survey
    assert surveyed is not None
    assert len(surveyed.machines) == 1 + TRAINING_MACHINES + bounded.options.machines_checked


@pytest.mark.slow
def test_a_factor_on_the_papers_margin_is_one_on_what_its_controller_has(make_problem: MakeProblem) -> None:
    problem = make_problem(constraints=["none", "worst.disk_margin>=0.5*paper"], ensemble=None, space=[BETA])
    survey = MarginSurvey([problem.paper_experiment], amplitudes=problem.margin_amplitudes)
    paper = survey.worst([[]])[0]["disk"].value
    assert prepare(problem).constraints[0].bound == pytest.approx(paper / 2, rel=1e-9)


def study(*constraints: str) -> TuningResult:
    """Gains for two seconds of a smooth start, tuned for their error alone but for the constraints."""
    problem = tuning_problem(
        case=2, settings=["simulation.duration=2"], space=[BETA, KP], constraints=constraints, seed=1
    )
    return tune(problem, trials=48, method="cmaes")


@pytest.mark.slow
def test_tuned_gains_keep_the_delay_margin_that_error_alone_would_use_up(tmp_path: Path) -> None:
    free, kept = study(), study(DELAY)
    assert MarginSurvey([free.best]).worst([[]])[0]["delay"].value < 8e-3
    assert free.verdict.scored.statistics["mean.mse"] < kept.verdict.scored.statistics["mean.mse"]
    worst = MarginSurvey([kept.best]).worst([[]])[0]["delay"]
    assert worst.value >= 8e-3
    assert kept.verdict.scored.statistics["worst.delay_margin"] == pytest.approx(worst.value, rel=1e-9)
    _stands_and_falls(kept, math.floor(1e3 * worst.value), math.ceil(1.5e3 * worst.value), (worst.x, worst.v))
    (place,) = [words for words in margin_places(kept) if "(best)" in words]
    assert f"x = {worst.x:g} m" in place
    assert worst.opening in place
    write(kept, StudyOptions(storage="memory", out=tmp_path))
    assert place in (tmp_path / "best.toml").read_text()
    assert worst.opening in (tmp_path / "report.html").read_text()
    noted = json.loads((tmp_path / "study.json").read_text())["margins"]
    assert noted["best"]["worst.delay_margin"]["value"] == pytest.approx(worst.value)
    assert noted["paper"]["worst.delay_margin"]["machine"] == "the nominal machine"


def _stands_and_falls(tuned: TuningResult, borne: int, too_much: int, point: tuple[float, float]) -> None:
    """Torques that are later by so many samples are borne in the nonlinear simulation, and more are not."""
    kick = {"motion.plant.v": 1e-7}
    late = [override(tuned.best, {"simulation.delay_samples": samples}) for samples in (borne, too_much)]
    assert np.abs(linear_closed_loop(late[0], *point).poles()).max() < 1
    stands = run(late[0], *point, kick, 2000)
    falls = run(late[1], *point, kick, 2000)
    assert stands.peaks[3] < stands.peaks[0] < 1e-6
    assert falls.peaks[3] > 1e-5, "it has grown to an oscillation of its own"


def test_an_unstable_start_is_a_violated_constraint_and_its_place_is_told(make_problem: MakeProblem) -> None:
    stiff = ["simulation.duration=0.1", "controller.winch_1.kp=0.02", "controller.winch_2.kp=0.02"]
    problem = make_problem(ensemble=None, settings=stiff, constraints=["none", DELAY], space=[BETA])
    assert not margins(linear_open_loop(problem.experiment, 2.5, 0.0, "u")).stable
    found = tune(replace(problem), trials=2, method="random")
    assert found.verdict.scored.statistics["worst.delay_margin"] == 0
    assert found.verdict.scored.violations["worst.delay_margin >= 0.008 s"] == 1
    assert "unstable at x = 2.5 m" in margin_places(found)[0]
