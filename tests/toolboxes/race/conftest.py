"""A race of two that half a minute is enough for."""

from collections.abc import Callable
from typing import Any

import pytest

from dualwinch.toolboxes.race.entries import RaceEntry, RaceTerms
from dualwinch.toolboxes.race.race import EntryTask
from dualwinch.tuning.problem import TuningProblem
from tests.studies import MakeProblem, make_problem

__all__ = ["make_problem"]

MakeRace = Callable[..., list[EntryTask]]


@pytest.fixture(scope="session")
def make_race(make_problem: MakeProblem) -> MakeRace:
    """``make_race(...)``: two laws in the sea, runs of 0.1 s; words are those of `RaceTerms`."""

    def make(settings: list[str] | None = None, **words: Any) -> list[EntryTask]:
        entries = list[tuple[RaceEntry, TuningProblem]]()
        for law, space in (("nftsm", "controller.nftsm"), ("adrc", "controller.adrc")):
            entry = RaceEntry(law, "kalman", "differential-tension")
            given = [f"{key}={value}" for key, value in entry.values.items()]
            length = [] if any("duration" in each for each in settings or []) else ["simulation.duration=0.1"]
            settings_of = [*length, *(settings or []), *given]
            entries.append((entry, make_problem(settings=settings_of, space=[space])))
        problem = entries[0][1]
        usual = {
            "ensemble": "sea",
            "configuration": "",
            "constraints": tuple(constraint.text for constraint in problem.constraints),
            "method": "cmaes",
            "rollouts": 100,
            "scenarios": problem.scenarios,
            "test_scenarios": 5,
            "seed": problem.seed,
        }
        terms = RaceTerms(**(usual | words))
        return [EntryTask(entry, problem, terms) for entry, problem in entries]

    return make
