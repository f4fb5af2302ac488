"""Small problems that a second is enough for, with few draws to certify and test gains in."""

from collections.abc import Callable
from typing import Any

import pytest

from dualwinch.tuning.options import TuningOptions
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.tuning_problem import tuning_problem

MakeProblem = Callable[..., TuningProblem]

FEW = TuningOptions(
    draws=4, hard=2, population=40, cuts=6, chunk=8, machines_checked=2, machines=4, violation=0.2, test=16
)
"""Every step of the method in few draws and on few machines."""


@pytest.fixture(scope="session")
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
            "options": FEW,
        }
        if words.get("ensemble", "sea") is None:
            given["scenarios"] = None
        given |= words
        if given["constraints"]:  # beside the default ones these would be too many for so short runs
            given["constraints"] = ["none", *given["constraints"]]
        return tuning_problem(**given)

    return make
