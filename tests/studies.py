"""Small problems that a second is enough for, and few scenarios to choose and test gains in."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from dualwinch.tuning import tuning_problem as tuning_problem_module
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.selection_config import SampleSizes, SelectionConfig
from dualwinch.tuning.tuning_problem import tuning_problem

MakeProblem = Callable[..., TuningProblem]


FEW = SelectionConfig(demand_among=80, sizes=SampleSizes(6, 100, 12, 4, 20, 24))
"""The usual choice of gains, in few scenarios."""


FEWEST = SelectionConfig(
    demand_among=20,
    margin_machines=2,
    margin_machines_screened=2,
    margin_machines_validated=2,
    sizes=SampleSizes(2, 10, 4, 2, 8, 8),
)
"""Each of its steps in next to no scenarios, for tests of what comes before or after it."""


@contextmanager
def choosing_by(config: SelectionConfig) -> Iterator[None]:
    """Other defaults of `SelectionConfig`."""

    class Others(SelectionConfig):
        def __new__(cls, *given: Any, **words: Any) -> SelectionConfig:
            return SelectionConfig(*given, **words) if given or words else config

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tuning_problem_module, "SelectionConfig", Others)
        yield


@pytest.fixture(scope="module")
def few_scenarios() -> Iterator[None]:
    """Few scenarios by default, for all tests of a file that has ``usefixtures("few_scenarios")``."""
    with choosing_by(FEW):
        yield


@pytest.fixture(scope="module")
def fewest_scenarios() -> Iterator[None]:
    """As `few_scenarios`, with `FEWEST`."""
    with choosing_by(FEWEST):
        yield


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
            "selection": FEW,
        }
        if words.get("ensemble", "sea") is None:
            given["scenarios"] = None
        given |= words
        if given["constraints"]:  # beside the default ones these would be too many for so short runs
            given["constraints"] = ["none", *given["constraints"]]
        return tuning_problem(**given)

    return make
