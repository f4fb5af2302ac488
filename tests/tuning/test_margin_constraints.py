"""Stability margins as constraints: their words, what candidates are measured by, and studies that keep them."""

import itertools
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
from dualwinch.simulation.scenario import Scenario
from dualwinch.simulation.settings import override
from dualwinch.tuning.constraints import Constraint, constraints_from, objectives_from
from dualwinch.tuning.optimisers.linearise import active_scenarios, linearise, margin_slopes
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.result import TuningResult, margin_places
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate, penalised_first
from dualwinch.tuning.scoring.training_set import ActiveLoops, prepare, survey
from dualwinch.tuning.selection_config import SelectionConfig
from dualwinch.tuning.space import ContinuousDimension
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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "worst.dealy_margin>=5ms",
            "did you mean 'delay_margin'? Must be one of gain_margin, phase_margin, delay_margin,",
        ),
        ("mean.delay_margin>=5ms", "a margin must be bounded as worst.delay_margin"),
        ("delay_margin>=5ms", "a margin must be bounded as worst.delay_margin"),
        ("worst.delay_margin>=5mm", 'unit "mm": must be one of s, ms, us, ns, min, h'),
        ("worst.gain_margin>=6deg", 'unit "deg": must be one of dB'),
        ("worst.phase_margin>=1s", 'unit "s": must be one of deg, rad'),
        ("worst.disk_margin>=1dB", 'unit "dB": must be a plain number'),
    ],
)
def test_wrong_margins_are_one_line(text: str, message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        bound(text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_where_drums_swing_on_their_ropes_their_resonance_has_to_be_damped() -> None:
    """By default, where ropes have mass or winches are heavy and the law is one that the rule is about."""

    def bounds(**words: Any) -> list[str]:
        return [constraint.label for constraint in tuning_problem(**words).constraints]

    label = "worst.resonance_margin >= 1"
    heavy = ["plant.winch_1.inertia=150", "plant.winch_2.inertia=150"]
    assert label in bounds(ensemble="site")
    assert label in bounds(case=4, settings=["plant.rope_1.mass_per_length=2.36"])
    assert label in bounds(case=4, settings=heavy)
    assert any("delay_margin" in each for each in bounds(ensemble="rig"))
    assert label not in bounds(case=4)
    assert label not in bounds(case=4, settings=[*heavy, "controller.kind=pid-cascade"])
    with pytest.raises(ConfigurationError, match=r'resonance_margin>=2: must be "fando-nftsm" or'):
        bounds(case=4, settings=["controller.kind=pid-cascade"], constraints=["worst.resonance_margin>=2"])


@pytest.mark.parametrize(("damping", "satisfied"), [(0.0, False), (164.0, True)])
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


@pytest.mark.parametrize("amplitude", [0.002, 0.1])
def test_margins_at_an_amplitude_are_those_of_the_describing_functions(amplitude: float) -> None:
    experiment = case(4)
    (least,) = MarginSurvey([experiment], openings=["u"], amplitudes=[amplitude]).worst([[]], ["delay", "disk"])
    (point,) = amplitude_sweep(experiment, least["delay"].x, least["delay"].v, "u", [amplitude])
    assert least["delay"].value == pytest.approx(point.margins.delay, rel=0.05)
    (point,) = amplitude_sweep(experiment, least["disk"].x, least["disk"].v, "u", [amplitude])
    assert least["disk"].value == pytest.approx(point.margins.disk, rel=0.05)
    both = MarginSurvey([experiment], openings=["u"], amplitudes=[amplitude, 0.01]).worst([[]], ["delay"])[0]["delay"]
    assert both.value <= least["delay"].value


def test_a_margin_is_no_objective() -> None:
    with pytest.raises(ConfigurationError, match=r"make it a constraint, worst\.disk_margin>="):
        objectives_from(["worst.disk_margin"])


@pytest.fixture
def bounded(make_problem: MakeProblem) -> TuningProblem:
    return make_problem(constraints=["none", "worst.delay_margin>=5ms", DISK], space=[BETA, KP])


def test_candidates_have_the_margins_of_the_nominal_machine_and_of_the_hardest(bounded: TuningProblem) -> None:
    prepared = prepare(bounded)
    assert prepared.margins is not None
    nominal, *machines = prepared.margins.machines
    assert nominal == bounded.experiment
    assert len(machines) == bounded.margin_machines
    (start,) = Evaluator(prepared).evaluate([Candidate(bounded.start, "start")])
    every = [scenario for scenario in (*prepared.scenarios, *prepared.hard) if isinstance(scenario, Scenario)]
    amplitudes = bounded.margin_amplitudes
    least = MarginSurvey([bounded.experiment, *every], amplitudes=amplitudes).worst([[]], ["delay", "disk"])[0]
    assert start.statistics["worst.delay_margin"] == pytest.approx(least["delay"].value, rel=1e-9)
    # the machines are those of the least margins at the largest amplitude; this disk is least at another one
    assert start.statistics["worst.disk_margin"] == pytest.approx(least["disk"].value, rel=1e-2)
    label = "worst.delay_margin >= 0.005 s"
    assert start.violations[label] == pytest.approx(
        1 - least["delay"].value / 5e-3 + SelectionConfig.back_off, rel=1e-6
    )


def test_who_is_given_up_or_fails_is_not_looked_at(bounded: TuningProblem) -> None:
    prepared = prepare(bounded)
    candidates = [Candidate(bounded.start | {BETA: 0.01 * number}, "method") for number in range(1, 13)]
    found = Evaluator(prepared).evaluate(candidates)
    assert {trial.pruned for trial in found} == {False, True}
    for trial in found:
        assert ("worst.delay_margin" in trial.statistics) != trial.pruned
        assert set(trial.violations) == set(found[0].violations)


def test_active_loops_are_the_points_of_least_margin_of_each_machine_and_amplitude() -> None:
    survey = MarginSurvey([case(4), override(case(4), {"plant.vehicle.mass": 1500.0})], amplitudes=[0.01, 0.1])
    pool = ActiveLoops(survey, ["delay", "disk"], SelectionConfig())
    assert len(pool.indices) == len(survey.loops)
    margins = survey.of_loops([[]], ["delay", "disk"])[0]
    pool.learn(margins)
    for machine, amplitude, kind in itertools.product(range(2), range(2), ("delay", "disk")):
        mine = [index for index, (at, _, size) in enumerate(survey.loops) if (at, size) == (machine, amplitude)]
        least, known = (
            min(margins[index][kind].value for index in chosen) for chosen in (mine, {*mine} & {*pool.indices})
        )
        assert known == pytest.approx(least, rel=1e-9)
    assert len(pool.indices) <= 8
    (whole,), (active,) = (survey.worst([[]], ["delay", "disk"], loops) for loops in (None, pool.indices))
    for kind, worst in whole.items():
        assert active[kind].value == pytest.approx(worst.value, rel=1e-9)
        assert worst.value == pytest.approx(min(of[kind].value for of in margins), rel=1e-9)


def test_active_machines_are_those_of_least_margin() -> None:
    masses = [4000.0, 12000.0, 1500.0, 8000.0]
    machines = [override(case(4), {"plant.vehicle.mass": mass}) for mass in masses]
    survey = MarginSurvey(machines, amplitudes=[0.01, 0.1])
    pool = ActiveLoops(survey, ["disk"], replace(SelectionConfig(), margin_machines_active=0))
    margins = survey.of_loops([[]], ["disk"])[0]
    pool.learn(margins)
    values = np.array([of_loop["disk"].value for of_loop in margins])
    assert len(pool.indices) == 2, "as many as amplitudes"
    assert values.argmin() in pool.indices
    least = sorted(values[(survey.loops[:, [0, 2]] == group).all(axis=1)].min() for group in np.ndindex(4, 2))
    assert sorted(values[pool.indices]) == pytest.approx(least[:2])


def test_of_a_leader_margins_are_known_in_all_loops(bounded: TuningProblem) -> None:
    prepared = prepare(bounded)
    surveyed = prepared.margins
    assert surveyed is not None
    evaluator = Evaluator(prepared)
    found = evaluator.evaluate([Candidate(bounded.start | {BETA: 0.01 * number}, "method") for number in range(1, 13)])
    leader = found[penalised_first(found)[0]]
    (worst,) = surveyed.worst([bounded.space.parameters(leader.point)], ["delay", "disk"])
    assert leader.statistics["worst.delay_margin"] == pytest.approx(worst["delay"].value, rel=1e-9)
    assert leader.statistics["worst.disk_margin"] == pytest.approx(worst["disk"].value, rel=1e-9)


@pytest.mark.slow
def test_a_factor_on_the_papers_margin_is_one_on_what_its_controller_has(make_problem: MakeProblem) -> None:
    problem = make_problem(constraints=["none", "worst.disk_margin>=0.5*paper"], ensemble=None, space=[BETA])
    survey = MarginSurvey([problem.paper_experiment], amplitudes=problem.margin_amplitudes)
    paper = survey.worst([[]])[0]["disk"].value
    assert prepare(problem).constraints[0].bound == pytest.approx(paper / 2, rel=1e-9)


@pytest.mark.slow
def test_slopes_are_those_of_the_margins_of_machines_near_the_worst(bounded: TuningProblem) -> None:
    prepared = prepare(bounded)
    assert prepared.margins is not None
    dimensions = [dimension for dimension in bounded.space.dimensions if isinstance(dimension, ContinuousDimension)]
    statistic = bounded.margins[0]
    found = margin_slopes(prepared, bounded.start, dimensions)[statistic]
    value, slopes = min(found, key=lambda pair: pair[0])
    for index, dimension in enumerate(dimensions):
        share = dimension.encoded(bounded.start[dimension.name])
        apart = [bounded.start | {dimension.name: dimension.decoded(share + step)} for step in (1e-4, -1e-4)]
        rows = [bounded.space.parameters(point) for point in apart]
        above, below = (worst["delay"].value for worst in prepared.margins.worst(rows, ["delay"]))
        assert slopes[index] == pytest.approx((above - below) / 2e-4, rel=2e-2)
    model = linearise(prepared, active_scenarios(prepared, bounded.start), bounded.start)
    assert model.violations.max() == pytest.approx(
        max(prepared.constraints[0].violation(value, SelectionConfig.back_off), model.violations.max())
    )
    assert set(model.belongs.tolist()) == {0, 1}


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
