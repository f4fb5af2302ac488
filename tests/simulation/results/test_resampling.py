from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.rows import COLUMNS
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

HELD = ["a_ref", "F1_cmd", "F2_cmd", "u", "u_sat", "tau_1", "tau_2"]


@pytest.fixture(scope="module")
def run() -> Result:
    return simulate(override(case(4), {"simulation.duration": 0.5}))


def test_commands_are_held_and_motion_is_linear(run: Result) -> None:
    own = [name for name in run if name not in COLUMNS]
    assert [name for name, kind in run.interpolation.items() if kind == "held"] == [*HELD, *own]
    between = run.resample(times=[0.1003, 0.2, 0.2999])
    assert between["t"].tolist() == [0.1003, 0.2, 0.2999]
    for name, kind in run.interpolation.items():
        before, after = run[name][[100, 200, 299]], run[name][[101, 201, 300]]
        wanted = before if kind == "held" else before + np.array([0.3, 0.0, 0.9]) * (after - before)
        assert between[name] == pytest.approx(wanted, rel=1e-9, abs=1e-15), name
    assert between["tau_1"][2] == run["tau_1"][299]


def test_the_instants_of_rows_give_the_rows(run: Result) -> None:
    """Instants that rounding puts just before a row are that row's, for held signals too."""
    assert run.resample(times=run["t"]) == run
    coarse = simulate(run.experiment, stride=10)
    fewer = run.resample(rate=100)
    for name in run:
        assert fewer[name] == pytest.approx(coarse[name], rel=1e-9, abs=1e-12), name
        if name in HELD:
            assert fewer[name].tolist() == coarse[name].tolist()
    assert fewer["t"][-1] <= run["t"][-1]


def test_all_but_the_rows_stays_the_runs(run: Result) -> None:
    few = run.resample(7)
    assert len(few["t"]) == 4
    assert len(run["t"]) == 500
    assert replace(few, columns=run.columns) == run


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "resample: give either rate or times"),
        ({"rate": 1, "times": [0]}, "resample: give either rate or times"),
        ({"rate": 0}, "rate = 0: must be a finite number > 0 1/s, of at most 1e+09 instants"),
        ({"rate": np.nan}, "rate = nan: must be a finite number > 0 1/s, of at most 1e+09 instants"),
        ({"rate": 1e12}, "rate = 1e+12: must be a finite number > 0 1/s, of at most 1e+09 instants"),
        ({"times": [0.1, 0.5]}, "times[1] = 0.5: must be 0 to 0.499 s, where rows are"),
        ({"times": [-0.1]}, "times[0] = -0.1: must be 0 to 0.499 s, where rows are"),
        ({"times": [0.1, np.nan]}, "times[1] = nan: must be 0 to 0.499 s, where rows are"),
        ({"times": [0.1, 0.3, 0.2]}, "times[2] = 0.2: must be > times[1]"),
        ({"times": []}, "times: shape (0,) must be (n,), with at least one time"),
        ({"times": [[0.1]]}, "times: shape (1, 1) must be (n,), with at least one time"),
    ],
)
def test_grids_that_are_none_are_told(run: Result, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        run.resample(**arguments)
    assert str(caught.value) == message


def test_without_rows_there_is_nothing_to_resample(run: Result) -> None:
    with pytest.raises(ConfigurationError, match=r"^resample: the run kept no rows \(stride = 0\)$"):
        simulate(run.experiment, stride=0).resample(1)
