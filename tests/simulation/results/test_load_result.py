import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.vehicle import Vehicle
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.file_formats import FORMATS, load_result, save
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

SETTINGS = {
    "simulation.duration": 0.5,
    "controller.kind": "super-twisting",
    "controller.estimator": "kalman",
    "controller.coordination.kind": "master-slave",
    "plant.vehicle.mass": 9876.54321,
    "plant.rope_slack": False,
    "sensors.position_noise": 1e-3,
    "simulation.seed": 2**53 + 1,
}


@pytest.fixture(scope="module")
def run() -> Result:
    return simulate(override(case(4), SETTINGS), nominal=Plant(vehicle=Vehicle(mass=1.1e4)))


def written(result: Result, path: Path) -> Path:
    save(result, path)
    return path


@pytest.mark.parametrize("suffix", FORMATS)
def test_what_is_loaded_is_what_was_saved(run: Result, suffix: str, tmp_path: Path) -> None:
    loaded = load_result(str(written(run, tmp_path / f"run{suffix}")))
    assert loaded == run
    assert list(loaded.columns) == list(run.columns)
    for name, column in run.columns.items():
        assert loaded[name].dtype == np.float64
        assert loaded[name].tobytes() == column.tobytes(), name
        loaded[name][0] = 1.0  # a result's own, to be written to as a fresh one's
    assert (loaded.metrics.mse, loaded.outcome, loaded.end_time) == (run.metrics.mse, "completed", run.end_time)
    assert np.isnan(loaded.metrics.steady_mse)
    assert loaded.final_state == run.final_state
    assert loaded.quantities == run.quantities
    assert loaded.experiment == run.experiment
    assert loaded.experiment.simulation.seed == 2**53 + 1
    assert loaded.nominal == Plant(vehicle=Vehicle(mass=1.1e4))
    assert loaded != replace(run, nominal=None)


@pytest.mark.parametrize("suffix", FORMATS)
def test_any_number_comes_back(run: Result, suffix: str, tmp_path: Path) -> None:
    odd = np.array([np.nan, np.inf, -np.inf, -0.0, 5e-324, 1.7976931348623157e308, 0.1])
    result = replace(
        run,
        columns={"t": np.arange(7.0), "gain.0": odd},
        quantities={"t": Quantity("s", "time, in “s”"), "gain.0": Quantity("1", "a gain", "by hand")},
        final_state={"a.b": np.inf, "c": -np.inf, "d": np.nan, "e": 0.1},
        metrics=replace(run.metrics, mse=np.inf),
        outcome="diverged",
    )
    loaded = load_result(written(result, tmp_path / f"run{suffix}"))
    assert loaded == result
    assert loaded["gain.0"][1:].tobytes() == odd[1:].tobytes()
    assert loaded.quantities["gain.0"].source == "by hand"


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("stride", [0, 500])
def test_few_rows_or_none_come_back(suffix: str, stride: int, tmp_path: Path) -> None:
    result = simulate(override(case(4), {"simulation.duration": 0.5}), stride=stride)
    assert len(result["t"]) == (stride > 0)
    assert load_result(written(result, tmp_path / f"run{suffix}")) == result


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("plant.vehicle.mass", -1.0, "plant.vehicle.mass = -1.0: must be a finite number > 0 kg"),
        ("plant.vehicle.mas", 1.0, "unknown key 'plant.vehicle.mas'; did you mean 'plant.vehicle.mass'?"),
    ],
)
def test_an_experiment_that_is_none_is_told(run: Result, key: str, value: float, message: str, tmp_path: Path) -> None:
    path = written(run, tmp_path / "run.csv")
    beside = tmp_path / "run.csv-metadata.json"
    described = json.loads(beside.read_text())
    described["dualwinch:experiment"][key] = value
    beside.write_text(json.dumps(described))
    with pytest.raises(ConfigurationError) as caught:
        load_result(path)
    assert str(caught.value).startswith(f"{path}: {message}")


@pytest.mark.parametrize("suffix", FORMATS)
def test_files_that_hold_no_result_are_told(suffix: str, run: Result, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    with pytest.raises(ConfigurationError, match=r"^cannot read .*run\.\w+: No such file or directory$"):
        load_result(path)
    save(run, path)
    whole = path.read_bytes()
    for damaged in (b"", b"nothing", whole[: len(whole) // 2]):
        path.write_bytes(damaged)
        if suffix == ".csv":
            (tmp_path / "run.csv-metadata.json").write_text("{}")
        with pytest.raises(ConfigurationError) as caught:
            load_result(path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
def test_columns_of_different_lengths_are_no_result(suffix: str, run: Result, tmp_path: Path) -> None:
    short = replace(run, columns=run.columns | {"v": run["v"][:-1]})
    path = tmp_path / f"run{suffix}"
    save(short, path)
    with pytest.raises(ConfigurationError, match=r"column 'v' has \d+ rows: must have \d+, as 't'$"):
        load_result(path)


def test_a_csv_file_needs_its_metadata(run: Result, tmp_path: Path) -> None:
    path = written(run, tmp_path / "run.csv")
    (tmp_path / "run.csv-metadata.json").unlink()
    with pytest.raises(ConfigurationError, match=r"run\.csv: run\.csv-metadata\.json is not beside it"):
        load_result(path)
    with pytest.raises(ConfigurationError, match=r"unknown suffix '\.xls'"):
        load_result(tmp_path / "run.xls")


@pytest.mark.parametrize(("name", "suffix"), [("units", ".npz"), ("units", ".mat"), ("gain_0", ".mat")])
def test_a_name_that_is_taken_is_refused_not_overwritten(run: Result, name: str, suffix: str, tmp_path: Path) -> None:
    names = ["t", "gain.0", name]
    columns = {name: np.zeros(2) for name in names}
    result = replace(run, columns=columns, quantities=dict.fromkeys(names, Quantity("1", "")))
    with pytest.raises(ConfigurationError, match=f"column '{name}': {suffix} files have another entry of this name"):
        save(result, tmp_path / f"run{suffix}")
    assert list(tmp_path.iterdir()) == []
