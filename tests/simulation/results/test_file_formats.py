import csv
import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.io import loadmat

from dualwinch.controllers.registry import POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.ensembles.result import save_ensemble
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.file_formats import save
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.rows import COLUMNS
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

NAMES = [
    *("t", "x", "v", "theta_1", "omega_1", "theta_2", "omega_2", "x_ref", "v_ref", "a_ref", "e", "F1", "F2"),
    *("F1_cmd", "F2_cmd", "u", "u_sat", "d_true", "tau_1", "tau_2"),
]
OWN = {
    "fando-nftsm": ["Z_a", "s", "d_hat", "L1"],
    "nftsm": ["Z_a", "s"],
    "pid-cascade": [],
    "super-twisting": ["Z_a", "s"],
    "adrc": ["d_hat"],
    "lqi": [],
    "eid": ["d_hat"],
    "rbf-sliding-mode": ["s", "d_hat"],
    "mpc": ["d_hat"],
}


@pytest.fixture(scope="module")
def pid() -> Result:
    return simulate(override(case(4, "pid-cascade"), {"simulation.duration": 0.5}))


@pytest.mark.parametrize("kind", POSITION_LAWS)
def test_columns_are_the_contract(kind: str) -> None:
    result = simulate(override(case(4, kind), {"simulation.duration": 0.01}))
    assert list(COLUMNS) == NAMES
    assert list(result.columns) == list(result.quantities) == [*NAMES, *OWN[kind]]


def test_csv_keeps_every_bit(pid: Result, tmp_path: Path) -> None:
    save(pid, tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == NAMES
    assert len(rows) == 500
    assert [float(row["F1"]) for row in rows] == pid["F1"].tolist()


def test_units_of_csv_stand_beside_it(pid: Result, tmp_path: Path) -> None:
    save(pid, f"{tmp_path}/run.csv", {"version": "9"})
    facts = json.loads((tmp_path / "run.csv-metadata.json").read_text())
    assert facts["url"] == "run.csv"
    assert {column["name"]: column["dualwinch:unit"] for column in facts["tableSchema"]["columns"]} == pid.units
    assert facts["dualwinch:version"] == "9"
    assert facts["dualwinch:metrics"]["mse"] == pid.metrics.mse


def test_parquet_carries_units_and_facts(pid: Result, tmp_path: Path) -> None:
    save(pid, tmp_path / "run.parquet")
    table = pq.read_table(tmp_path / "run.parquet")
    assert table.column_names == NAMES
    assert {field.name: field.metadata[b"unit"].decode() for field in table.schema} == pid.units
    assert table.schema.metadata[b"dualwinch.outcome"] == b"completed"
    np.testing.assert_array_equal(table["F2"].to_numpy(), pid["F2"])


def test_npz_carries_units(pid: Result, tmp_path: Path) -> None:
    save(pid, tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as data:
        assert json.loads(str(data["units"])) == pid.units
        np.testing.assert_array_equal(data["x"], pid["x"])


def test_mat_carries_units(pid: Result, tmp_path: Path) -> None:
    save(pid, tmp_path / "run.mat")
    data = loadmat(tmp_path / "run.mat")
    assert str(data["units"]["F1"].item().item()) == "N"
    np.testing.assert_array_equal(data["x"].ravel(), pid["x"])


def test_an_unknown_suffix_is_refused_by_name(pid: Result, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"run\.xls.*\.csv, \.parquet, \.npz, \.mat"):
        save(pid, tmp_path / "run.xls")


def test_what_is_no_result_is_refused_with_the_function_for_it(pid: Result, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"result: is a Experiment: .* an experiment by .*to_toml"):
        save(pid.experiment, tmp_path / "run.csv")  # pyright: ignore[reportArgumentType]
    with pytest.raises(ConfigurationError, match=r"result: is a Result: .* by save"):
        save_ensemble(pid, tmp_path / "runs.csv")  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("suffix", ["csv", "parquet", "npz", "mat"])
def test_a_failed_write_leaves_nothing(
    pid: Result, suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A full disk, or an interrupt, at the last moment."""

    def full(*_: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="No space"):
        save(pid, tmp_path / f"run.{suffix}")
    assert list(tmp_path.iterdir()) == []
