"""Given signals in every kind of run, against closed forms and the independent implementation."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dualwinch.config.experiment_file import loads
from dualwinch.model.disturbance import Disturbance
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.reference import Reference
from dualwinch.model.signals import Signal
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.blocks import block
from dualwinch.simulation.ensembles.ensemble import Drawn, Ensemble, Uniform
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.exogenous.signals import sea_signals
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.paper import case
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from dualwinch.tuning.tuning_problem import configuration, tuning_problem
from tests.oracle.sampled import Scenario, run
from tests.simulation.batch.test_required_force import required_force
from tests.tiers import all_but

SHORT = Simulation(duration=4.0, integrator="exponential", substeps=8)
STEP = Signal.from_arrays([0.0, 2.0, 3.0], [0.0, 0.6, 0.0], unit="kN", interpolation="previous")


def pushed(force: Signal) -> Experiment:
    return replace(case(2), disturbance=Disturbance(force=force), simulation=SHORT)


@pytest.fixture(scope="module")
def calm() -> Result:
    return simulate(replace(case(2), simulation=SHORT))


def test_before_the_ropes_answer_a_force_is_mass_times_acceleration(calm: Result) -> None:
    result = simulate(pushed(STEP))
    assert np.array_equal(result["x"][:2001], calm["x"][:2001])
    change = result["v"] - calm["v"]
    assert change[2001] == pytest.approx(600 * 1e-3 / 1e4, rel=1e-3)
    assert result["d_true"][2000] - calm["d_true"][2000] == pytest.approx(600 / 1e4, rel=1e-6)


def test_a_lasting_force_is_carried_by_the_ropes(calm: Result) -> None:
    result = simulate(pushed(Signal.from_arrays([0, 1], [250, 250], unit="N")))
    late = slice(3000, None)
    net, without = (np.mean((run["F1"] - run["F2"])[late]) for run in (result, calm))
    assert net - without == pytest.approx(-250, abs=1)


@pytest.mark.parametrize("kind", all_but(["fando-nftsm"], ["fando-nftsm", "pid-cascade"]))
def test_a_force_is_the_rail_load_of_the_independent_implementation(kind: str) -> None:
    """Above walking pace dry friction is its coefficient times the load: 0.1 times -6 kN pushes with 600 N."""
    ours = simulate(replace(case(2, kind), disturbance=Disturbance(force=STEP), simulation=SHORT))
    t = np.arange(4000) * 1e-3
    load = np.where((t >= 2 - 1e-9) & (t < 3 - 1e-9), -6000.0, 0.0)
    theirs = run(Scenario(kind, 2, signals={"load": load}), 4000)
    assert np.abs(ours["x"] - theirs["x"]).max() <= 1e-8
    assert np.abs(ours["v"] - theirs["v"]).max() <= 1e-7
    assert np.ptp(ours["e"][2000:3500]) > 1e3 * 1e-8


def test_current_and_rail_load_are_those_of_the_independent_implementation() -> None:
    current = Signal.from_arrays([0, 4], [0, 1.8], unit="km/h")
    load = Signal.from_arrays([1, 3], [-0.2, 0.4], unit="kN", beyond="zero")
    sea = Disturbance(current=current, normal_force_variation=load)
    experiment = replace(case(2), disturbance=sea, simulation=SHORT)
    t = np.arange(4000) * 1e-3
    signals = {"current": t / 8, "load": np.where((t >= 1) & (t <= 3), -200 + 300 * (t - 1), 0.0)}
    theirs = run(Scenario("fando-nftsm", 2, signals=signals), 4000)
    assert np.abs(simulate(experiment)["x"] - theirs["x"]).max() <= 1e-8


def test_given_and_random_current_add_up() -> None:
    random = Disturbance(current_sigma=0.05)
    given = replace(random, current=Signal.from_arrays([0, 1], [0.3, 0.3], unit="m/s"))
    before, after = (sea_signals(replace(case(2), disturbance=sea)).current for sea in (random, given))
    assert after == pytest.approx(before + 0.3)


def test_rollouts_mix_scenarios_with_and_without_a_force() -> None:
    scenarios = [pushed(Signal()), pushed(STEP)]
    together = rollout(["controller.observer.l0"], [[5.0], [7.0]], scenarios)
    for j, scenario in enumerate(scenarios):
        alone = rollout(["controller.observer.l0"], [[5.0], [7.0]], [scenario])
        assert together.metrics["mse"][:, j] == pytest.approx(alone.metrics["mse"][:, 0], rel=1e-6)
        assert together.metrics["mse"][0, j] == pytest.approx(simulate(scenario).metrics.mse, rel=1e-3)
    assert together.metrics["mse"][0, 1] > 100 * together.metrics["mse"][0, 0]


def test_an_ensemble_draws_the_size_of_a_force() -> None:
    drawn = {"disturbance.force.scale": Drawn(Uniform(0.5, 2.0))}
    result = run_ensemble(Ensemble("gust", "", pushed(STEP), drawn), 4, 1)
    for scale, mse in zip(result.draws["disturbance.force.scale"], result.metrics["mse"], strict=True):
        alone = simulate(pushed(replace(STEP, scale=float(scale))))
        assert mse == pytest.approx(alone.metrics.mse, rel=1e-3)


def test_the_motors_have_to_give_what_the_force_takes() -> None:
    with_it, without = required_force(pushed(STEP), 1), required_force(pushed(Signal()), 1)
    assert (with_it - without)[[1999, 2000, 2999, 3000]] == pytest.approx([0, -600, -600, 0])


def test_the_closed_loop_for_other_tools_has_the_force_as_an_input() -> None:
    made = block("closed-loop", case(2))
    force = next(variable for variable in made.inputs if variable.name == "force")
    assert (force.unit, force.start) == ("N", 0.0)
    states = np.array([variable.start for variable in made.states])
    parameters = [variable.start for variable in made.parameters]
    pushes = np.zeros((2, len(made.inputs)))
    pushes[1, made.inputs.index(force)] = 500.0
    speeds = [np.array(made.step(states, push, parameters)[0]).ravel()[1] for push in pushes]
    assert speeds[1] - speeds[0] == pytest.approx(500 * 1e-3 / 1e4, rel=1e-3)


def test_a_study_keeps_the_very_numbers_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "gust.csv"
    file.write_text("t,F\n0,0\n1,0.5\n")
    settings = [f'disturbance.force.file="{file}"', "disturbance.force.unit=kN", "simulation.duration=1.0"]
    problem = tuning_problem(case=2, settings=settings, space=["controller.observer.l0"])
    text = configuration(problem)
    assert loads(text) == problem.experiment
    file.write_text("t,F\n0,0\n1,0.6\n")
    with pytest.raises(ConfigurationError, match=r"disturbance\.force: .*gust\.csv: has changed") as caught:
        loads(text)
    assert "\n" not in str(caught.value)


def test_a_study_keeps_the_arrays_of_a_signal() -> None:
    problem = tuning_problem(case=2, space=["controller.observer.l0"])
    problem = replace(problem, experiment=pushed(STEP))
    assert loads(configuration(problem)) == problem.experiment


def test_way_points_and_recorded_motions_run(tmp_path: Path) -> None:
    asked = override(Experiment(), {"reference.kind": "way-points", "reference.points": [4, 1]})
    result = simulate(asked)
    assert result["x"][-1] == pytest.approx(1.0, abs=1e-4)
    assert result["x"].max() == pytest.approx(4.0, abs=1e-4)
    file = tmp_path / "motion.csv"
    rows = zip(result["t"][::20].tolist(), result["x_ref"][::20].tolist(), strict=True)
    file.write_text("t,x\n" + "".join(f"{t!r},{x!r}\n" for t, x in rows))
    again = simulate(replace(asked, reference=Reference("file", file=str(file), unit="m")))
    assert again["x_ref"] == pytest.approx(result["x_ref"][: len(again["x_ref"])], abs=1e-4)


@pytest.mark.parametrize(
    ("rows", "settings", "words"),
    [
        ("t,x\n1.7e9,0\n1700000001,1\n", {}, r"line 2: t = '1.7e9': must be the time since the run began"),
        ("t,x\n12:00:00,0\n12:00:01,1\n", {}, r"line 2: t = '12:00:00': must be the time since the run began"),
        (
            "t,x\n0,0\n20000,4\n40000,8\n",
            {},
            r'moves at 0.0002 m/s at most, if t is .*: must be stated, time_unit = "s"',
        ),
        (
            "t,x,v\n0,0,0\n1,1,2000\n2,4,4000\n",
            {"speed_column": "v"},
            r"column 'v': is 1.14e\+03 times the derivative of 'x'",
        ),
        (
            "t,x,v,a\n0,0,0,0\n1,1,2,-2\n2,4,4,-2\n",
            {"speed_column": "v", "acceleration_column": "a"},
            r"column 'a': is -0.667 times",
        ),
    ],
)
def test_a_motion_in_other_units_is_refused(tmp_path: Path, rows: str, settings: dict[str, Any], words: str) -> None:
    file = tmp_path / "motion.csv"
    file.write_text(rows)
    with pytest.raises(ConfigurationError, match=rf"motion\.csv: {words}"):
        prepare(replace(case(2), reference=Reference("file", file=str(file), column="x", unit="m", **settings)))


def test_a_signal_of_another_time_unit_is_refused_unless_the_unit_is_stated(tmp_path: Path) -> None:
    file = tmp_path / "push.csv"
    file.write_text("t,F\n" + "".join(f"{10 * row},1\n" for row in range(1000)))
    force = Signal.from_file(str(file), "F", unit="N")
    with pytest.raises(
        ConfigurationError, match=r"has a row every 10 s and ends after 9990 s, the run after 20 s.*time_unit"
    ):
        force.check("N", 20.0)
    for stated in ("s", "ms"):
        replace(force, time_unit=stated).check("N", 20.0)


def test_a_recorded_motion_off_the_track_names_its_time(tmp_path: Path) -> None:
    file = tmp_path / "far.csv"
    file.write_text("t,x\n0,0\n5,20\n9,50.5\n")
    with pytest.raises(
        ConfigurationError, match=r"far\.csv: x = 50\.5 m at t = 9 s: must be 0 to plant\.track\.length"
    ):
        prepare(replace(case(2), reference=Reference("file", file=str(file), unit="m")))
