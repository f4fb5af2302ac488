import sys

import numpy as np
import pytest

from dualwinch.model.errors import MissingExtraError
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate


@pytest.fixture(scope="module")
def run() -> Result:
    return simulate(override(case(4), {"simulation.duration": 0.2}))


def test_a_data_frame_has_the_rows_by_time_and_units(run: Result) -> None:
    frame = run.to_pandas()
    assert frame.index.name == "t"
    assert frame.index.tolist() == run["t"].tolist()
    assert list(frame) == [name for name in run if name != "t"]
    for name in frame:
        assert frame[name].to_numpy().tobytes() == run[str(name)].tobytes()
    assert frame.attrs["units"] == run.units
    assert frame.attrs["meanings"]["F1"] == "tension of rope 1"
    assert (frame.attrs["mse"], frame.attrs["outcome"]) == (run.metrics.mse, "completed")
    frame.loc[0.0, "x"] = 3.0
    assert run["x"][0] == 0.0, "a copy"


def test_a_data_set_has_coordinates_and_units(run: Result) -> None:
    found = run.to_xarray()
    assert dict(found.sizes) == {"t": 200}
    assert list(found.coords) == ["t"]
    assert [*found] == [name for name in run if name != "t"]
    for name in run:
        assert found[name].to_numpy().tobytes() == run[name].tobytes()
        assert found[name].attrs["units"] == run.units[name]
    assert found["tau_1"].attrs["long_name"] == "motor torque command of winch 1"
    assert (found["tau_1"].attrs["interpolation"], found["x"].attrs["interpolation"]) == ("held", "linear")
    assert (found.attrs["end_time"], found.attrs["mse"]) == (0.2, run.metrics.mse)
    assert float(found["x"].sel(t=0.1, method="nearest")) == run["x"][np.argmin(abs(run["t"] - 0.1))]


@pytest.mark.parametrize("name", ["pandas", "xarray"])
def test_a_missing_library_is_one_line_that_says_how_to_get_it(
    run: Result, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtraError) as caught:
        getattr(run, f"to_{name}")()
    assert str(caught.value) == (
        f"{name} is not installed; install it with: pip install 'dualwinch[{name}]', or uv run --extra {name} ..."
    )
