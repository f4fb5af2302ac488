"""A small race: the same whoever interrupts it, its numbers those of a comparison, and no one below the least error."""

import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.ensembles.comparison import compare
from dualwinch.toolboxes.race import race as race_module
from dualwinch.toolboxes.race.entries import BenchmarkTerms, EntryProblem
from dualwinch.toolboxes.race.race import run_race
from dualwinch.toolboxes.race.result import BenchmarkResult
from dualwinch.toolboxes.race.scores import COSTS
from dualwinch.tuning.scoring.progress import CERTIFYING, SCORING
from tests.simulation.batch.test_workers import Remote
from tests.toolboxes.race.conftest import MakeRace


def numbers(found: BenchmarkResult) -> dict[str, object]:
    """What a race says, without the time it took."""
    record = found.to_dict()
    for entry in record["entries"]:
        del entry["search"]["seconds"]
    return record


@dataclass(frozen=True)
class Finished:
    """A race that is over: who took part, on which terms, what was found, and what was reported on the way."""

    entrants: list[EntryProblem]
    terms: BenchmarkTerms
    found: BenchmarkResult
    shares: list[float]
    phases: list[str]
    statuses: list[str]


@pytest.fixture(scope="module")
def finished(make_race: MakeRace) -> Finished:
    entrants, terms = make_race()
    shares, phases, statuses = list[float](), list[str](), list[str]()

    def noted(fraction: float, phase: str = "", status: str = "") -> None:
        shares.append(fraction)
        phases.append(phase)
        statuses.append(status)

    return Finished(entrants, terms, run_race(entrants, terms, progress=noted), shares, phases, statuses)


@pytest.mark.slow
def test_the_steps_of_the_choice_are_reported_as_those_of_one_study(finished: Finished) -> None:
    for words in (CERTIFYING, SCORING):
        assert f"1 of 2, nftsm: {words}" in finished.phases
    numbered = [status for status in finished.statuses if status]
    assert all(re.match(r"[12] of 2, (nftsm|adrc): certifying: ", status) for status in numbered)
    assert any(re.search(r" fresh draws, \d+ %$", status) for status in numbered)


def test_an_interrupted_race_goes_on_to_what_an_uninterrupted_one_finds(
    finished: Finished, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    entrants, terms, whole = finished.entrants, finished.terms, finished.found
    assert whole.remaining == 0

    def interrupting(fraction: float, phase: str = "", status: str = "") -> None:  # noqa: ARG001
        if phase.startswith("2 of 2, adrc: searching"):
            raise KeyboardInterrupt

    part = run_race(entrants, terms, folder=tmp_path / "part", progress=interrupting)
    assert part.remaining == 1
    assert [scored.entry.law for scored in part.entries] == ["nftsm"]
    assert "Interrupted: 1 entries remain" in repr(part)
    run: list[str] = []
    original = race_module.scored

    def counted(entry, *words, **options):
        run.append(entry.law)
        return original(entry, *words, **options)

    monkeypatch.setattr(race_module, "scored", counted)
    again = run_race(entrants, terms, folder=tmp_path / "part")
    assert run == ["adrc"]
    assert numbers(again) == numbers(whole), "the whole is without a folder"


@pytest.mark.slow
def test_a_race_by_an_executor_is_that_of_this_process_and_two_processes_share_a_folder(
    finished: Finished, tmp_path: Path
) -> None:
    entrants, terms, whole = finished.entrants, finished.terms, finished.found
    assert numbers(run_race(entrants, terms, workers=Remote())) == numbers(whole)
    run = list[str]()

    def racing(name: str) -> BenchmarkResult:
        def noted(fraction: float, phase: str = "", status: str = "") -> None:  # noqa: ARG001
            if phase.endswith("searching"):
                run.append(f"{name}: {phase}")

        return run_race(entrants, terms, folder=tmp_path, progress=noted)

    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(racing, ("one", "two")))
    assert [numbers(each) for each in found] == [numbers(whole)] * 2
    assert len(set(run)) == len(entrants), "each was searched by one of them"
    assert sorted(file.suffix for file in (tmp_path / "entries").iterdir()) == [".json"] * 3


def test_before_the_first_is_finished_an_interrupt_is_raised(make_race: MakeRace, tmp_path: Path) -> None:
    entrants, terms = make_race()

    def interrupting(fraction: float, phase: str = "", status: str = "") -> None:  # noqa: ARG001
        if "searching" in phase:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_race(entrants, terms, folder=tmp_path, progress=interrupting)
    assert [file.name for file in (tmp_path / "entries").iterdir()] == ["paper.json"]


def test_numbers_are_those_of_a_comparison_in_scenarios_of_another_seed(finished: Finished) -> None:
    entrants, terms, found = finished.entrants, finished.terms, finished.found
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
    assert {scored.search.rollouts >= 87 for scored in found.entries} == {True}


def test_fronts_are_gains_in_the_test_set(finished: Finished) -> None:
    entrants, terms, found = finished.entrants, finished.terms, finished.found
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
    entrants, terms = make_race(
        ["simulation.duration=12.0", "controller.coordination.tension_max=1500"], test_scenarios=3
    )
    found = run_race(entrants, terms)
    least, foreseeing = found.paper.lower_bounds.without_foresight, found.paper.lower_bounds.with_foresight
    assert (least > 0).all()
    assert (foreseeing <= least).all()
    for runs in (found.paper.runs, *(scored.runs for scored in found.entries)):
        errors = runs.metrics["mse"][runs.completed]
        assert (errors >= least[runs.completed]).all()
    assert "3 of the scenarios are infeasible" in repr(found)


def test_other_terms_are_refused_before_anything_runs(make_race: MakeRace, tmp_path: Path) -> None:
    entrants, terms = make_race()
    run_race(entrants[:1], terms, folder=tmp_path)
    with pytest.raises(ConfigurationError, match="other rollouts, 100 and not 200"):
        run_race(entrants, replace(terms, rollouts=200), folder=tmp_path)
    with pytest.raises(ConfigurationError, match="test_scenarios = 1: must be a whole number >= 2"):
        replace(terms, test_scenarios=1)


def test_who_did_not_run_everything_to_its_end_is_behind(finished: Finished) -> None:
    found = finished.found
    first, second = found.ranking
    outcomes = np.array(["completed"] * 4 + ["diverged"])
    lost = replace(first, runs=replace(first.runs, outcomes=outcomes))
    changed = replace(found, entries=(lost, second))
    assert [scored.entry for scored in changed.ranking] == [second.entry, first.entry]
    assert "1 of 5 scenarios not completed" in repr(changed)
