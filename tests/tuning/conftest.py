"""Small problems that a second is enough for."""

from collections.abc import Callable
from typing import Any

import pytest

from dualwinch.commands.tuning_setup import tuning_problem
from dualwinch.tuning.problem import TuningProblem

MakeProblem = Callable[..., TuningProblem]


@pytest.fixture
def make_problem() -> MakeProblem:
    """``make_problem(ensemble="sea", ...)``: a problem of 0.1 s runs; the words are those of the command line."""

    def make(**words: Any) -> TuningProblem:
        given = {
            "settings": ["simulation.duration=0.1"],
            "ensemble": "sea",
            "space": ["controller.nftsm.beta", "controller.observer.l0", "controller.coordination.preload"],
            "constraints": ["mean.chatter<=1*paper"],
            "scenarios": 4,
            "seed": 3,
        }
        if words.get("ensemble", "sea") is None:
            given["scenarios"] = None
        return tuning_problem(**(given | words))

    return make
