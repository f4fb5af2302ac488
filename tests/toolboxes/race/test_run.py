"""A small race: the same if it is interrupted, its numbers those of a comparison, no one below the least error."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from dualwinch.cli import main
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.ensembles.comparison import compare
from dualwinch.toolboxes.race.race import CHECKPOINTS, EntryTask, run_race
from dualwinch.toolboxes.race.result import RaceResult
from dualwinch.toolboxes.race.scores import COSTS
from tests.killed import killed_after, written
from tests.simulation.batch.test_workers import Remote
from tests.toolboxes.race.conftest import MakeRace


def numbers(found: RaceResult) -> dict[str, object]:
    """What a race says, without the time it took."""
    record = found.to_record()
    for entry in record["entries"]:
        del entry["search"]["seconds"]
    return record


@dataclass(frozen=True)
class Finished:
    """A race that is over: who took part, its result, and what was reported on the way."""

    entrants: list[EntryTask]
    found: RaceResult
    shares: list[float]
    phases: list[str]
    statuses: list[str]


@pytest.fixture(scope="module")
def finished(make_race: MakeRace) -> Finished:
    entrants = make_race()
    shares, phases, statuses = list[float](), list[str](), list[str]()

    def noted(fraction: float, phase: str = "", status: str = "") -> None:
        shares.append(fraction)
        phases.append(phase)
        statuses.append(status)

    return Finished(entrants, run_race(entrants, progress=noted), shares, phases, statuses)


def test_an_interrupted_race_goes_on_to_what_an_uninterrupted_one_finds(finished: Finished, tmp_path: Path) -> None:
    entrants, whole = finished.entrants, finished.found
    assert whole.remaining == 0

    def interrupting(fraction: float, phase: str = "", status: str = "") -> None:  # noqa: ARG001
        if phase.startswith("2 of 2, adrc: searching"):
            raise KeyboardInterrupt

    part = run_race(entrants, folder=tmp_path / "part", progress=interrupting)
    assert part.remaining == 1
    assert [scored.entry.law for scored in part.entries] == ["nftsm"]
    assert "Interrupted: 1 entries remain" in repr(part)
    phases: list[str] = []

    def noted(fraction: float, phase: str = "", status: str = "") -> None:  # noqa: ARG001
        phases.append(phase)

    again = run_race(entrants, folder=tmp_path / "part", progress=noted)
    assert {phase.partition(":")[0] for phase in phases if phase} == {"2 of 2, adrc"}
    assert numbers(again) == numbers(whole), "the whole is without a folder"


@pytest.mark.slow
def test_a_race_by_an_executor_is_that_of_this_process(finished: Finished, tmp_path: Path) -> None:
    executor = Remote()
    assert numbers(run_race(finished.entrants, folder=tmp_path, workers=executor)) == numbers(finished.found)
    assert len(executor.sent) == 3
    assert numbers(run_race(finished.entrants, folder=tmp_path, workers=executor)) == numbers(finished.found)
    assert len(executor.sent) == 3, "everything is stored"


@pytest.mark.slow
def test_a_killed_race_goes_on_to_the_same_digits(tmp_path: Path) -> None:
    """Killed by the system when the paper's gains and the first entry are finished."""
    words = ["race", "--ensemble", "sea", "--set", "simulation.duration=0.1", "--constraint", "none", "--law", "nftsm"]
    words += ["--law", "adrc", "--rollouts", "60", "--scenarios", "2", "--test-scenarios", "4", "--out"]
    checkpoints = tmp_path / "killed" / CHECKPOINTS
    files = killed_after(2, [*words, str(tmp_path / "killed")], checkpoints)
    for folder in ("killed", "whole"):
        main([*words, str(tmp_path / folder)])
    assert len(written(checkpoints)) == 3
    assert files.items() <= written(checkpoints).items()
    killed, whole = (json.loads((tmp_path / name / "race.json").read_text()) for name in ("killed", "whole"))
    for entry in (*killed["entries"], *whole["entries"]):
        del entry["search"]["seconds"]
    assert killed == whole


