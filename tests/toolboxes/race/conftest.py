"""A race of two that half a minute is enough for."""

from collections.abc import Callable
from typing import Any

import pytest

from dualwinch.toolboxes.race.entries import BenchmarkEntry, BenchmarkTerms, EntryProblem
from tests.studies import MakeProblem, make_problem

__all__ = ["make_problem"]

MakeRace = Callable[..., tuple[list[EntryProblem], BenchmarkTerms]]


@pytest.fixture(scope="session")
def make_race(make_problem: MakeProblem) -> MakeRace:
    """``make_race(...)``: two laws in the sea, runs of 0.1 s; words are those of `BenchmarkTerms`."""

    def make(settings: list[str] | None = None, **words: Any) -> tuple[list[EntryProblem], BenchmarkTerms]:
        entrants = []
        for law, space in (("nftsm", "controller.nftsm"), ("adrc", "controller.adrc")):
            entry = BenchmarkEntry(law, "kalman", "differential-tension")
            given = [f"{key}={value}" for key, value in entry.values.items()]
            length = [] if any("duration" in each for each in settings or []) else ["simulation.duration=0.1"]
            problem = make_problem(settings=[*length, *(settings or []), *given], space=[space])
            entrants.append(EntryProblem(entry, problem))
        first = entrants[0].problem
        usual = {
            "ensemble": "sea",
            "configuration": "",
            "constraints": tuple(constraint.text for constraint in first.constraints),
            "method": "cmaes",
            "rollouts": 100,
            "scenarios": first.scenarios,
            "test_scenarios": 5,
            "seed": first.seed,
        }
        return entrants, BenchmarkTerms(**(usual | words))

    return make
