import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.ensembles.result import SUFFIXES, EnsembleResult, save_ensemble
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.metrics.metrics import BUILT_IN
from tests.lasting import lasting

MASS = "plant.vehicle.mass"


@pytest.fixture(scope="module")
def result() -> EnsembleResult:
    return run_ensemble(lasting(0.2), 5, 7, traces=False)


def read(path: Path) -> tuple[dict[str, list[Any]], dict[str, str], dict[str, Any]]:
    """Columns, units and facts of a file, read the way its users do."""
    if path.suffix == ".csv":
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file))
        about = json.loads(path.with_name(path.name + "-metadata.json").read_text())
        units = {column["name"]: column["dualwinch:unit"] for column in about["tableSchema"]["columns"]}
        facts = {key.removeprefix("dualwinch:"): value for key, value in about.items()}
        return {name: [row[name] for row in rows] for name in rows[0]}, units, facts
    if path.suffix == ".parquet":
        from pyarrow import parquet

        table = parquet.read_table(path)
        units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
        facts = {
            key.decode().removeprefix("dualwinch."): value.decode() for key, value in table.schema.metadata.items()
        }
        return table.to_pydict(), units, facts
    if path.suffix == ".npz":
        with np.load(path) as file:
            content = {name: file[name].tolist() for name in file.files}
        return content, json.loads(content["units"]), content
    content = json.loads(path.read_text())
    rows = content["scenarios"]
    return {name: [row[name] for row in rows] for name in rows[0]}, content["units"], content


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_format_keeps_rows_units_seed_and_statistics(suffix: str, result: EnsembleResult, tmp_path: Path) -> None:
    path = tmp_path / f"sea{suffix}"
    save_ensemble(result, str(path), {"configuration": "the whole file"})
    columns, units, facts = read(path)
    assert [float(value) for value in columns[MASS]] == result.draws[MASS].tolist()
    assert [int(value) for value in columns["simulation.seed"]] == result.draws["simulation.seed"].tolist()
    assert [float(value) for value in columns["mse"]] == pytest.approx(result.metrics["mse"].tolist(), rel=1e-15)
    assert list(columns["outcome"]) == ["completed"] * 5
    assert set(BUILT_IN) <= set(columns)
    assert units[MASS] == "kg"
    assert units["mse"] == "m^2"
    assert int(facts["ensemble_seed"]) == 7
    assert facts["configuration"] == "the whole file"
    statistics = facts["statistics"]
    statistics = json.loads(statistics) if isinstance(statistics, str) else statistics
    assert statistics["mse"]["worst"] == result.metrics["mse"].max()
    assert statistics["steady_mse"]["mean"] is None
    assert columns["steady_mse"][0] in {None, ""} or np.isnan(columns["steady_mse"][0])


def test_an_unknown_suffix_is_refused(result: EnsembleResult, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"\.csv, \.parquet, \.npz, \.json"):
        save_ensemble(result, tmp_path / "sea.mat")
    assert list(tmp_path.iterdir()) == []