def test_before_the_first_is_finished_an_interrupt_is_raised(make_race: MakeRace, tmp_path: Path) -> None:
    entrants = make_race()

    def interrupting(fraction: float, phase: str = "", status: str = "") -> None:  # noqa: ARG001
        if "searching" in phase:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_race(entrants, folder=tmp_path, progress=interrupting)
    assert len(list((tmp_path / CHECKPOINTS).iterdir())) == 1, "the paper's gains"


def test_numbers_are_those_of_a_comparison_in_scenarios_of_another_seed(finished: Finished) -> None:
    entrants, found = finished.entrants, finished.found
    terms = found.terms
    assert finished.shares == sorted(finished.shares)
    problem = entrants[0].problem
    assert problem.ensemble is not None
    controllers = {"paper": paper_controller()} | {
        scored.entry.law: with_leaves(entrant.problem.experiment, scored.gains).controller
        for entrant in entrants
        for scored in found.entries
        if scored.entry == entrant.entry
    }
    theirs = compare(controllers, problem.ensemble, terms.test_scenarios, terms.test_seed)
    for name, runs in (("paper", found.paper.runs), *((each.entry.law, each.runs) for each in found.entries)):
        for metric in ("mse", "chatter", "continuous_load"):
            assert runs.metrics[metric] == pytest.approx(theirs.contenders[name].metrics[metric], rel=1e-9)
    assert found.ranking[0].entry.law in controllers
    # 100 rollouts: what a search leaves is too little for another halved generation, 30, and its certificate
    assert {scored.search.rollouts >= 80 for scored in found.entries} == {True}


def test_fronts_are_gains_in_the_test_set(finished: Finished) -> None:
    entrants, found = finished.entrants, finished.found
    terms = found.terms
    problems = {entrant.entry.key: entrant.problem for entrant in entrants}
    for scored in found.entries:
        assert set(scored.fronts) == set(COSTS)
        problem = problems[scored.entry.key]
        for cost, points in scored.fronts.items():
            assert points
            controllers = {
                str(index): with_leaves(problem.experiment, point.gains).controller
                for index, point in enumerate(points)
            }
            assert problem.ensemble is not None
            theirs = compare(controllers, problem.ensemble, terms.test_scenarios, terms.test_seed)
            for point, contender in zip(points, theirs.contenders.values(), strict=True):
                assert point.error == pytest.approx(contender.metrics["mse"].mean(), rel=1e-9)
                assert point.cost == pytest.approx(contender.metrics[cost].mean(), rel=1e-9)


@pytest.mark.slow
def test_no_controller_is_below_the_least_error(make_race: MakeRace) -> None:
    """On motors that are too weak for the reference, scenario by scenario."""
    entrants = make_race(["simulation.duration=12.0", "controller.coordination.tension_max=1500"], test_scenarios=3)
    found = run_race(entrants)
    least, foreseeing = found.paper.lower_bounds.without_foresight, found.paper.lower_bounds.with_foresight
    assert (least > 0).all()
    assert (foreseeing <= least).all()
    for runs in (found.paper.runs, *(scored.runs for scored in found.entries)):
        errors = runs.metrics["mse"][runs.completed]
        assert (errors >= least[runs.completed]).all()
    assert "3 of the scenarios are infeasible" in repr(found)


def test_who_did_not_run_everything_to_its_end_is_behind(finished: Finished) -> None:
    found = finished.found
    first, second = found.ranking
    outcomes = np.array(["completed"] * 4 + ["diverged"])
    lost = replace(first, runs=replace(first.runs, outcomes=outcomes))
    changed = replace(found, entries=(lost, second))
    assert [scored.entry for scored in changed.ranking] == [second.entry, first.entry]
    assert "1 of 5 scenarios not completed" in repr(changed)
